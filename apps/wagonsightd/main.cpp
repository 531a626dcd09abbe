#include <fmt/format.h>

#include <cstring>
#include <exception>

#include "command_line.h"
#include "daemon.h"
#include "unit.h"
#include "version.h"
#include "web_side.h"

namespace wagonsight {
namespace {

constexpr int kExitFailure = 1;
constexpr int kExitUsage = 2;

int report(const Result<void>& done) {
  if (done) return 0;
  fmt::print(stderr, "wagonsightd: {}\n", done.error().message);
  return kExitFailure;
}

Result<void> check_config(const std::string& path, bool with_files) {
  const auto settings = read_settings(path);
  if (!settings) return tl::unexpected(settings.error());
  if (with_files)
    if (auto checked = check_named_files(*settings); !checked) return checked;
  fmt::print("{}: is in order\n", path);
  return {};
}

int run(int argc, char** argv) {
  const auto command = read_command(argc, argv);
  if (!command) {
    fmt::print(stderr, "wagonsightd: {}; see wagonsightd --help\n", command.error().message);
    return kExitUsage;
  }
  switch (command->kind) {
    case Command::Kind::kHelp:
      fmt::print("{}", kHelpText);
      return 0;
    case Command::Kind::kVersion:
      fmt::print("wagonsightd {}\n", kVersionText);
      return 0;
    case Command::Kind::kCheck:
      return report(check_config(command->options.config, command->with_files));
    case Command::Kind::kRun:
      break;
  }
  return report(run_daemon(command->options));
}

}  // namespace
}  // namespace wagonsight

int main(int argc, char** argv) {
  // Only what a library throws by itself (no memory, mostly) arrives here.
  try {
    if (argc == 2 && std::strcmp(argv[1], wagonsight::kWebSideArgument) == 0)
      return wagonsight::run_web_side();
    return wagonsight::run(argc, argv);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "wagonsightd: %s\n", error.what());
    return 1;
  }
}

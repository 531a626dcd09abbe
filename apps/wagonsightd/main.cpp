#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include <cstdlib>
#include <cstring>
#include <exception>

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
  CLI::App app{
      "wagonsightd: watches a wagon and serves its page until it is told to stop (SIGTERM).",
      "wagonsightd"};
  DaemonOptions options;
  bool check_only = false, check_files = false;
  std::uint16_t port = 0;
  app.set_version_flag("--version", fmt::format("wagonsightd {}", kVersionText));
  app.add_option("--config", options.config, "the settings (TOML)")->required();
  app.add_option("--rig", options.rig, "a calibration blob instead of the settings'");
  const auto* own_port = app.add_option("--port", port, "instead of the settings'; 0: a free one");
  // systemd names its RuntimeDirectory= so.
  if (const char* folder = std::getenv("RUNTIME_DIRECTORY")) options.state_folder = folder;
  app.add_option(
      "--state", options.state_folder,
      "a folder that a restart of the machine clears (/run/...): there a crash is noted, "
      "so that the next run tells it");
  app.add_option("--updater", options.updater,
                 "the socket of wagonsight-update, for the page; without it, it cannot update");
  app.add_flag("--check-files", check_files, "with --check-config: also the files that they name");
  app.add_flag("--check-config", check_only, "only check the settings, and list every mistake");
  app.failure_message([](const CLI::App*, const CLI::Error& error) {
    return fmt::format("wagonsightd: {}; see wagonsightd --help\n", error.what());
  });
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : kExitUsage;
  }
  if (check_only) return report(check_config(options.config, check_files));
  if (own_port->count() > 0) options.port = port;
  return report(run_daemon(options));
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

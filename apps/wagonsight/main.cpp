#include <fmt/format.h>

#include <cstdio>
#include <exception>
#include <string>

#include "commands.h"
#include "version.h"

namespace wagonsight {
namespace {

constexpr int kExitFailure = 1;
constexpr int kExitUsage = 2;

// "wagonsight import", or "wagonsight" when no command was recognised.
std::string chosen_name(const CLI::App& app) {
  const auto chosen = app.get_subcommands();
  return chosen.empty() ? "wagonsight" : "wagonsight " + chosen.front()->get_name();
}

void declare(CommandLine& line) {
  CLI::App& app = line.app;
  app.name("wagonsight");
  app.description("wagonsight: who is where in a railway wagon, from its depth cameras.");
  app.set_version_flag("--version", fmt::format("wagonsight {}", kVersionText));
  app.require_subcommand(1);
  app.failure_message([](const CLI::App* failed, const CLI::Error& error) {
    const std::string name = chosen_name(*failed);
    return fmt::format("{}: {}; see {} --help\n", name, error.what(), name);
  });
  add_simulate(line);
  add_import(line);
  add_record(line);
  add_replay(line);
  add_evaluate(line);
  add_inspect(line);
  add_export(line);
  add_diagnose(line);
  add_devices(line);
  add_bundle(line);
  add_update(line);
}

int run(int argc, char** argv) {
  CommandLine line;
  declare(line);
  try {
    line.app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return line.app.exit(error) == 0 ? 0 : kExitUsage;
  }
  const Result<void> done = line.run();
  if (done) return 0;
  fmt::print(stderr, "{}: {}\n", chosen_name(line.app), done.error().message);
  return kExitFailure;
}

}  // namespace
}  // namespace wagonsight

int main(int argc, char** argv) {
  // Only what a library throws by itself (no memory, mostly) arrives here.
  try {
    return wagonsight::run(argc, argv);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "wagonsight: %s\n", error.what());
    return 1;
  }
}

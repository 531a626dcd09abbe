// What the scripts of the image call to change the unit, and what the page's process speaks to.
#include <fmt/format.h>
#include <sys/random.h>
#include <CLI/CLI.hpp>

#include <cstdio>
#include <exception>
#include <functional>

#include "linux/append_file.h"
#include "serve.h"
#include "slots/updater.h"
#include "version.h"

namespace wagonsight {
namespace {

constexpr int kExitFailure = 1;
constexpr int kExitUsage = 2;

// A unit that nobody named.
std::string drawn_name() {
  std::array<std::uint8_t, 4> bytes{};
  (void)!getrandom(bytes.data(), bytes.size(), 0);
  return "unit-" + hex_text(bytes);
}

// What a unit in the state that the command needs does.
using Work = std::function<Result<void>(Updater&)>;

Result<void> provision(Updater& updater, const std::string& folder) {
  const std::string bundle = folder + "/provision.bundle";
  if (file_exists(bundle)) {
    const auto taken = updater.take_file(bundle);
    if (!taken) return tl::unexpected(taken.error());
    // Nothing runs yet, so it counts at once.
    return updater.unit().settle();
  }
  return updater.unit().take_folder(folder, drawn_name());
}

Result<void> say_state(Updater& updater) {
  fmt::print("{}", updater.call({}, {}).json);
  return {};
}

Result<void> on_trial(Updater& updater) {
  const auto is_on_trial = updater.is_on_trial();
  if (!is_on_trial) return tl::unexpected(is_on_trial.error());
  return *is_on_trial ? Result<void>{} : fail("it is not on trial");
}

Result<void> take(Updater& updater, const std::string& path) {
  const auto taken = updater.take_file(path);
  if (!taken) return tl::unexpected(taken.error());
  fmt::print("{}\n", *taken);
  return {};
}

struct Arguments {
  UnitPlaces places;
  std::string running, socket = "/run/wagonsight-update/socket", path;
  std::vector<std::string> restart;
  int group = -1;
};

void add_places(CLI::App& app, Arguments& arguments) {
  UnitPlaces& places = arguments.places;
  app.add_option("--data", places.data, "the data partition's folder")->capture_default_str();
  app.add_option("--facts", places.facts, "release, update.pub and provision.pub of the image")
      ->capture_default_str();
  app.add_option("--boot", places.boot, "the boot partition's folder; without it it is mounted");
  app.add_option("--root-a", places.root_a, "instead of the partition root-a");
  app.add_option("--root-b", places.root_b, "instead of the partition root-b");
  app.add_option("--running", arguments.running, "the slot that runs, instead of the kernel's word")
      ->check(CLI::IsMember({"a", "b"}));
  app.add_option("--daemon", places.daemon, "checks settings")->capture_default_str();
}

void add_commands(CLI::App& app, Arguments& arguments, Work& work) {
  auto* served = app.add_subcommand("serve", "answers the page until it is told to stop");
  served->add_option("--socket", arguments.socket)->capture_default_str();
  served->add_option("--group", arguments.group, "may open the socket");
  served->add_option("--restart", arguments.restart, "the program that restarts the machine")
      ->expected(-1);
  served->callback([&] {
    work = [&](Updater& u) {
      return serve(u, arguments.socket, arguments.group, arguments.restart);
    };
  });
  auto* settled = app.add_subcommand("settle", "finishes what was asked for before the restart");
  settled->callback([&] { work = [](Updater& u) { return u.unit().settle(); }; });
  auto* provisioned = app.add_subcommand(
      "provision", "takes FOLDER/provision.bundle, or FOLDER unsigned while the unit has none");
  provisioned->add_option("folder", arguments.path)->required();
  provisioned->callback([&] { work = [&](Updater& u) { return provision(u, arguments.path); }; });
  auto* good = app.add_subcommand("good", "the slot that runs is good: it stays the first");
  good->callback([&] { work = [](Updater& u) { return u.mark_good(); }; });
  auto* trial = app.add_subcommand(
      "on-trial", "succeeds when the slot that runs has not proved itself and the other one has");
  trial->callback([&] { work = on_trial; });
  auto* installed = app.add_subcommand("install", "takes a signed bundle from a file");
  installed->add_option("bundle", arguments.path)->required();
  installed->callback([&] { work = [&](Updater& u) { return take(u, arguments.path); }; });
  auto* reset = app.add_subcommand(
      "factory-reset", "at the next start, everything but name and calibration is removed");
  reset->callback([&] { work = [](Updater& u) { return u.unit().ask_for_reset(); }; });
  auto* state = app.add_subcommand("state", "tells the state as JSON");
  state->callback([&] { work = say_state; });
}

int run(int argc, char** argv) {
  CLI::App app{"wagonsight-update: updates, provisioning and factory reset of a unit.",
               "wagonsight-update"};
  Arguments arguments;
  Work work;
  app.set_version_flag("--version", fmt::format("wagonsight-update {}", kVersionText));
  app.require_subcommand(1);
  app.failure_message([](const CLI::App*, const CLI::Error& error) {
    return fmt::format("wagonsight-update: {}; see wagonsight-update --help\n", error.what());
  });
  add_places(app, arguments);
  add_commands(app, arguments, work);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : kExitUsage;
  }
  if (!arguments.running.empty()) arguments.places.running = arguments.running[0];
  const auto updater = Updater::open(arguments.places);
  const Result<void> done = updater ? work(**updater) : tl::unexpected(updater.error());
  if (done) return 0;
  fmt::print(stderr, "wagonsight-update: {}\n", done.error().message);
  return kExitFailure;
}

}  // namespace
}  // namespace wagonsight

int main(int argc, char** argv) {
  // Only what a library throws by itself (no memory, mostly) arrives here.
  try {
    return wagonsight::run(argc, argv);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "wagonsight-update: %s\n", error.what());
    return 1;
  }
}

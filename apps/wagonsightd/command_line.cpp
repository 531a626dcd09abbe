#include "command_line.h"

#include <fmt/format.h>
#include <getopt.h>

#include <array>
#include <charconv>
#include <cstdlib>

namespace wagonsight {

// getopt and not CLI11 as in the tools: eight options are not worth its 150 kB of the unit's 4 MB.
const std::string_view kHelpText =
    "wagonsightd: watches a wagon and serves its page until it is told to stop (SIGTERM).\n"
    "Usage: wagonsightd --config FILE [OPTIONS]\n\n"
    "  --config FILE     the settings (TOML)\n"
    "  --rig BLOB        a calibration blob instead of the settings'\n"
    "  --port PORT       instead of the settings'; 0: a free one\n"
    "  --state FOLDER    one that a restart of the machine clears (/run/...): there a crash is\n"
    "                    noted, so that the next run tells it\n"
    "  --updater SOCKET  that of wagonsight-update, for the page; without it, it cannot update\n"
    "  --check-config    only check the settings, and list every mistake\n"
    "  --check-files     with --check-config: also the files that they name\n"
    "  --version         name the build\n"
    "  -h, --help        this\n";

namespace {

Result<std::uint16_t> read_port(std::string_view text) {
  std::uint16_t port = 0;
  const char* end = text.data() + text.size();
  const auto read = std::from_chars(text.data(), end, port);
  if (read.ec != std::errc{} || read.ptr != end)
    return fail(fmt::format("--port {}: must be a number from 0 to 65535", text));
  return port;
}

constexpr std::array<option, 10> kOptions = {{{"config", required_argument, nullptr, 'c'},
                                              {"rig", required_argument, nullptr, 'r'},
                                              {"port", required_argument, nullptr, 'p'},
                                              {"state", required_argument, nullptr, 's'},
                                              {"updater", required_argument, nullptr, 'u'},
                                              {"check-config", no_argument, nullptr, 'k'},
                                              {"check-files", no_argument, nullptr, 'f'},
                                              {"version", no_argument, nullptr, 'v'},
                                              {"help", no_argument, nullptr, 'h'},
                                              {nullptr, 0, nullptr, 0}}};

// One option that getopt found, with its value.
Result<void> take(int found, std::string_view value, Command& command) {
  DaemonOptions& options = command.options;
  if (found == 'c') options.config = value;
  if (found == 'r') options.rig = value;
  if (found == 's') options.state_folder = value;
  if (found == 'u') options.updater = value;
  if (found == 'f') command.with_files = true;
  if (found == 'k') command.kind = Command::Kind::kCheck;
  if (found == 'p') {
    const auto port = read_port(value);
    if (!port) return tl::unexpected(port.error());
    options.port = *port;
  }
  return {};
}

}  // namespace

Result<Command> read_command(int argc, char** argv) {
  Command command;
  // systemd names its RuntimeDirectory= so.
  if (const char* folder = std::getenv("RUNTIME_DIRECTORY")) command.options.state_folder = folder;
  opterr = 0;
  optind = 0;  // from the start, whoever read options before
  for (int found = 0; (found = getopt_long(argc, argv, ":h", kOptions.data(), nullptr)) != -1;) {
    if (found == 'h' || found == 'v') {
      command.kind = found == 'h' ? Command::Kind::kHelp : Command::Kind::kVersion;
      return command;
    }
    if (found == ':') return fail(fmt::format("{}: its value is missing", argv[optind - 1]));
    if (found == '?') return fail(fmt::format("{}: there is no such option", argv[optind - 1]));
    auto taken = take(found, optarg == nullptr ? "" : optarg, command);
    if (!taken) return tl::unexpected(taken.error());
  }
  if (optind < argc) return fail(fmt::format("{}: is not understood", argv[optind]));
  if (command.options.config.empty()) return fail("--config is required");
  return command;
}

}  // namespace wagonsight

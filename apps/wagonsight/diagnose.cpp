#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <string>

#include "commands.h"
#include "files.h"
#include "loopback_http.h"
#include "zip_reader.h"

namespace wagonsight {
namespace {

using Json = nlohmann::ordered_json;

struct DiagnoseOptions {
  std::string bundle;
  std::uint16_t port = 8080;
  bool json = false;
};

// What is told: health as the unit sees it, and the last lines of its log from a bundle.
struct Findings {
  Json health, log;
};

Result<Json> parse_health(const std::string& text, const std::string& source) {
  Json health = Json::parse(text, nullptr, false);
  if (!health.is_object() || !health.contains("verdict") || !health.contains("faults") ||
      !health["faults"].is_array())
    return fail(
        fmt::format("{} tells no health that this version understands; use the wagonsight "
                    "of the unit's version",
                    source));
  return health;
}

Result<Findings> read_bundle(const std::string& path) {
  const auto file = open_input(path);
  if (!file) return tl::unexpected(file.error());
  const auto text = read_from_zip(file->bytes(), "health.json");
  if (!text) return fail(fmt::format("{} {}", path, text.error().message));
  auto health = parse_health(*text, path);
  if (!health) return tl::unexpected(health.error());
  Findings findings{std::move(*health), Json::array()};
  // The log is a help, not a must.
  if (const auto log = read_from_zip(file->bytes(), "log.json")) {
    const Json parsed = Json::parse(*log, nullptr, false);
    if (parsed.is_object() && parsed.contains("lines")) findings.log = parsed["lines"];
  }
  return findings;
}

Result<Findings> ask_daemon(std::uint16_t port) {
  const auto text = get_from_loopback(port, "/api/v1/health");
  if (!text) return tl::unexpected(text.error());
  auto health = parse_health(*text, fmt::format("127.0.0.1:{}", port));
  if (!health) return tl::unexpected(health.error());
  return Findings{std::move(*health), Json::array()};
}

std::string text_of(const Json& object, const char* key) {
  const auto found = object.find(key);
  return found != object.end() && found->is_string() ? found->get<std::string>() : std::string();
}

void print_findings(const Findings& findings) {
  const Json& faults = findings.health["faults"];
  const std::string verdict = text_of(findings.health, "verdict");
  fmt::print("{}: {}\n", verdict, text_of(findings.health, "sentence"));
  if (faults.empty()) fmt::print("No fault is known; nothing is to be done.\n");
  std::size_t number = 0;
  for (const Json& fault : faults) {
    const std::string subject = text_of(fault, "subject");
    fmt::print("{}. {}{}: {}\n   Next: {}\n", ++number, text_of(fault, "id"),
               subject.empty() ? "" : " (" + subject + ")", text_of(fault, "cause"),
               text_of(fault, "next_action"));
  }
  bool has_head = false;
  for (const Json& line : findings.log) {
    if (!line.is_object() || text_of(line, "severity") == "note") continue;
    if (!has_head) fmt::print("Warnings and errors of its log:\n");
    has_head = true;
    fmt::print("  {:.1f} s {}: {}\n", line.value("time", 0.0), text_of(line, "severity"),
               text_of(line, "text"));
  }
}

Result<void> diagnose(const DiagnoseOptions& options) {
  const auto findings =
      options.bundle.empty() ? ask_daemon(options.port) : read_bundle(options.bundle);
  if (!findings) return tl::unexpected(findings.error());
  if (options.json)
    fmt::print("{}\n", findings->health.dump(2));
  else
    print_findings(*findings);
  return {};
}

}  // namespace

void add_diagnose(CommandLine& line) {
  auto options = std::make_shared<DiagnoseOptions>();
  CLI::App* command = line.app.add_subcommand(
      "diagnose", "Name the likely faults and the next action, of this unit or of a bundle");
  command->add_option("bundle", options->bundle,
                      "diagnostics.zip of a unit; without it the wagonsightd of this computer is "
                      "asked");
  command->add_option("--port", options->port, "Port of this computer's wagonsightd")
      ->capture_default_str();
  command->add_flag("--json", options->json, "The health as JSON");
  command->callback([&line, options] { line.run = [options] { return diagnose(*options); }; });
}

}  // namespace wagonsight

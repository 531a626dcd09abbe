#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <memory>
#include <nlohmann/json.hpp>
#include <thread>

#include "commands.h"
#include "files.h"
#include "loopback_http.h"
#include "progress.h"
#include "update/bundle_check.h"
#include "update/updater_call.h"

namespace wagonsight {
namespace {

struct UpdateCommand {
  std::string bundle, unit, token_file;
  bool restart = false, reset = false;
};

constexpr std::size_t kTokenBytesMax = 1024;
constexpr int kTriesMax = 5;
constexpr auto kPause = std::chrono::milliseconds(500);

using Json = nlohmann::json;

// One question to the unit; the Error is what it answered.
class UnitLink {
 public:
  UnitLink(UnitAddress address, std::string token)
      : address_(std::move(address)), token_(std::move(token)) {}

  Result<Json> ask(const std::string& method, const std::string& path,
                   std::span<const std::byte> body = {}) {
    status_ = 0;
    const auto answer = unit_request(address_, method, path, token_, body);
    if (!answer) return tl::unexpected(answer.error());
    status_ = answer->status;
    const Json told = Json::parse(answer->body, nullptr, false);
    if (!told.is_object())
      return fail(fmt::format("{} is no wagonsight unit; give the right --to", address_.text));
    if (status_ >= 400 && status_ != 409)
      return fail(told.value("error", fmt::format("status {}", status_)));
    if (told.contains("error")) return fail(told["error"].get<std::string>());
    return told;
  }
  // The connection was lost, or the unit was busy for once.
  bool worth_another_try() const { return status_ == 0 || status_ == 503; }

 private:
  UnitAddress address_;
  std::string token_;
  int status_ = 0;
};

// From where the unit wants it: after a lost connection, or somebody's earlier try, it goes on.
// `sent_bytes` may have come although no answer said so: what it has no longer to receive, it has.
Result<std::uint64_t> where_to_begin(UnitLink& link, std::span<const std::byte> bytes,
                                     std::uint64_t sent_bytes) {
  const auto now = link.ask("GET", "/api/v1/update");
  if (!now) return tl::unexpected(now.error());
  const bool has_head = bytes.size() >= kBundleHeaderBytes;
  const std::string own =
      has_head ? hex_text({reinterpret_cast<const std::uint8_t*>(bytes.data()) + 24, 64})
               : std::string();
  if (now->value("state", "") == "receiving" && has_head && now->value("signature", "") == own)
    return now->value("received_bytes", std::uint64_t{0});
  return sent_bytes == bytes.size() ? sent_bytes : 0;
}

Result<void> send_all(UnitLink& link, std::span<const std::byte> bytes) {
  auto begin = where_to_begin(link, bytes, 0);
  if (!begin) return tl::unexpected(begin.error());
  Progress progress("bytes", bytes.size());
  int tries = 0;
  for (std::uint64_t at = *begin; at < bytes.size();) {
    const auto size = std::min<std::uint64_t>(kUpdaterBlockBytesMax, bytes.size() - at);
    const auto told = link.ask("POST", fmt::format("/api/v1/update?at={}&of={}", at, bytes.size()),
                               bytes.subspan(at, size));
    if (!told) {
      // The connection may come back, and then the unit knows how much it has.
      if (++tries == kTriesMax || !link.worth_another_try()) return tl::unexpected(told.error());
      std::this_thread::sleep_for(kPause);
      if (begin = where_to_begin(link, bytes, at + size); begin) at = *begin;
      continue;
    }
    const bool is_receiving = told->value("state", "") == "receiving";
    const std::uint64_t next = is_receiving ? told->value("received_bytes", at + size) : at + size;
    if (next > at)
      tries = 0;
    else if (++tries == kTriesMax)
      return fail("the unit wants another bundle's bytes; is somebody else updating it?");
    at = next;
    progress.update(at);
  }
  return {};
}

Result<void> wait_until_installed(UnitLink& link) {
  while (true) {
    const auto now = link.ask("GET", "/api/v1/update");
    if (!now) return tl::unexpected(now.error());
    const std::string message = now->value("message", ""), state = now->value("state", "");
    if (state == "installing") {
      std::this_thread::sleep_for(kPause);
      continue;
    }
    if (now->value("bad_news", false)) return fail(message);
    fmt::print("{}\n", message);
    return {};
  }
}

Result<void> run_command(const UpdateCommand& command) {
  const auto address = parse_unit_address(command.unit);
  if (!address) return tl::unexpected(address.error());
  auto token = read_file(command.token_file, kTokenBytesMax);
  if (!token) return tl::unexpected(token.error());
  while (!token->empty() && (token->back() == '\n' || token->back() == '\r')) token->pop_back();
  UnitLink link(*address, *token);
  Result<void> done;
  if (!command.bundle.empty()) {
    const auto file = open_input(command.bundle);
    if (!file) return tl::unexpected(file.error());
    done = send_all(link, file->bytes());
    if (done) done = wait_until_installed(link);
  }
  const auto ask = [&](const char* path, const char* said) {
    if (!done) return;
    const auto told = link.ask("POST", path);
    if (told)
      fmt::print("{}\n", said);
    else
      done = tl::unexpected(told.error());
  };
  if (command.reset)
    ask("/api/v1/factory-reset", "With the next restart only name and calibration are left.");
  if (command.restart) ask("/api/v1/restart", "The unit restarts.");
  return done;
}

}  // namespace

void add_update(CommandLine& line) {
  auto options = std::make_shared<UpdateCommand>();
  CLI::App* command = line.app.add_subcommand(
      "update", "Send a signed bundle to a unit; what was sent before is not sent again");
  auto* bundle = command->add_option("bundle", options->bundle, "An update, or its provisioning");
  command->add_option("--to", options->unit, "The unit's numeric address, as 10.1.2.3:8080")
      ->required();
  command->add_option("--token-file", options->token_file, "Holds the unit's admin token")
      ->required();
  auto* restart = command->add_flag("--restart", options->restart, "Then restart the unit");
  auto* reset = command->add_flag("--factory-reset", options->reset,
                                  "At its next start, all but its name and calibration goes");
  reset->excludes(bundle);
  command->callback([&line, options, bundle, restart, reset] {
    if (bundle->count() + restart->count() + reset->count() == 0)
      throw CLI::RequiredError("a bundle, --restart or --factory-reset");
    line.run = [options] { return run_command(*options); };
  });
}

}  // namespace wagonsight

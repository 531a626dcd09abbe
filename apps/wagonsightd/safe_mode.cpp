#include "safe_mode.h"

#include <fmt/format.h>
#include <unistd.h>

#include <cstdio>
#include <memory>

#include "http/server.h"
#include "linux/clocks.h"
#include "publisher.h"
#include "shared_block.h"
#include "unit.h"
#include "version.h"
#include "web_supervisor.h"

namespace wagonsight {
namespace {

constexpr Duration kPeriod = std::chrono::milliseconds(200);

double seconds() {
  return to_seconds(host_now().time_since_epoch());
}

// All there is to publish: that this process lives.
void tell_time(Snapshot& snapshot, HostTime start, SharedBlock& block) {
  ++snapshot.sequence;
  snapshot.time = to_seconds(host_now() - start);
  snapshot.monotonic_time = seconds();
  const WallTime wall = wall_now();
  snapshot.unix_time = wall.synchronised ? wall.unix_s : 0;
  block.snapshot.store(snapshot);
}

}  // namespace

LastCrash last_crash(const PreviousCrash& previous) {
  return {previous.present, previous.age_s, previous.unix_time, previous.recent,
          std::string_view(previous.reason)};
}

Result<void> run_safe_mode(const DaemonOptions& options, const StopSignals& signals, Vigil& vigil) {
  const HostTime start = host_now();
  const auto info = std::make_unique<UnitInfo>();
  info->version = kVersionText;
  info->safe_mode = true;
  info->last_crash = last_crash(vigil.previous());
  WebSettings web;
  std::string text;
  if (const auto settings = read_settings(options.config, &text)) {
    web = settings->web;
    info->name = settings->unit.name;
    info->settings = std::string_view(text);
  }
  const auto access = access_rules(web);
  if (!access) return tl::unexpected(access.error());
  const auto listening = listen_on(web.host, options.port.value_or(web.port));
  if (!listening) return tl::unexpected(listening.error());
  auto shared = SharedBlockWriter::create(*info);
  if (!shared) return tl::unexpected(shared.error());

  UnitLog log(shared->block(), start);
  const auto say = [&](std::string_view words) { log.say(Severity::kWarning, words); };
  log.say(Severity::kError,
          fmt::format("Crashed {} times within three minutes, the last time: {}; only the page is "
                      "served for {} minutes.",
                      info->last_crash.recent, info->last_crash.reason.view(),
                      std::chrono::duration_cast<std::chrono::minutes>(kSafeModeMax).count()));
  const auto snapshot = std::make_unique<Snapshot>();
  tell_time(*snapshot, start, shared->block());
  // An update may be what mends it.
  WebSupervisor page(shared->fd(), listening->fd, *access, say, {}, options.updater);
  if (const auto started = page.start(seconds()); !started) say(started.error().message);
  fmt::print("http://{}:{}/\n", web.host, listening->port);
  std::fflush(stdout);
  vigil.ready("safe mode: only the page is served");
  while (!signals.wait(kPeriod) && host_now() - start < kSafeModeMax) {
    tell_time(*snapshot, start, shared->block());
    page.tick(seconds());
    vigil.tick(seconds(), snapshot->unix_time, say);
  }
  close(listening->fd);
  return {};
}

}  // namespace wagonsight

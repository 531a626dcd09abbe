#pragma once

#include <cstdint>

#include "status/access.h"

// The web side: a second process of the same program, without privileges, that reads the shared
// block and serves the page. It owns nothing that a frame needs.
namespace wagonsight {

// Descriptors that the daemon gives to its web side, and the argument that makes a process one.
inline constexpr int kWebBlockFd = 3;    // the shared block
inline constexpr int kWebLinkFd = 4;     // a socket to the daemon
inline constexpr int kWebListenFd = 5;   // listens already, so no start loses a connection
inline constexpr int kWebUpdaterFd = 6;  // a socket to the updater; not open where there is none
inline constexpr const char* kWebSideArgument = "--web-side";

// The first message of the daemon on the link. Secrets come this way, never by command line,
// environment or the block.
struct WebGreeting {
  std::int64_t daemon_pid = 0;
  AccessRules access;
};

// What the web side says on the link: that its loop turns, or what somebody who may asked for.
struct WebMessage {
  std::uint8_t kind = 0;  // 0: it lives; otherwise a UnitCommand's
  std::uint8_t reserved = 0;
  std::uint16_t minutes = 0;
};
static_assert(sizeof(WebMessage) == 4);
// How often it says that it lives.
inline constexpr double kHeartbeatPeriodS = 0.5;

// Runs until the daemon goes. Returns the exit status.
int run_web_side();

}  // namespace wagonsight

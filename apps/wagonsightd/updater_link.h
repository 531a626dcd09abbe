#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "update/updater_call.h"

namespace wagonsight {

// The web side's end of the socket to the updater, which the daemon opened.
class UpdaterLink {
 public:
  explicit UpdaterLink(int fd);  // the caller's; where it is not open, there is no updater

  struct Told {
    int status = 200;
    std::string json;
  };
  // Waits for two seconds at most. Nothing: there is no updater.
  std::optional<Told> ask(const UpdaterCall& call, std::string_view block);

  // There was one, and it went or did not answer in time, so that answers would no longer fit.
  bool is_lost() const { return is_lost_; }

 private:
  int fd_;
  bool is_lost_ = false;
};

// The daemon's part: a socket to the updater at `path`; -1 when nobody listens there.
int connect_updater(const std::string& path);

}  // namespace wagonsight

#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace wagonsight {

// Sees whether every stage of the unit goes on: each has a counter that rises while its thread
// turns. The service manager hears that the unit is alive only while none stands still.
class StageWatch {
 public:
  // A stage that may stand still for `silence_max_s`; gives its index.
  std::size_t add(std::string_view name, double silence_max_s, double now_s);
  void see(std::size_t stage, std::uint64_t turns, double now_s);
  // No longer expected to go on.
  void dismiss(std::size_t stage);

  // The stage that has stood still for longest beyond its limit; nullptr: all go on.
  const std::string* stuck(double now_s) const;

 private:
  struct Stage {
    std::string name;
    double silence_max_s = 0;
    std::uint64_t turns = 0;
    double turned_s = 0;
    bool expected = true;
  };
  std::vector<Stage> stages_;
};

}  // namespace wagonsight

#include "stage_watch.h"

namespace wagonsight {

std::size_t StageWatch::add(std::string_view name, double silence_max_s, double now_s) {
  stages_.push_back({std::string(name), silence_max_s, 0, now_s, true});
  return stages_.size() - 1;
}

void StageWatch::see(std::size_t stage, std::uint64_t turns, double now_s) {
  Stage& seen = stages_[stage];
  if (turns == seen.turns) return;
  seen.turns = turns;
  seen.turned_s = now_s;
}

void StageWatch::dismiss(std::size_t stage) {
  stages_[stage].expected = false;
}

const std::string* StageWatch::stuck(double now_s) const {
  const std::string* longest = nullptr;
  double over_s = 0;
  for (const Stage& stage : stages_) {
    const double over = now_s - stage.turned_s - stage.silence_max_s;
    if (!stage.expected || over <= over_s) continue;
    over_s = over;
    longest = &stage.name;
  }
  return longest;
}

}  // namespace wagonsight

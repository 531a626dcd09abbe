#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "base/time.h"
#include "pipeline/pipeline.h"

namespace wagonsight {

// What a replay cost: per stage and as a whole, as a JSON object. Milliseconds of wall clock for
// the stages and of this thread's processor time for the whole.
class StageTimings {
 public:
  // Monotonic wall clock, for Pipeline::set_ticker.
  static Duration now();
  // Processor time this thread has used.
  static Duration thread_time();

  void add(const std::array<Duration, kStageCount>& stages, Duration processor);
  // From when the last of an instant's frames was there until its people were told; of a replay in
  // real time. While the background is learned it is apart: nobody is told then.
  void add_latency(Duration latency, bool learning) {
    (learning ? learning_latency_ms_ : latency_ms_).push_back(to_milliseconds(latency));
  }
  void add_matched_share(double share) { matched_share_.push_back(share); }
  // `recorded` is how long the recording lasts.
  std::string to_json(Duration recorded) const;

 private:
  std::array<std::vector<double>, kStageCount> stages_ms_;
  std::vector<double> processor_ms_;
  std::vector<double> latency_ms_, learning_latency_ms_;
  std::vector<double> matched_share_;  // of stereo images
};

}  // namespace wagonsight

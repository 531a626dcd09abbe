#pragma once

#include <array>
#include <memory>

#include "base/result.h"
#include "capture/frame_grouping.h"
#include "frame/frame.h"
#include "recording/recording_reader.h"

namespace wagonsight {

// The FrameSets of a recording, one after the other. A recording of one sensor gives exactly one
// for each of its frames; those of several are grouped as they are live.
class FrameSetSource {
 public:
  // `reader` must outlive this; `rig` is the one to replay with (its sensors are the reader's).
  // `options` say how several sensors are grouped.
  FrameSetSource(RecordingReader& reader, const Rig& rig, const FrameSetOptions& options);

  // False at the end. What a set points to stays until the next call.
  Result<bool> next(FrameSet& set);
  void rewind();

 private:
  Result<bool> next_of_one(FrameSet& set);
  Result<bool> next_of_many(FrameSet& set);

  RecordingReader& reader_;
  std::array<double, kSensorsMax> rates_hz_{};
  FrameSetOptions options_;
  std::size_t sensor_count_;
  FramePool pool_;
  std::unique_ptr<FrameGrouping> grouping_;  // of several sensors
  FrameSlot* slot_ = nullptr;                // of one sensor
  FrameSlot* arriving_ = nullptr;            // read, but older sets must be taken first
  HostTime now_{};
  bool at_end_ = false;
  std::uint64_t index_ = 0;
};

}  // namespace wagonsight

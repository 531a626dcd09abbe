#pragma once

#include <cstdint>
#include <vector>

#include "base/result.h"
#include "frame/image.h"
#include "recording/recording_reader.h"

namespace wagonsight {

// Some depth images of one sensor.
struct SampleImages {
  int width = 0, height = 0;
  std::vector<std::vector<std::uint16_t>> pixels;

  std::vector<DepthImage> views() const;  // into `pixels`
};

// Frames of all sensors together; reads the recording through where it has no summary, and rewinds
// it. The Error is that of RecordingReader::next.
Result<std::uint64_t> count_frames(RecordingReader& reader);

// About a dozen images of the first sensor, spread over the recording, which is rewound. Allocates;
// for looking at a recording before it is replayed.
Result<SampleImages> sample_images(RecordingReader& reader);

}  // namespace wagonsight

#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "frame/image.h"
#include "rig/ray_table.h"
#include "rig/rig.h"
#include "wagon/wagon.h"

namespace wagonsight::bench {

using Frame = std::vector<std::uint16_t>;

// Depth images of one sensor: some of the empty room, and those that are measured.
struct BenchScene {
  std::string name;
  RigSensor sensor;
  Wagon wagon;
  std::vector<PixelRay> rays;
  std::vector<Frame> background;
  std::vector<Frame> frames;

  DepthImage view(const Frame& frame) const {
    return {frame.data(), sensor.camera.width, sensor.camera.height};
  }
};

// Names of what is there to measure: "synthetic" always; "depth_queue" and "five_people" where
// ../shared is.
std::vector<std::string> scene_names();
// Made when it is first asked for.
const BenchScene& scene_of(const std::string& name);

}  // namespace wagonsight::bench

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "foreground/extractor.h"
#include "support/depth_png.h"
#include "wagon/floor.h"

// Over recordings of real rooms, where they are on this machine.
namespace wagonsight {
namespace {

struct Recording {
  std::vector<std::vector<std::uint16_t>> images;
  RigSensor sensor;
  Wagon wagon;
  std::vector<PixelRay> rays;
  static constexpr double kRate_hz = 4;

  explicit Recording(const std::string& name)
      : images(testing_support::read_depth_folder(WAGONSIGHT_SOURCE_DIR "/../shared/data/" + name +
                                                  "/depth")) {
    if (images.empty()) return;
    sensor.name = "depth";
    sensor.camera = {
        640, 480, 567.9, 568.86, 311.12, 241.57, {0.0016, 0.0477, -0.0012, -0.0012, -0.2943}};
    sensor.trim_far = 7;
    rays = make_ray_table(sensor.camera);
    std::vector<Eigen::Vector3f> points;
    for (std::size_t frame = 0; frame < images.size(); frame += images.size() / 6) {
      for (std::size_t i = 0; i < images[frame].size(); i += 9) {
        const float z = static_cast<float>(images[frame][i]) * 0.001F;
        if (z < 0.4F || z > 7 || rays[i].x == kNoRay) continue;
        points.emplace_back(static_cast<float>(rays[i].x) * kRayScale * z,
                            static_cast<float>(rays[i].y) * kRayScale * z, z);
      }
    }
    const auto floor = find_floor(points);
    if (!floor) return;
    sensor.X_WS = floor->X_WS;
    for (auto& p : points) p = (sensor.X_WS * p.cast<double>()).cast<float>();
    wagon.inside = find_inside(points);
  }
  DepthImage image(std::size_t i) const { return {images[i].data(), 640, 480}; }
  static HostTime time(std::size_t i) {
    return HostTime{} + from_seconds(static_cast<double>(i) / kRate_hz);
  }
  // The area of all blobs that are large enough to be taken for somebody.
  std::vector<double> areas(bool whole) const {
    auto extractor = ForegroundExtractor::create(sensor, rays, wagon, {});
    EXPECT_TRUE(extractor.has_value());
    if (whole) {
      for (std::size_t i = 0; i < images.size(); ++i) (*extractor)->learn(image(i), time(i));
      (*extractor)->finish_learning();
    }
    Foreground foreground(640 * 480);
    std::vector<double> result;
    for (std::size_t i = 0; i < images.size(); ++i) {
      (*extractor)->extract(image(i), time(i), foreground);
      double sum = 0;
      for (const Blob& blob : foreground.blobs) {
        if (blob.area_m2 > 0.12F) sum += static_cast<double>(blob.area_m2);
      }
      result.push_back(sum);
    }
    return result;
  }
};

class OnRecordings : public testing::TestWithParam<bool> {};

TEST_P(OnRecordings, EmptyFramesOfTheQueueAreEmpty) {
  const Recording recording("depth_queue");
  if (recording.images.empty()) GTEST_SKIP() << "depth_queue is not on this machine";
  const auto areas = recording.areas(GetParam());
  for (std::size_t i = 0; i < areas.size(); ++i) {
    const std::size_t frame = i + 1;  // as in the labels
    if (frame <= 26 || frame >= 103) {
      EXPECT_EQ(areas[i], 0) << "frame " << frame;
    } else if (frame >= 28 && frame <= 99) {
      EXPECT_GT(areas[i], 0.12) << "frame " << frame;
    }
  }
}

TEST_P(OnRecordings, TheWalkerIsThereWithoutAnyEmptyFrame) {
  const Recording recording("depth_walker");
  if (recording.images.empty()) GTEST_SKIP() << "depth_walker is not on this machine";
  const auto areas = recording.areas(GetParam());
  // As it goes, two frames are needed to know that somebody moves. From frame 32 on he leaves.
  for (std::size_t i = GetParam() ? 0 : 2; i < 31; ++i) {
    EXPECT_GT(areas[i], 0.15) << "frame " << i + 1;
    EXPECT_LT(areas[i], 0.95) << "frame " << i + 1;
  }
}

INSTANTIATE_TEST_SUITE_P(CausalAndWhole, OnRecordings, testing::Bool(),
                         testing::PrintToStringParamName());

}  // namespace
}  // namespace wagonsight

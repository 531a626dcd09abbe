#include "bench/scenes.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>

#include "base/check.h"
#include "support/depth_png.h"
#include "support/pcd_points.h"
#include "support/rendered_room.h"
#include "wagon/floor.h"

namespace wagonsight::bench {
namespace {

using testing_support::RenderedRoom;

constexpr const char* kData = WAGONSIGHT_SOURCE_DIR "/../shared/data/";

BenchScene synthetic() {
  RenderedRoom room(1.0);
  BenchScene scene{"synthetic", room.sensor, room.wagon, room.rays, {}, {}};
  for (int i = 0; i < 20; ++i) scene.background.push_back(room.render({}, i));
  for (int i = 0; i < 20; ++i) {
    scene.frames.push_back(room.render(
        {RenderedRoom::somebody_at(1.5 + 0.03 * i, 1.7),
         RenderedRoom::somebody_at(4.5 - 0.03 * i, 1.2), RenderedRoom::somebody_at(3.0, 2.2)},
        100 + i));
  }
  return scene;
}

// Poses the sensor on the floor that it sees, and takes what it sees for the room.
void place(BenchScene& scene, const std::vector<Frame>& frames) {
  scene.rays = make_ray_table(scene.sensor.camera);
  std::vector<Eigen::Vector3f> points;
  for (const Frame& frame : frames) {
    for (std::size_t i = 0; i < frame.size(); i += 11) {
      const float z = static_cast<float>(frame[i]) * 0.001F;
      if (z < 0.4F || z > 7 || scene.rays[i].x == kNoRay) continue;
      points.emplace_back(static_cast<float>(scene.rays[i].x) * kRayScale * z,
                          static_cast<float>(scene.rays[i].y) * kRayScale * z, z);
    }
  }
  const auto floor = find_floor(points);
  WS_CHECK(floor.has_value(), "no floor in %s", scene.name.c_str());
  scene.sensor.X_WS = floor->X_WS;
  for (auto& p : points) p = (floor->X_WS * p.cast<double>()).cast<float>();
  scene.wagon.inside = find_inside(points);
}

BenchScene depth_queue() {
  BenchScene scene;
  scene.name = "depth_queue";
  const auto images = testing_support::read_depth_folder(std::string(kData) + "depth_queue/depth");
  WS_CHECK(images.size() > 100, "%zu images in depth_queue", images.size());
  scene.sensor.name = "depth";
  scene.sensor.camera = {640,
                         480,
                         567.8956,
                         568.8557,
                         311.1240,
                         241.5695,
                         {0.00160, 0.04771, -0.00118, -0.00117, -0.29431}};
  scene.sensor.trim_far = 7;
  scene.background.assign(images.begin() + 7, images.begin() + 26);  // the empty frames 8 to 26
  scene.frames.assign(images.begin() + 30, images.begin() + 100);
  place(scene, scene.background);
  return scene;
}

// One organised cloud; noise makes frames of it. The room without people is the cloud without what
// stands on the floor in its middle: crude, but the same for everybody who is measured.
BenchScene five_people() {
  const auto cloud = testing_support::read_pcd(std::string(kData) + "five_people/five_people.pcd");
  WS_CHECK(cloud.size() == std::size_t{640} * 480, "%zu points", cloud.size());
  BenchScene scene;
  scene.name = "five_people";
  scene.sensor.name = "kinect";
  scene.sensor.camera = {640, 480, 525, 525, 319.5, 239.5, {}};
  scene.sensor.trim_far = 7;
  Frame full(cloud.size()), empty(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Eigen::Vector3f& p = cloud[i];
    if (!p.allFinite() || p.z() > 9) continue;
    full[i] = static_cast<std::uint16_t>(std::lround(p.z() * 1000));
    const float height = 1.26614F - p.dot(Eigen::Vector3f(-0.0103586F, 0.997011F, 0.0765573F));
    const bool person = height > 0.12F && height < 2.2F && p.z() < 5.5F && std::abs(p.x()) < 2.5F;
    if (!person) empty[i] = full[i];
  }
  const auto noisy = [&](const Frame& frame, std::uint64_t number) {
    Frame result = frame;
    for (std::size_t i = 0; i < frame.size(); ++i) {
      if (frame[i] == 0) continue;
      const double steps = 1000.0 / (scene.sensor.noise.quantisation_per_z2 * frame[i]);
      const double off = 1.2 * (testing_support::hash_noise(number, i) - 0.5);
      result[i] = static_cast<std::uint16_t>(
          1000.0 / (scene.sensor.noise.quantisation_per_z2 * std::round(steps + off)));
    }
    return result;
  };
  for (std::uint64_t i = 0; i < 15; ++i) scene.background.push_back(noisy(empty, i));
  for (std::uint64_t i = 0; i < 20; ++i) scene.frames.push_back(noisy(full, 100 + i));
  place(scene, {full});
  return scene;
}

}  // namespace

std::vector<std::string> scene_names() {
  std::vector<std::string> names{"synthetic"};
  for (const char* name : {"depth_queue", "five_people"}) {
    if (std::filesystem::is_directory(std::string(kData) + name)) names.emplace_back(name);
  }
  return names;
}

const BenchScene& scene_of(const std::string& name) {
  static std::map<std::string, BenchScene> made;
  const auto known = made.find(name);
  if (known != made.end()) return known->second;
  return made[name] = name == "depth_queue"   ? depth_queue()
                      : name == "five_people" ? five_people()
                                              : synthetic();
}

}  // namespace wagonsight::bench

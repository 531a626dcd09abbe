#include "simulate/room.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/check.h"
#include "geometry/angles.h"
#include "rig/stereo_pair.h"
#include "simulate/random.h"

namespace wagonsight {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kThick = 0.1;      // of walls, floor and ceiling
constexpr double kPlatform = 2.5;   // how far the ground goes on outside of a doorway
constexpr double kWallGrip = 0.35;  // a door within this distance of a wall is a door of that wall

float albedo_of(Material material) {
  switch (material) {
    case Material::kPlain:
      return 0.45F;
    case Material::kDark:
      return 0.006F;
    case Material::kMetal:
      return 0.3F;
    case Material::kGlass:
      return 0.02F;
    case Material::kScreen:
      return 0.08F;
  }
  return 0.45F;
}

void add_box(const Vector3d& min, const Vector3d& max, Material material,
             std::vector<RoomPart>& parts, Surface surface = Surface::kFurniture) {
  parts.push_back({box_part(min, max, albedo_of(material)), material, surface});
}

// The wall along one side, cut where doors are. `axis` is the horizontal axis it runs along.
void add_wall(const Scene& scene, int axis, bool far_side, std::vector<RoomPart>& parts) {
  const double length = axis == 0 ? scene.length : scene.width;
  const double depth = axis == 0 ? scene.width : scene.length;
  const double low = far_side ? depth : -kThick, high = far_side ? depth + kThick : 0;
  const auto piece = [&](double from, double to, double z_from, double z_to) {
    if (to - from < 1e-6 || z_to - z_from < 1e-6) return;
    Vector3d min, max;
    min[axis] = from, max[axis] = to;
    min[1 - axis] = low, max[1 - axis] = high;
    min.z() = z_from, max.z() = z_to;
    add_box(min, max, Material::kPlain, parts, Surface::kWall);
  };
  std::vector<std::pair<double, double>> gaps;
  for (const SceneDoor& door : scene.doors) {
    const Doorway way = doorway_of(scene, door);
    if (std::abs(way.along[axis]) < 0.7) continue;
    if ((way.inward[1 - axis] < 0) != far_side) continue;
    gaps.emplace_back(std::min(door.from[axis], door.to[axis]),
                      std::max(door.from[axis], door.to[axis]));
  }
  std::sort(gaps.begin(), gaps.end());
  double at = -kThick;
  const double top = std::min(kDoorHeight, scene.height);
  for (const auto& [from, to] : gaps) {
    piece(at, from, 0, scene.height);
    piece(std::max(at, from), to, top, scene.height);
    at = std::max(at, to);
  }
  piece(at, length + kThick, 0, scene.height);
}

void add_seat(const SceneSeat& seat, std::vector<RoomPart>& parts) {
  const Eigen::Matrix3d yaw = Eigen::AngleAxisd(seat.yaw, Vector3d::UnitZ()).toRotationMatrix();
  const Vector3d at(seat.position.x(), seat.position.y(), 0);
  const auto add = [&](const Vector3d& min, const Vector3d& max) {
    RoomPart part{box_part(min, max, 0.3F), Material::kPlain, Surface::kSeat};
    part.part.centre = at + yaw * part.part.centre;
    part.part.axes = yaw;
    parts.push_back(part);
  };
  const double half = 0.5 * seat.width - 0.01;
  add({-0.5 * kSeatDepth, -half, kSeatHeight - 0.09}, {0.5 * kSeatDepth, half, kSeatHeight});
  add({-0.5 * kSeatDepth + 0.08, -0.6 * half, 0},
      {0.5 * kSeatDepth - 0.18, 0.6 * half, kSeatHeight - 0.09});
  add({-0.5 * kSeatDepth - 0.08, -half, kSeatHeight - 0.09},
      {-0.5 * kSeatDepth, half, kBackrestHeight});
}

// A pane that hangs on a wall (or lies within it) shows 5 mm of itself to the inside.
SceneBox shown(const Scene& scene, SceneBox pane) {
  const Vector3d room(scene.length, scene.width, scene.height);
  constexpr double kGrip = 0.15, kProud = 0.005;
  for (int axis = 0; axis < 3; ++axis) {
    if (pane.max[axis] < kProud && pane.max[axis] > -kGrip) pane.max[axis] = kProud;
    if (pane.min[axis] > room[axis] - kProud && pane.min[axis] < room[axis] + kGrip)
      pane.min[axis] = room[axis] - kProud;
  }
  return pane;
}

// What calibration would say of a stereo camera: the model of stereo's noise, and trims between 64
// disparities and where a decimetre drowns in it.
void describe_stereo(std::size_t sensor, RigSensor& told) {
  constexpr double kDisparitySigma_px = 0.25, kDisparitySteps = 64;
  told.stereo = stereo_imagers(sensor);
  const auto pair = rectified_pair(told.stereo.left, told.stereo.right, told.stereo.X_LR);
  WS_CHECK(pair.has_value(), "%s", "simulated imagers cannot be rectified");
  told.camera = pair->camera;
  told.stereo.baseline = pair->baseline;
  const double disparity_at_1m = pair->camera.fx * pair->baseline;
  told.noise.c = kDisparitySigma_px / disparity_at_1m;
  told.noise.quantisation_per_z2 = 1 / (disparity_at_1m * kDisparitySteps);
  told.trim_near = 0.7;
  told.trim_far = 4.5;
}

}  // namespace

Doorway doorway_of(const Scene& scene, const SceneDoor& door) {
  Doorway way;
  way.middle = 0.5 * (door.from + door.to);
  way.width = (door.to - door.from).norm();
  way.along = (door.to - door.from) / way.width;
  const std::array<double, 4> gaps{way.middle.y(), scene.width - way.middle.y(), way.middle.x(),
                                   scene.length - way.middle.x()};
  const std::array<Vector2d, 4> inwards{Vector2d(0, 1), Vector2d(0, -1), Vector2d(1, 0),
                                        Vector2d(-1, 0)};
  const auto nearest = std::min_element(gaps.begin(), gaps.end()) - gaps.begin();
  way.inward = inwards[static_cast<std::size_t>(nearest)];
  // A threshold across the wagon's inner space leads away from the nearer end.
  if (gaps[static_cast<std::size_t>(nearest)] > kWallGrip) {
    way.inward = {-way.along.y(), way.along.x()};
    const Vector2d centre(0.5 * scene.length, 0.5 * scene.width);
    if (way.inward.dot(centre - way.middle) < 0) way.inward = -way.inward;
  }
  return way;
}

void place_door_leaves(const Doorway& way, double open, FixedVector<Part, 40>& parts) {
  const double half = 0.25 * way.width;  // of one leaf
  for (const double side : {-1.0, 1.0}) {
    const Vector2d middle =
        way.middle + side * (half + open * (2 * half - 0.02)) * way.along - 0.06 * way.inward;
    Part leaf;
    leaf.shape = Part::Shape::kBox;
    leaf.centre = {middle.x(), middle.y(), 0.5 * kDoorHeight};
    leaf.axes.col(0) = Vector3d(way.along.x(), way.along.y(), 0);
    leaf.axes.col(1) = Vector3d(way.inward.x(), way.inward.y(), 0);
    leaf.half = {half, 0.02, 0.5 * kDoorHeight};
    leaf.albedo = 0.4F;
    parts.push_back(leaf);
  }
}

std::vector<RoomPart> room_of(const Scene& scene) {
  std::vector<RoomPart> parts;
  const double l = scene.length, w = scene.width, h = scene.height;
  add_box({-kThick, -kThick, -kThick}, {l + kThick, w + kThick, 0}, Material::kPlain, parts,
          Surface::kFloor);
  add_box({-kThick, -kThick, h}, {l + kThick, w + kThick, h + kThick}, Material::kPlain, parts,
          Surface::kCeiling);
  for (const int axis : {0, 1})
    for (const bool far_side : {false, true}) add_wall(scene, axis, far_side, parts);
  for (const SceneDoor& door : scene.doors) {
    const Doorway way = doorway_of(scene, door);
    const Vector2d a = way.middle - way.along * (0.5 * way.width + 1) - way.inward * kThick;
    const Vector2d b = way.middle + way.along * (0.5 * way.width + 1) - way.inward * kPlatform;
    add_box({std::min(a.x(), b.x()), std::min(a.y(), b.y()), -kThick},
            {std::max(a.x(), b.x()), std::max(a.y(), b.y()), 0}, Material::kPlain, parts,
            Surface::kGround);
  }
  for (const SceneSeat& seat : scene.seats) add_seat(seat, parts);
  for (const SceneBox& box : scene.boxes) add_box(box.min, box.max, box.material, parts);
  for (const SceneBox& window : scene.windows) {
    const SceneBox pane = shown(scene, window);
    add_box(pane.min, pane.max, Material::kGlass, parts);
  }
  for (const SceneBox& screen : scene.screens) {
    const SceneBox pane = shown(scene, screen);
    add_box(pane.min, pane.max, Material::kScreen, parts);
  }
  return parts;
}

Wagon wagon_of(const Scene& scene) {
  constexpr double kSkirt = 0.04;
  Wagon wagon;
  wagon.inside.min = {kSkirt, kSkirt, 0};
  wagon.inside.max = {scene.length - kSkirt, scene.width - kSkirt, scene.height - kSkirt};
  const auto as_array = [](const Vector2d& p) { return std::array<double, 2>{p.x(), p.y()}; };
  for (const SceneZone& zone : scene.zones) {
    Zone told;
    told.name.assign(zone.name);
    told.capacity = zone.capacity;
    for (const Vector2d& corner : zone.polygon) told.polygon.push_back(as_array(corner));
    wagon.zones.push_back(told);
  }
  for (const SceneSeat& seat : scene.seats) {
    Seat told;
    told.name.assign(seat.name);
    told.position = as_array(seat.position);
    told.yaw = seat.yaw;
    told.width = seat.width;
    wagon.seats.push_back(told);
  }
  for (const SceneDoor& door : scene.doors)
    wagon.doors.push_back({Name(door.name), as_array(door.from), as_array(door.to)});
  for (const auto* panes : {&scene.windows, &scene.screens}) {
    for (const SceneBox& pane : *panes) {
      const SceneBox seen = shown(scene, pane);
      constexpr double kAround = 0.03;  // depth on a pane is wrong by a few quantisation steps
      MaskVolume mask;
      mask.name.assign(pane.name);
      mask.bounds.min = seen.min.array() - kAround;
      mask.bounds.max = seen.max.array() + kAround;
      wagon.masks.push_back(mask);
    }
  }
  return wagon;
}

Camera kinect_camera() {
  Camera camera;
  camera.width = 640;
  camera.height = 480;
  camera.fx = camera.fy = 580;
  camera.cx = 319.5;
  camera.cy = 239.5;
  return camera;
}

StereoGeometry stereo_imagers(std::size_t sensor) {
  constexpr double kBaseline = 0.08;
  std::uint64_t counter = 0;
  const auto about = [&](double middle, double spread) {
    return middle + spread * (2 * uniform(mixed(0x57E5E0, sensor, counter++)) - 1);
  };
  StereoGeometry imagers;
  for (Camera* camera : {&imagers.left, &imagers.right}) {
    camera->width = 769;
    camera->height = 448;
    camera->fx = camera->fy = about(520, 3);
    camera->cx = about(384, 4);
    camera->cy = about(223.5, 4);
  }
  const double turn = 0.4 * std::numbers::pi / 180;
  imagers.X_LR.rotation = Eigen::AngleAxisd(about(0, turn), Vector3d::UnitX()) *
                          Eigen::AngleAxisd(about(0, turn), Vector3d::UnitY()) *
                          Eigen::AngleAxisd(about(0, turn), Vector3d::UnitZ());
  imagers.X_LR.position = {kBaseline, about(0, 0.0005), about(0, 0.0005)};
  imagers.baseline = imagers.X_LR.position.norm();
  return imagers;
}

Rig rig_of(const Scene& scene) {
  Rig rig;
  for (std::size_t i = 0; i < scene.sensors.size(); ++i) {
    const SceneSensor& sensor = scene.sensors[i];
    RigSensor told;
    told.name.assign(sensor.name);
    told.kind = sensor.kind;
    told.camera = kinect_camera();
    told.rate_hz = sensor.rate_hz;
    if (sensor.kind == SensorKind::kStereo) describe_stereo(i, told);
    told.X_WS = {look_at(sensor.position, sensor.look_at), sensor.position};
    told.X_BS = told.X_WS;
    told.rms_px = 0;
    rig.sensors.push_back(told);
  }
  rig.georeference.present = true;
  rig.provenance.made_by = "wagonsight simulate";
  rig.provenance.note = "true calibration of a simulated scene";
  return rig;
}

Rig perturbed(Rig rig, double position_sigma, double rotation_sigma, std::uint64_t seed) {
  std::uint64_t counter = 0;
  const auto normal = [&] {  // the sum of twelve uniform numbers has variance 1
    double sum = -6;
    for (int i = 0; i < 12; ++i) sum += uniform(mixed(seed, 0x50FA, counter++));
    return sum;
  };
  for (RigSensor& sensor : rig.sensors) {
    Vector3d turn, shift;
    for (int i = 0; i < 3; ++i) turn[i] = rotation_sigma * normal();
    for (int i = 0; i < 3; ++i) shift[i] = position_sigma * normal();
    const double angle = turn.norm();
    if (angle > 0)
      sensor.X_WS.rotation =
          Eigen::Quaterniond(Eigen::AngleAxisd(angle, turn / angle)) * sensor.X_WS.rotation;
    sensor.X_WS.position += shift;
    sensor.X_BS = sensor.X_WS;
    for (int i = 0; i < 3; ++i) {
      sensor.covariance(i, i) = rotation_sigma * rotation_sigma;
      sensor.covariance(i + 3, i + 3) = position_sigma * position_sigma;
    }
  }
  rig.provenance.note = "perturbed calibration of a simulated scene";
  return rig;
}

}  // namespace wagonsight

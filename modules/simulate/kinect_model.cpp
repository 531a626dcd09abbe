#include "simulate/kinect_model.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "geometry/angles.h"
#include "simulate/random.h"

namespace wagonsight {
namespace {

using Eigen::Vector3d;

constexpr double kNearest = 0.5, kFarthest = 9.0;  // metres a Kinect reads
constexpr int kBlindColumns = 8;                   // at the right border, for want of a window

const SceneLight& light_at(const Scene& scene, std::size_t index) {
  static const SceneLight kDaylight{};
  return index == 0 ? kDaylight : scene.lights[index - 1];
}

// 0: before the first [[light]]; otherwise its index + 1.
std::size_t light_index_at(const Scene& scene, double seconds) {
  std::size_t index = 0;
  while (index < scene.lights.size() && scene.lights[index].at <= seconds) ++index;
  return index;
}

}  // namespace

KinectModel::KinectModel(const Scene& scene, std::size_t sensor, std::uint64_t seed)
    : scene_(&scene),
      sensor_(sensor),
      seed_(mixed(seed, 0x61C7, sensor)),
      noise_(static_cast<float>(scene.sensors[sensor].noise)),
      optics_(scene, sensor, seed),
      parts_(kPartsMax),
      part_score_(kPartsMax),
      inverse_depth_(static_cast<std::size_t>(kRows * kStride)),
      score_(inverse_depth_.size(), kNoReading),
      part_(inverse_depth_.size(), -1),
      depth_noise_(kWidth, kHeight, 0.35),
      score_noise_(kWidth, kHeight, 0),
      shift_u_(kWidth, kHeight, 0),
      shift_v_(kWidth, kHeight, 0) {
  const auto levels = static_cast<std::size_t>(kLevels / static_cast<float>(kNearest)) + 8;
  millimetres_.resize(levels);
  for (std::size_t level = 0; level < levels; ++level) {
    const double z = level == 0 ? 1e9 : static_cast<double>(kLevels) / static_cast<double>(level);
    if (z >= kNearest && z <= kFarthest)
      millimetres_[level] = static_cast<std::uint16_t>(std::lround(z * 1000));
  }
  // Every combination of light and displacement that the scene ever has.
  std::vector<double> turns{0};
  for (const SceneLight& light : scene.lights) turns.push_back(light.at);
  for (const SceneFault& fault : scene.faults) {
    if (fault.kind != FaultKind::kMoved || fault.sensor != static_cast<int>(sensor)) continue;
    turns.push_back(fault.at);
    turns.push_back(fault.at + fault.for_s);
  }
  for (const double turn : turns) {
    const std::size_t light = light_index_at(scene, turn);
    const double moved = moved_at(turn);
    const auto same = [&](const Still& still) {
      const bool like = light_at(scene, still.light).state == light_at(scene, light).state &&
                        light_at(scene, still.light).direction == light_at(scene, light).direction;
      return still.moved == moved && (still.light == light || like);
    };
    if (std::any_of(stills_.begin(), stills_.end(), same)) continue;
    stills_.push_back(
        {light, moved, optics_.still_view(pose_moved(moved), light_at(scene, light))});
  }
}

double KinectModel::moved_at(double seconds) const {
  double moved = 0;
  for (const SceneFault& fault : scene_->faults)
    if (fault.kind == FaultKind::kMoved && fault.sensor == static_cast<int>(sensor_) &&
        seconds >= fault.at && seconds < fault.at + fault.for_s)
      moved += fault.amount;
  return moved;
}

// Knocked aside, a sensor turns with its bracket, which is taken to be one metre long.
Rigid KinectModel::pose_moved(double metres) const {
  const Rigid knock{Eigen::Quaterniond(Eigen::AngleAxisd(metres, Vector3d::UnitY())),
                    {metres, 0, 0}};
  return optics_.X_WS() * knock;
}

const KinectModel::Still& KinectModel::still_at(double seconds) const {
  const std::size_t light = light_index_at(*scene_, seconds);
  const double moved = moved_at(seconds);
  const SceneLight& wanted = light_at(*scene_, light);
  for (const Still& still : stills_) {
    const SceneLight& has = light_at(*scene_, still.light);
    if (still.moved == moved && has.state == wanted.state && has.direction == wanted.direction)
      return still;
  }
  return stills_.front();
}

void KinectModel::add(const Parts& parts, const Rigid& X_SW, const SceneLight& light) {
  const Rigid X_WS = X_SW.inverse();
  for (const Part& part : parts) {
    const PreparedPart prepared = optics_.raster().prepare(part, X_SW);
    if (prepared.rect.empty()) continue;
    if (!parts_.try_push_back(prepared)) return;
    const bool sunny = optics_.sunlit(part.centre, light);
    const float foreign = optics_.foreign_light(part.centre, X_WS);
    (void)part_score_.try_push_back(sunny ? 1e3F : foreign);
  }
}

void KinectModel::gather(World& world, HostTime instant) {
  const double seconds = to_seconds(instant.time_since_epoch());
  const Still& still = still_at(seconds);
  const SceneLight& light = light_at(*scene_, still.light);
  const Rigid X_SW = pose_moved(still.moved).inverse();
  parts_.clear();
  part_score_.clear();
  Parts parts;
  for (std::size_t i = 0; i < world.passenger_count(); ++i) {
    const Pose pose = world.pose_at(i, instant);
    if (!pose.present) continue;
    const auto tag = static_cast<std::int32_t>(i + 1);
    parts.clear();
    clad(world.figure(i), pose, tag, parts);
    clad_luggage(world.figure(i), pose, tag, parts);
    add(parts, X_SW, light);
  }
  for (const StandingItem& item : world.items_at(instant)) {
    if (!item.there) continue;
    parts.clear();
    if (item.pram)
      place_pram(item.position, item.yaw, -(item.owner + 1), parts);
    else
      place_bag(item.position, item.yaw, -(item.owner + 1), parts);
    add(parts, X_SW, light);
  }
  for (std::size_t door = 0; door < scene_->doors.size(); ++door) {
    parts.clear();
    place_door_leaves(doorway_of(*scene_, scene_->doors[door]), world.door_open_at(door, instant),
                      parts);
    add(parts, X_SW, light);
  }
}

void KinectModel::draw_parts() {
  changed_ = {kWidth, kHeight, 0, 0};
  const std::size_t offset = at(0, 0);
  const RasterTarget target{kStride, kRows, std::span(inverse_depth_).subspan(offset),
                            std::span(part_).subspan(offset)};
  for (std::size_t i = 0; i < parts_.size(); ++i) {
    const PixelRect& rect = parts_[i].rect;
    optics_.raster().draw(parts_[i], static_cast<std::int32_t>(i), target);
    changed_ = {std::min(changed_.u, rect.u), std::min(changed_.v, rect.v),
                std::max(changed_.u_end, rect.u_end), std::max(changed_.v_end, rect.v_end)};
  }
}

void KinectModel::score_parts() {
  const std::vector<float>& luck = optics_.luck();
  for (int v = changed_.v; v < changed_.v_end; ++v) {
    for (int u = changed_.u; u < changed_.u_end; ++u) {
      const std::size_t i = at(u, v);
      if (part_[i] < 0) continue;
      const auto index = static_cast<std::size_t>(part_[i]);
      const PreparedPart& part = parts_[index];
      const float incidence = optics_.raster().incidence(part, u, v, inverse_depth_[i]);
      const float lucky = luck[static_cast<std::size_t>(v * kWidth + u)];
      score_[i] = surface_score(part.albedo, incidence, inverse_depth_[i]) + 0.8F * lucky -
                  KinectOptics::foreign_penalty(part_score_[index], lucky);
      if (part_score_[index] > 100) score_[i] = kNoReading;  // in the sun
    }
  }
}

void KinectModel::render(World& world, HostTime instant, std::uint32_t number,
                         std::span<std::uint16_t> depth) {
  const Still& still = still_at(to_seconds(instant.time_since_epoch()));
  for (int v = 0; v < kHeight; ++v) {
    const auto row = static_cast<std::size_t>(v) * kWidth;
    std::copy_n(still.view.inverse_depth.data() + row, kWidth, inverse_depth_.data() + at(0, v));
    std::copy_n(still.view.score.data() + row, kWidth, score_.data() + at(0, v));
  }
  std::fill(part_.begin(), part_.end(), -1);
  gather(world, instant);
  draw_parts();
  score_parts();
  if (changed_.v < changed_.v_end)
    cast_projector_shadow(inverse_depth_.data() + at(0, 0), score_.data() + at(0, 0), kWidth,
                          kStride, changed_.v, changed_.v_end);
  add_noise(number, depth);
}

void KinectModel::add_noise(std::uint32_t number, std::span<std::uint16_t> depth) {
  const std::uint64_t key = mixed(seed_, number);
  depth_noise_.draw(mixed(key, 1));
  score_noise_.draw(mixed(key, 2));
  shift_u_.draw(mixed(key, 3));
  shift_v_.draw(mixed(key, 4));
  const auto top = static_cast<int>(millimetres_.size()) - 1;
  for (int v = 0; v < kHeight; ++v) {
    const auto wobble = depth_noise_.row(v), doubt = score_noise_.row(v);
    const auto shift_u = shift_u_.row(v), shift_v = shift_v_.row(v);
    const float* w = inverse_depth_.data() + at(0, v);
    const float* score = score_.data() + at(0, v);
    std::uint16_t* out = depth.data() + static_cast<std::ptrdiff_t>(v) * kWidth;
    for (int u = 0; u < kWidth - kBlindColumns; ++u) {
      const auto c = static_cast<std::size_t>(u);
      // The correlation window takes what lies a little aside.
      const int du =
          static_cast<int>(std::clamp(noise_ * 1.1F * shift_u[c], -3.4F, 3.4F) + 4.5F) - 4;
      const int dv =
          static_cast<int>(std::clamp(noise_ * 1.1F * shift_v[c], -3.4F, 3.4F) + 4.5F) - 4;
      const std::ptrdiff_t aside = static_cast<std::ptrdiff_t>(dv) * kStride + du + u;
      float s = score[aside];
      if (std::abs(w[aside] - w[u]) * kLevels > 4.0F) s -= 1.5F * noise_;
      const float sigma = noise_ * (0.55F + 0.1F * std::max(0.0F, 4.0F - s));
      const int level = static_cast<int>(w[aside] * kLevels + sigma * wobble[c] + 0.5F);
      const bool reads = noise_ * doubt[c] < s;
      out[u] = reads ? millimetres_[static_cast<std::size_t>(std::clamp(level, 0, top))]
                     : std::uint16_t{0};
    }
    std::fill_n(out + kWidth - kBlindColumns, kBlindColumns, std::uint16_t{0});
  }
}

std::int32_t KinectModel::tag_at(int u, int v) const {
  const std::int32_t index = part_[at(u, v)];
  return index < 0 ? 0 : parts_[static_cast<std::size_t>(index)].tag;
}

void KinectModel::picture(std::span<std::uint8_t> grey) const {
  for (int v = 0; v < kHeight; ++v) {
    for (int u = 0; u < kWidth; ++u) {
      const std::size_t i = at(u, v);
      float light = inverse_depth_[i] > 0 ? 0.25F + 0.4F * std::min(inverse_depth_[i], 1.0F) : 0;
      if (part_[i] >= 0) {
        const PreparedPart& part = parts_[static_cast<std::size_t>(part_[i])];
        light =
            (0.3F + 1.4F * part.albedo) * optics_.raster().incidence(part, u, v, inverse_depth_[i]);
      }
      grey[static_cast<std::size_t>(v * kWidth + u)] =
          static_cast<std::uint8_t>(255.0F * std::clamp(light, 0.0F, 1.0F));
    }
  }
}

}  // namespace wagonsight

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
// What makes a Kinect's error, in its own steps of disparity. The figures are those of a recording
// of a still room (see README): the wobble of a good reading, what doubt adds to it, how far aside
// the correlation window may take its depth, and how often it fails where there is an edge.
constexpr float kSigma = 0.29F, kSigmaDoubt = 0.045F;
constexpr float kEdgeReach = 1.0F, kEdgeLevels = 4.0F, kEdgeDoubt = 1.5F;
constexpr int kTogether = 4;      // pixels of a row that look aside together
constexpr int kBlindColumns = 8;  // at the right border, for want of a window

const SceneLight& light_at(const Scene& scene, std::size_t index) {
  static const SceneLight kDaylight{};
  return index == 0 ? kDaylight : scene.lights[index - 1];
}

// 0: before the first [[light]]; otherwise its index + 1.
std::size_t light_index_at(const Scene& scene, double seconds) {
  seconds = time_in(scene, seconds);
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
      part_foreign_(kPartsMax),
      inverse_depth_(static_cast<std::size_t>(kRows * kStride)),
      score_(inverse_depth_.size(), kNoReading),
      part_(inverse_depth_.size(), -1),
      depth_noise_(kWidth, kHeight, 0.55),
      score_noise_(kWidth, kHeight, 0),
      shift_u_(kWidth, kHeight, 0, kTogether),
      shift_v_(kWidth, kHeight, 0, kTogether) {
  const auto levels = static_cast<std::size_t>(kLevels / static_cast<float>(kNearest)) + 8;
  millimetres_.resize(levels);
  for (std::size_t level = 0; level < levels; ++level) {
    const double z = level == 0 ? 1e9 : static_cast<double>(kLevels) / static_cast<double>(level);
    if (z >= kNearest && z <= kFarthest)
      millimetres_[level] = static_cast<std::uint16_t>(std::lround(z * 1000));
  }
  for (std::size_t i = 0; i < incidence_score_.size(); ++i)
    incidence_score_[i] = surface_score(0.45F, static_cast<float>(i) / 255.0F, 1.0F) -
                          surface_score(0.45F, 1.0F, 1.0F);
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
  seconds = time_in(*scene_, seconds);
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
  for (const Part& part : parts) {
    const PreparedPart prepared = optics_.raster().prepare(part, X_SW);
    if (prepared.rect.empty()) continue;
    if (!parts_.try_push_back(prepared)) return;
    // Distance and foreign light are taken as those of the part's middle.
    const Vector3d centre_S = X_SW * part.centre;
    const float w = 1.0F / static_cast<float>(std::max(centre_S.z(), 0.1));
    const bool sunny = optics_.sunlit(part.centre, light);
    (void)part_score_.try_push_back(sunny ? kNoReading : surface_score(part.albedo, 1.0F, w));
    (void)part_foreign_.try_push_back(optics_.foreign_light(part.centre, centre_S.squaredNorm()));
  }
}

void KinectModel::gather(World& world, HostTime instant) {
  const double seconds = to_seconds(instant.time_since_epoch());
  const Still& still = still_at(seconds);
  const SceneLight& light = light_at(*scene_, still.light);
  const Rigid X_SW = pose_moved(still.moved).inverse();
  parts_.clear();
  part_score_.clear();
  part_foreign_.clear();
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
  for (std::size_t ball = 0; ball < scene_->balls.size(); ++ball) {
    parts.clear();
    parts.push_back(world.ball_at(ball, instant));
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
    const DrawRect& rect = parts_[i].rect;
    optics_.raster().draw(parts_[i], static_cast<std::int32_t>(i), target);
    changed_ = {std::min(changed_.u, rect.u), std::min(changed_.v, rect.v),
                std::max(changed_.u_end, rect.u_end), std::max(changed_.v_end, rect.v_end)};
  }
}

void KinectModel::score_parts() {
  const float* luck = optics_.luck().data();
  for (int v = changed_.v; v < changed_.v_end; ++v) {
    const std::size_t row = at(0, v);
    const bool second_row = ((v - changed_.v) & 1) != 0;
    std::int32_t last = -1;
    for (int u = changed_.u; u < changed_.u_end; ++u) {
      const std::size_t i = row + static_cast<std::size_t>(u);
      const std::int32_t index = part_[i];
      // A score changes slowly: every other pixel of a part takes that of its neighbour.
      const bool again = index == last;
      last = again ? -1 : index;
      if (index < 0) continue;
      if (again || (second_row && part_[i - kStride] == index)) {
        score_[i] = again ? score_[i - 1] : score_[i - kStride];
        continue;
      }
      const auto k = static_cast<std::size_t>(index);
      const float incidence = optics_.raster().incidence(parts_[k], u, v, inverse_depth_[i]);
      const float lucky = luck[v * kWidth + u];
      score_[i] = part_score_[k] + incidence_score_[static_cast<std::size_t>(incidence * 255.0F)] +
                  kLuck * lucky - KinectOptics::foreign_penalty(part_foreign_[k], lucky);
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
  for (int v = 0; v < kHeight; ++v) {
    look_aside(v);
    quantise(v, depth.subspan(static_cast<std::size_t>(v) * kWidth, kWidth));
  }
}

// The correlation window takes what lies a little aside, in every frame elsewhere.
void KinectModel::look_aside(int v) {
  const float* shift_u = shift_u_.row(v).data();
  const float* shift_v = shift_v_.row(v).data();
  const float reach = noise_ * kEdgeReach, most = static_cast<float>(kMargin) - 0.6F;
  const float* w = inverse_depth_.data() + at(0, v);
  const float* score = score_.data() + at(0, v);
  for (int group = 0; group < kWidth / kTogether; ++group) {
    const float du = std::min(std::max(reach * shift_u[group], -most), most);
    const float dv = std::min(std::max(reach * shift_v[group], -most), most);
    const int offset = (static_cast<int>(dv + (kMargin + 0.5F)) - kMargin) * kStride +
                       static_cast<int>(du + (kMargin + 0.5F)) - kMargin;
    const int u = group * kTogether;
    std::copy_n(w + u + offset, kTogether, row_depth_.data() + u);
    std::copy_n(score + u + offset, kTogether, row_score_.data() + u);
  }
}

void KinectModel::quantise(int v, std::span<std::uint16_t> out) {
  const float* wobble = depth_noise_.row(v).data();
  const float* doubt = score_noise_.row(v).data();
  const float* w = inverse_depth_.data() + at(0, v);
  const auto top = static_cast<int>(millimetres_.size()) - 1;
  std::array<std::int32_t, kWidth> levels;
  for (std::size_t u = 0; u < kWidth; ++u) {
    const bool edge = std::abs(row_depth_[u] - w[u]) > kEdgeLevels / kLevels;
    const float score = row_score_[u] - (edge ? kEdgeDoubt * noise_ : 0.0F);
    const float sigma = noise_ * (kSigma + kSigmaDoubt * std::max(0.0F, 6.5F - score));
    const int level = static_cast<int>(row_depth_[u] * kLevels + sigma * wobble[u] + 0.5F);
    const int within = std::min(std::max(level, 0), top);
    levels[u] = noise_ * doubt[u] < score ? within : 0;  // level 0 is no reading
  }
  for (std::size_t u = 0; u < kWidth - kBlindColumns; ++u)
    out[u] = millimetres_[static_cast<std::size_t>(levels[u])];
  std::fill_n(out.begin() + (kWidth - kBlindColumns), kBlindColumns, std::uint16_t{0});
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

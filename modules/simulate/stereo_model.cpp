#include "simulate/stereo_model.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "base/check.h"
#include "geometry/angles.h"
#include "simulate/random.h"

namespace wagonsight {
namespace {

using Eigen::Vector3d;

// Gray levels of a white surface on a bright day at the first exposure, before saturation.
constexpr float kLevelsPerRadiance = 5700;
constexpr float kElectronsPerLevel = 4, kReadNoise = 5;  // at a gain of 1
constexpr float kPixelSpread = 0.006F;                   // of the pixels' sensitivities
constexpr float kBlack = 16;                             // so that noise is not cut off in the dark

RectifiedPair pair_of(const StereoGeometry& imagers) {
  const auto pair = rectified_pair(imagers.left, imagers.right, imagers.X_LR);
  WS_CHECK(pair.has_value(), "%s", "simulated imagers cannot be rectified");
  return *pair;
}

// A garment is what of one person has one albedo in the infrared, in which the figures are drawn.
Finish finish_of(const Part& part, std::uint64_t who) {
  const auto shade = static_cast<std::uint64_t>(std::lround(1000.0F * part.albedo));
  const std::uint64_t key = mixed(0xD4E55, who, shade);
  Finish finish;
  constexpr std::array kTextures{Texture::kCloth, Texture::kStripes, Texture::kCloth,
                                 Texture::kCloth, Texture::kSkin,    Texture::kPlain,
                                 Texture::kCloth, Texture::kHair};
  finish.texture = kTextures[key % kTextures.size()];
  finish.albedo = 0.10F + 0.5F * static_cast<float>(uniform(mixed(key, 1)));
  finish.a = static_cast<float>(key >> 8U & 255U);
  finish.b = static_cast<float>(key >> 16U & 255U);
  return finish;
}

}  // namespace

StereoModel::StereoModel(const Scene& scene, std::size_t sensor, std::uint64_t seed)
    : scene_(&scene),
      sensor_(sensor),
      seed_(mixed(seed, 0x57E4E0, sensor)),
      noise_(static_cast<float>(scene.sensors[sensor].noise)),
      imagers_(stereo_imagers(sensor)),
      pair_(pair_of(imagers_)),
      room_(room_of(scene)),
      textures_(0x7E87),
      left_(scene, room_, textures_, imagers_.left),
      right_(scene, room_, textures_, imagers_.right),
      lit_{{}, SunPatches(scene.windows)},
      radiance_(static_cast<std::size_t>(width()) * static_cast<std::size_t>(height())),
      row_(static_cast<std::size_t>(width())),
      normal_(kNoiseValues + static_cast<std::size_t>(width())) {
  parts_.reserve(kPartsMax);
  for (std::size_t i = 0; i < kNoiseValues; ++i) {
    double sum = -6;  // the sum of twelve uniform numbers has variance 1
    for (std::uint64_t k = 0; k < 12; ++k) sum += uniform(mixed(0x4015E, i, k));
    normal_[i] = static_cast<float>(sum);
  }
  std::copy_n(normal_.begin(), width(), normal_.begin() + kNoiseValues);
  // Every displacement that the scene ever has.
  std::vector<double> turns{0};
  for (const SceneFault& fault : scene.faults) {
    if (fault.sensor != static_cast<int>(sensor)) continue;
    turns.push_back(fault.at);
    turns.push_back(fault.at + fault.for_s);
  }
  for (const double turn : turns) {
    const Knock knock = knock_at(turn);
    if (std::find(knocks_.begin(), knocks_.end(), knock) != knocks_.end()) continue;
    knocks_.push_back(knock);
    const Rigid X_WS = X_WS_of(knock);
    left_.add_pose(X_WS * pair_.X_LS.inverse());
    // The right imager nods; its rows no longer are those of the left one.
    const Rigid nod{
        Eigen::Quaterniond(Eigen::AngleAxisd(knock.bent / imagers_.right.fy, Vector3d::UnitX())),
        Vector3d::Zero()};
    right_.add_pose(X_WS * pair_.X_RS.inverse() * nod);
  }
}

StereoModel::Knock StereoModel::knock_at(double seconds) const {
  seconds = time_in(*scene_, seconds);
  Knock knock;
  for (const SceneFault& fault : scene_->faults) {
    if (fault.sensor != static_cast<int>(sensor_) || seconds < fault.at ||
        seconds >= fault.at + fault.for_s)
      continue;
    if (fault.kind == FaultKind::kMoved) knock.moved += fault.amount;
    if (fault.kind == FaultKind::kBent) knock.bent += fault.amount;
  }
  return knock;
}

std::size_t StereoModel::pose_index(double seconds) const {
  const auto found = std::find(knocks_.begin(), knocks_.end(), knock_at(seconds));
  return found == knocks_.end() ? 0 : static_cast<std::size_t>(found - knocks_.begin());
}

// Knocked aside, a sensor turns with its bracket, which is taken to be one metre long.
Rigid StereoModel::X_WS_of(const Knock& knock) const {
  const SceneSensor& sensor = scene_->sensors[sensor_];
  const Rigid X_WS{look_at(sensor.position, sensor.look_at), sensor.position};
  return X_WS * Rigid{Eigen::Quaterniond(Eigen::AngleAxisd(knock.moved, Vector3d::UnitY())),
                      {knock.moved, 0, 0}};
}

void StereoModel::add(const Parts& parts, std::uint64_t who) {
  for (const Part& part : parts) {
    if (parts_.size() == kPartsMax) return;
    parts_.push_back({part, finish_of(part, who)});
  }
}

void StereoModel::gather(World& world, HostTime instant) {
  parts_.clear();
  Parts parts;
  for (std::size_t i = 0; i < world.passenger_count(); ++i) {
    const Pose pose = world.pose_at(i, instant);
    if (!pose.present) continue;
    parts.clear();
    const auto tag = static_cast<std::int32_t>(i + 1);
    clad(world.figure(i), pose, tag, parts);
    add(parts, i);
    parts.clear();
    clad_luggage(world.figure(i), pose, tag, parts);
    add(parts, i);
  }
  for (const StandingItem& item : world.items_at(instant)) {
    if (!item.there) continue;
    parts.clear();
    const std::int32_t tag = -(item.owner + 1);
    if (item.pram) {
      place_pram(item.position, item.yaw, tag, parts);
    } else {
      place_bag(item.position, item.yaw, tag, parts);
    }
    add(parts, static_cast<std::uint64_t>(item.owner));
  }
  for (std::size_t ball = 0; ball < scene_->balls.size(); ++ball)
    if (parts_.size() < kPartsMax)
      parts_.push_back({world.ball_at(ball, instant), {Texture::kCloth, 0.45F, 17, 90}});
  constexpr std::uint64_t kDoors = 1000;  // no passenger's number
  for (std::size_t door = 0; door < scene_->doors.size(); ++door) {
    parts.clear();
    place_door_leaves(doorway_of(*scene_, scene_->doors[door]), world.door_open_at(door, instant),
                      parts);
    add(parts, kDoors);
  }
}

void StereoModel::render(World& world, HostTime instant, std::uint32_t number,
                         const Exposure& exposure, std::span<std::uint16_t> pair) {
  const double seconds = to_seconds(instant.time_since_epoch());
  const std::size_t pixels = radiance_.size();
  WS_CHECK(pair.size() >= 2 * pixels, "%zu values for two images of %zu", pair.size(), pixels);
  gather(world, instant);
  lit_.light = light_of(*scene_, seconds);
  lit_.patches.set(lit_.light);
  const std::size_t pose = pose_index(seconds);
  const std::uint64_t key = mixed(seed_, number);
  left_.render(pose, parts_, lit_, radiance_);
  develop(left_, mixed(key, 1), exposure, pair.first(pixels));
  right_.render(pose, parts_, lit_, radiance_);
  develop(right_, mixed(key, 2), exposure, pair.subspan(pixels, pixels));
}

// A lens spreads a point over its neighbours: 1 6 1 in both directions.
void StereoModel::blur_row(int v) {
  const auto stride = static_cast<std::ptrdiff_t>(width());
  const float* here = radiance_.data() + v * stride;
  const float* above = v > 0 ? here - stride : here;
  const float* below = v + 1 < height() ? here + stride : here;
  const auto column = [&](std::ptrdiff_t u) { return above[u] + below[u] + 6.0F * here[u]; };
  const std::ptrdiff_t last = stride - 1;
  for (std::ptrdiff_t u = 1; u < last; ++u)
    row_[static_cast<std::size_t>(u)] =
        (column(u - 1) + column(u + 1) + 6.0F * column(u)) * (1.0F / 64.0F);
  row_.front() = column(0) / 8.0F;
  row_.back() = column(last) / 8.0F;
}

const float* StereoModel::noise_row(std::uint64_t key, int v) const {
  return normal_.data() + mixed(key, static_cast<std::uint64_t>(v)) % kNoiseValues;
}

void StereoModel::develop(const StereoImager& imager, std::uint64_t key, const Exposure& exposure,
                          std::span<std::uint16_t> out) {
  const float gain = std::pow(10.0F, exposure.gain_db / 20.0F);
  const float levels = kLevelsPerRadiance * exposure.shutter_us / kFirstExposure.shutter_us * gain;
  const float read2 = kReadNoise * kReadNoise * gain * gain, shot = gain / kElectronsPerLevel;
  const std::uint64_t imager_key = mixed(seed_, &imager == &left_ ? 11 : 12);
  for (int v = 0; v < height(); ++v) {
    blur_row(v);
    const float* noise = noise_row(key, v);
    const float* spread = noise_row(imager_key, v);
    const float y = imager.raster().ray_y(v);
    std::uint16_t* target = out.data() + static_cast<std::ptrdiff_t>(v) * width();
    for (int u = 0; u < width(); ++u) {
      const float x = imager.raster().ray_x(u), r2 = 1.0F + x * x + y * y;
      // The cosine to the fourth of natural vignetting.
      const float signal = row_[static_cast<std::size_t>(u)] * levels / (r2 * r2) *
                           (1.0F + kPixelSpread * spread[u]);
      const float value =
          signal + kBlack + 0.5F + noise_ * noise[u] * std::sqrt(read2 + shot * signal);
      const float within = std::min(std::max(value, 0.0F), static_cast<float>(kFullScale));
      target[u] = static_cast<std::uint16_t>(static_cast<int>(within));
    }
  }
}

void StereoModel::truth(World& world, HostTime instant, std::span<float> inverse_depth,
                        std::span<std::int32_t> tags) {
  if (ideal_ == nullptr) {
    ideal_ = std::make_unique<StereoImager>(*scene_, room_, textures_, pair_.camera);
    for (const Knock& knock : knocks_) ideal_->add_pose(X_WS_of(knock));
    ideal_radiance_.resize(radiance_.size());
  }
  WS_CHECK(inverse_depth.size() == radiance_.size(), "%zu", inverse_depth.size());
  const double seconds = to_seconds(instant.time_since_epoch());
  gather(world, instant);
  lit_.light = light_of(*scene_, seconds);
  lit_.patches.set(lit_.light);
  ideal_->render(pose_index(seconds), parts_, lit_, ideal_radiance_);
  for (int v = 0; v < height(); ++v)
    for (int u = 0; u < width(); ++u) {
      const auto pixel = static_cast<std::size_t>(v) * static_cast<std::size_t>(width()) +
                         static_cast<std::size_t>(u);
      inverse_depth[pixel] = ideal_->inverse_depth(u, v);
      if (!tags.empty()) tags[pixel] = ideal_->tag_at(u, v);
    }
}

}  // namespace wagonsight

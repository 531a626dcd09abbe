#include "drift/sensor_drift.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace wagonsight {
namespace {

constexpr double kLearnedShare = 0.6;     // of the frames that must have a like reading
constexpr double kCountShare = 0.3;       // of a window's frames that must have seen a point
constexpr double kBeyondShare = 0.25;     // of the points seen through: it looks elsewhere
constexpr double kFittingShareMin = 0.3;  // fewer fit: what is seen is not the wagon
// An alarm is due beyond the limits; at a limit half of all judgements would fall short of it.
constexpr double kAlarmShare = 0.8, kClearShare = 0.6;
constexpr double kSignificance = 3;  // sigmas of what was measured
// The largest turn and shift that a judgement should still measure.
constexpr double kTurnMeasured = 0.02, kShiftMeasured = 0.05;

}  // namespace

SensorDrift::SensorDrift(const RigSensor& sensor, RayTable rays, std::span<const float> depth_m,
                         const DriftOptions& options)
    : sensor_(sensor),
      rays_(rays),
      grid_{sensor.camera.width, sensor.camera.height},
      options_(options),
      depth_m_(depth_m.begin(), depth_m.end()) {
  if (depth_m_.size() == grid_.size()) {
    begin_watching();
  } else {
    depth_m_.assign(grid_.size(), 0.0F);
    const auto parts = static_cast<std::size_t>(options_.learn_parts);
    learned_.resize((grid_.size() + parts - 1) / parts *
                    static_cast<std::size_t>(options_.learn_frames));
  }
}

float SensorDrift::depth_of(std::uint16_t reading) const {
  if (reading == 0) return 0;
  const double z = sensor_.depth_scale * 0.001 * reading + sensor_.depth_offset;
  return z >= sensor_.trim_near && z <= sensor_.trim_far ? static_cast<float>(z) : 0.0F;
}

bool SensorDrift::kept_out(std::size_t cell, float depth, std::span<const KeepOut> people) const {
  if (people.empty()) return false;
  const PixelRay ray = rays_[grid_.pixel(cell)];
  const Eigen::Vector3f p_S(depth * kRayScale * static_cast<float>(ray.x),
                            depth * kRayScale * static_cast<float>(ray.y), depth);
  const Eigen::Vector3f p_W =
      sensor_.X_WS.rotation.cast<float>() * p_S + sensor_.X_WS.position.cast<float>();
  return std::any_of(people.begin(), people.end(), [&](const KeepOut& box) {
    return (p_W.array() >= box.min_W.array()).all() && (p_W.array() <= box.max_W.array()).all();
  });
}

bool SensorDrift::add(std::span<const std::uint16_t> readings, std::span<const KeepOut> people) {
  if (readings.size() != grid_.size()) return false;
  if (state_ == State::kLearning) {
    learn(readings, people);
    if (frames_ < options_.learn_frames * options_.learn_parts) return false;
    learned_ = {};
    begin_watching();
    return true;
  }
  gather(readings, people);
  if (frames_ < options_.window_frames) return false;
  judge();
  return true;
}

void SensorDrift::learn(std::span<const std::uint16_t> readings, std::span<const KeepOut> people) {
  const auto stride = static_cast<std::size_t>(options_.learn_frames);
  const auto parts = static_cast<std::size_t>(options_.learn_parts);
  const int part = frames_ / options_.learn_frames;
  const auto frame = static_cast<std::size_t>(frames_ % options_.learn_frames);
  for (auto cell = static_cast<std::size_t>(part); cell < readings.size(); cell += parts) {
    const float z = depth_of(readings[cell]);
    learned_[cell / parts * stride + frame] =
        z > 0 && !kept_out(cell, z, people) ? readings[cell] : std::uint16_t{0};
  }
  ++frames_;
  if (frames_ % options_.learn_frames == 0) settle(part);
}

// The mean of the readings about their median, where most frames agree.
void SensorDrift::settle(int part) {
  const auto stride = static_cast<std::size_t>(options_.learn_frames);
  const auto parts = static_cast<std::size_t>(options_.learn_parts);
  const double needed = kLearnedShare * options_.learn_frames;
  std::vector<float> depths;
  for (auto cell = static_cast<std::size_t>(part); cell < grid_.size(); cell += parts) {
    depths.clear();
    for (std::size_t i = 0; i < stride; ++i)
      if (const float z = depth_of(learned_[cell / parts * stride + i]); z > 0) depths.push_back(z);
    if (static_cast<double>(depths.size()) < needed) continue;
    const auto middle = depths.begin() + static_cast<std::ptrdiff_t>(depths.size() / 2);
    std::nth_element(depths.begin(), middle, depths.end());
    const double z = *middle;
    const double band = 3 * sensor_.noise.sigma(z) + sensor_.noise.step(z);
    double sum = 0, count = 0;
    for (const float one : depths)
      if (std::abs(one - z) <= band) sum += one, count += 1;
    if (count >= needed) depth_m_[cell] = static_cast<float>(sum / count);
  }
}

void SensorDrift::begin_watching() {
  state_ = State::kWatching;
  frames_ = 0;
  surface_ = std::make_unique<StaticSurface>(grid_, rays_, depth_m_);
  window_.assign(surface_->points().size(), {});
  gate_m_.clear();
  for (const StaticSurface::Point& point : surface_->points()) {
    // A turn moves the place where a ray meets a wall, the more the flatter it meets it.
    const double z = point.p_S.z(), cosine = -point.normal_S.dot(point.p_S.normalized());
    const double flatness = std::sqrt(1 - cosine * cosine) / cosine;
    gate_m_.push_back(static_cast<float>(kShiftMeasured + kTurnMeasured * z * (1 + flatness) +
                                         3 * sensor_.noise.sigma(z) + sensor_.noise.step(z)));
  }
}

void SensorDrift::gather(std::span<const std::uint16_t> readings, std::span<const KeepOut> people) {
  const auto points = surface_->points();
  for (std::size_t i = 0; i < points.size(); ++i) {
    const float z = depth_of(readings[points[i].cell]);
    if (z <= 0) continue;
    const float off = z - points[i].p_S.z();
    if (off > gate_m_[i]) ++window_[i].beyond;
    if (std::abs(off) > gate_m_[i] || kept_out(points[i].cell, z, people)) continue;
    window_[i].metres += z;
    ++window_[i].count;
  }
  ++frames_;
}

void SensorDrift::judge() {
  const auto points = surface_->points();
  std::vector<Eigen::Vector3f> seen;
  seen.reserve(points.size());
  std::size_t beyond = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Sum& sum = window_[i];
    if (sum.beyond > frames_ / 2) ++beyond;
    if (sum.count < kCountShare * frames_) continue;
    const PixelRay ray = rays_[grid_.pixel(points[i].cell)];
    const float z = sum.metres / static_cast<float>(sum.count);
    seen.emplace_back(z * kRayScale * static_cast<float>(ray.x),
                      z * kRayScale * static_cast<float>(ray.y), z);
  }
  frames_ = 0;
  ++judgements_;
  std::fill(window_.begin(), window_.end(), Sum{});
  looks_elsewhere_ = !points.empty() && static_cast<double>(beyond) >
                                            kBeyondShare * static_cast<double>(points.size());
  const SensorMotion motion = register_onto(*surface_, seen, sensor_.noise);
  const bool told = motion.known && motion.fitting_share >= kFittingShareMin;
  if (told) motion_ = motion;
  if (!told && !looks_elsewhere_) return;  // too little of the wagon is in sight to say anything
  const double shift = motion.shift_m.norm(), turn = motion.turn_rad.norm();
  // Beyond the limit, and no play of the noise.
  const auto exceeds = [&](double share) {
    return looks_elsewhere_ ||
           shift > std::max(share * options_.alarm_shift_m, kSignificance * motion.sigma_shift_m) ||
           turn > std::max(share * options_.alarm_turn_rad, kSignificance * motion.sigma_turn_rad);
  };
  beyond_ = exceeds(kAlarmShare) ? beyond_ + 1 : 0;
  within_ = exceeds(kClearShare) ? 0 : within_ + 1;
  if (beyond_ >= options_.windows_to_alarm) state_ = State::kMoved;
  if (within_ >= options_.windows_to_clear) state_ = State::kWatching;
}

}  // namespace wagonsight

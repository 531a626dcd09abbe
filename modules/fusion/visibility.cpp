#include "fusion/visibility.h"

#include <algorithm>
#include <cmath>

#include "geometry/camera.h"

namespace wagonsight {
namespace {

constexpr double kCellsMax = 32'768;  // 0.15 m in a wagon of 6.0 x 2.7 x 2.4 m makes 12,000

double cell_count(const Bounds& inside, double cell_m) {
  double count = 1;
  for (int axis = 0; axis < 3; ++axis)
    count *= std::max(1.0, std::ceil((inside.max[axis] - inside.min[axis]) / cell_m));
  return count;
}

}  // namespace

VisibilityGrid::VisibilityGrid(const Rig& rig, const Bounds& inside, double cell_m)
    : rig_(rig), inside_(inside), cell_m_(cell_m) {
  while (cell_count(inside, cell_m_) > kCellsMax) cell_m_ *= 1.1;
  for (int axis = 0; axis < 3; ++axis)
    size_[static_cast<std::size_t>(axis)] =
        std::max(1, static_cast<int>(std::ceil((inside.max[axis] - inside.min[axis]) / cell_m_)));
  cells_ =
      BoundedVector<Cell>(static_cast<std::size_t>(size_[0]) * static_cast<std::size_t>(size_[1]) *
                          static_cast<std::size_t>(size_[2]));
  cells_.resize(cells_.capacity());
  for (std::size_t i = 0; i < rig.sensors.size(); ++i)
    R_SW_[i] = rig.sensors[i].X_WS.rotation.conjugate().toRotationMatrix();
}

VisibilityGrid::Sight VisibilityGrid::look(const Eigen::Vector3d& p_W, double margin) const {
  Sight best = Sight::kOutside;
  for (std::size_t i = 0; i < rig_.sensors.size(); ++i) {
    const SensorFrame& frame = frames_[i];
    const RigSensor& sensor = rig_.sensors[i];
    const Eigen::Vector3d p_S = R_SW_[i] * (p_W - sensor.X_WS.position);
    if (p_S.z() < sensor.trim_near || p_S.z() > sensor.trim_far) continue;
    const Eigen::Vector2d image = distort(sensor.camera, {p_S.x() / p_S.z(), p_S.y() / p_S.z()});
    const int u = static_cast<int>(std::lround(sensor.camera.fx * image.x() + sensor.camera.cx));
    const int v = static_cast<int>(std::lround(sensor.camera.fy * image.y() + sensor.camera.cy));
    if (u < 0 || v < 0 || u >= sensor.camera.width || v >= sensor.camera.height) continue;
    Sight sight = Sight::kNoReading;
    if (frame.state == FrameState::kPresent && frame.slot->format == PixelFormat::kDepth16 &&
        frame.slot->depth().at(u, v) != 0) {
      const double raw_m = 1e-3 * frame.slot->depth().at(u, v);
      const double z = sensor.depth_scale * raw_m + sensor.depth_offset;
      const double tolerance = margin + 3 * sensor.noise.sigma(p_S.z());
      sight = z > p_S.z() + tolerance   ? Sight::kFree
              : z < p_S.z() - tolerance ? Sight::kOccluded
                                        : Sight::kSurface;
    }
    best = std::max(best, sight);
  }
  return best;
}

Eigen::Vector3d VisibilityGrid::centre_of(std::size_t index) const {
  const auto nx = static_cast<std::size_t>(size_[0]);
  const auto ny = static_cast<std::size_t>(size_[1]);
  const Eigen::Vector3d steps(static_cast<double>(index % nx), static_cast<double>(index / nx % ny),
                              static_cast<double>(index / (nx * ny)));
  return inside_.min + cell_m_ * (steps.array() + 0.5).matrix();
}

void VisibilityGrid::update(const FrameSet& frames) {
  frames_ = frames.sensors;
  if (!started_) {
    started_ = true;
    start_ = frames.instant;
    budget_ = static_cast<double>(cells_.size());  // everything once, then in slices
  }
  const double now_s = to_seconds(frames.instant - start_);
  const auto count = static_cast<double>(cells_.size());
  budget_ = std::min(count, budget_ + count * std::max(0.0, now_s - now_s_) / kScan);
  now_s_ = now_s;
  for (; budget_ >= 1; budget_ -= 1) {
    const Sight sight = look(centre_of(next_), 0.5 * cell_m_);
    if (sight == Sight::kFree || sight == Sight::kSurface) {
      cells_[next_].seen_s = static_cast<float>(now_s);
      cells_[next_].state = sight == Sight::kFree ? Visibility::kFree : Visibility::kOccupied;
    }
    next_ = (next_ + 1) % cells_.size();
  }
}

Visibility VisibilityGrid::at(double x, double y, double z) const {
  const Eigen::Array3d steps = ((Eigen::Vector3d(x, y, z) - inside_.min) / cell_m_).array().floor();
  std::size_t index = 0;
  for (int axis = 2; axis >= 0; --axis) {
    const int size = size_[static_cast<std::size_t>(axis)];
    if (!(steps[axis] >= 0 && steps[axis] < size)) return Visibility::kUnobserved;
    index = index * static_cast<std::size_t>(size) + static_cast<std::size_t>(steps[axis]);
  }
  const Cell& cell = cells_[index];
  return now_s_ - cell.seen_s > kMemory ? Visibility::kUnobserved : cell.state;
}

double VisibilityGrid::observed_share(const Bounds& box) const {
  std::size_t observed = 0;
  std::size_t all = 0;
  Eigen::Array3i first;
  Eigen::Array3i last;
  for (int axis = 0; axis < 3; ++axis) {
    const double size = size_[static_cast<std::size_t>(axis)];
    const auto to_step = [&](double value) {
      return std::clamp((value - inside_.min[axis]) / cell_m_ - 0.5, -1.0, size);
    };
    first[axis] = std::max(0, static_cast<int>(std::ceil(to_step(box.min[axis]))));
    last[axis] =
        std::min(static_cast<int>(size) - 1, static_cast<int>(std::floor(to_step(box.max[axis]))));
  }
  for (int z = first[2]; z <= last[2]; ++z)
    for (int y = first[1]; y <= last[1]; ++y)
      for (int x = first[0]; x <= last[0]; ++x) {
        const Cell& cell = cells_[static_cast<std::size_t>((z * size_[1] + y) * size_[0] + x)];
        ++all;
        if (cell.state != Visibility::kUnobserved && now_s_ - cell.seen_s <= kMemory) ++observed;
      }
  return all == 0 ? 0.0 : static_cast<double>(observed) / static_cast<double>(all);
}

ColumnView VisibilityGrid::look_at_column(double x, double y, double height) const {
  // Chest to head, where a body is seen first; the legs hide behind seats.
  constexpr std::array<double, 4> kHeightShares{0.5, 0.65, 0.8, 0.95};
  constexpr std::array<double, 3> kSideways{-0.12, 0.0, 0.12};  // within a torso
  constexpr float kSample = 1.0F / (kHeightShares.size() * kSideways.size());
  ColumnView view;
  for (const double share : kHeightShares)
    for (const double sideways : kSideways) {
      // Across the diagonal, so that no sensor looks along the row of samples by chance.
      const Eigen::Vector3d p_W(x + 0.7 * sideways, y - 0.7 * sideways, share * height);
      switch (look(p_W, 0.2)) {
        case Sight::kFree:
          view.free += kSample;
          break;
        case Sight::kSurface:
          view.surface += kSample;
          break;
        case Sight::kOccluded:
          view.occluded += kSample;
          break;
        case Sight::kNoReading:
          view.no_reading += kSample;
          break;
        case Sight::kOutside:
          view.outside += kSample;
          break;
      }
    }
  return view;
}

}  // namespace wagonsight

#include "foreground/ray_thresholds.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "base/check.h"
#include "foreground/ray_walk.h"

namespace wagonsight {

namespace {

constexpr std::uint16_t kBehindAll = UINT16_MAX;  // no reading is this: DepthModel ends below

}  // namespace

RayThresholds::RayThresholds(const SensorView& view)
    : width_(static_cast<std::size_t>(view.width())),
      height_(static_cast<std::size_t>(view.height())),
      kernel_(best_interval_kernel()),
      near_all_(std::max<std::uint16_t>(view.depth().raw_near(), 1)) {
  const std::size_t pixels = view.pixel_count();
  for (auto* array : {&first_near_, &first_far_, &second_near_, &second_far_}) {
    *array = BoundedVector<std::uint16_t>(pixels);
    array->resize(pixels);
  }
  for (auto* bits : {&open_, &known_, &crowded_, &stale_}) {
    *bits = BoundedVector<std::uint64_t>((pixels + 63) / 64);
    bits->resize(bits->capacity());
  }
  for (auto* ends : {&far_most_, &far_least_}) {
    *ends = BoundedVector<std::uint16_t>(open_.size());
    ends->resize(ends->capacity());
  }
  std::fill(far_least_.begin(), far_least_.end(), UINT16_MAX);
  for (std::size_t pixel = 0; pixel < pixels; ++pixel) {
    const RawInterval inside = view.inside(pixel);
    const bool any = inside.first <= inside.last;
    const std::uint16_t far = any ? inside.last : std::uint16_t{0};
    far_most_[pixel / 64] = std::max(far_most_[pixel / 64], far);
    far_least_[pixel / 64] = std::min(far_least_[pixel / 64], far);
    if (!any || inside.first == near_all_ || !near_.empty()) continue;
    // Only a sensor that looks into the wagon from outside needs a value a pixel.
    near_ = BoundedVector<std::uint16_t>(pixels);
    near_.resize(pixels);
  }
  for (std::size_t pixel = 0; pixel < near_.size(); ++pixel) {
    near_[pixel] = std::max<std::uint16_t>(view.inside(pixel).first, 1);
  }
  reset();
}

void RayThresholds::reset() {
  const std::size_t pixels = width_ * height_;
  for (std::size_t pixel = 0; pixel < pixels; ++pixel) store(pixel, {});
  std::fill(open_.begin(), open_.end(), std::uint64_t{0});
  std::fill(stale_.begin(), stale_.end(), std::uint64_t{0});
}

void RayThresholds::set_open(std::size_t pixel) {
  open_[pixel / 64] |= std::uint64_t{1} << (pixel % 64);
}

void RayThresholds::store(std::size_t pixel, const Intervals& intervals) {
  const auto is_empty = [](RawInterval interval) { return interval.first > interval.last; };
  const auto set_bit = [&](BoundedVector<std::uint64_t>& bits, bool on) {
    const std::uint64_t bit = std::uint64_t{1} << (pixel % 64);
    bits[pixel / 64] = on ? bits[pixel / 64] | bit : bits[pixel / 64] & ~bit;
  };
  first_near_[pixel] = intervals.first.first;
  first_far_[pixel] = intervals.first.last;
  second_near_[pixel] = is_empty(intervals.second) ? kBehindAll : intervals.second.first;
  second_far_[pixel] = is_empty(intervals.second) ? intervals.first.last : intervals.second.last;
  set_bit(known_, !is_empty(intervals.first));
  set_bit(crowded_, intervals.more);
}

void RayThresholds::Intervals::append(RawInterval next) {
  if (next.first > next.last) return;
  if (first.first > first.last) {
    first = next;
  } else if (second.first > second.last) {
    if (next.first <= first.last + 1) {
      first.last = std::max(first.last, next.last);
    } else {
      second = next;
    }
  } else if (!more && next.first <= second.last + 1) {
    second.last = std::max(second.last, next.last);
  } else {
    more = true;
  }
}

RayThresholds::Intervals RayThresholds::walk(const SensorView& view, const BitOctree& background,
                                             std::size_t pixel, float z_from, float z_to) const {
  Intervals result;
  if (!view.has_ray(pixel)) return result;
  walk_ray(view, background, pixel, z_from, z_to, [&](float z_enter, float z_leave) {
    result.append(view.depth().readings_of(z_enter, z_leave));
    return true;
  });
  return result;
}

template <class Visit>
std::size_t RayThresholds::visit_pixels(const SensorView& view, LeafAddress leaf,
                                        Visit&& visit) const {
  const LeafGrid& grid = view.grid();
  const LeafIndex index = grid.leaf_at(leaf);
  const auto leaf_m = static_cast<float>(grid.leaf_m());
  const Eigen::Vector3f corner = grid.corner(index).cast<float>();
  // The rectangle around the eight projected corners, and a pixel more for rounded rays.
  float u_min = INFINITY, v_min = INFINITY, u_max = -INFINITY, v_max = -INFINITY;
  for (int i = 0; i < 8; ++i) {
    const auto seen = view.project_anywhere(
        corner + leaf_m * Eigen::Vector3f(static_cast<float>(i & 1), static_cast<float>(i >> 1 & 1),
                                          static_cast<float>(i >> 2)));
    if (!seen) {  // beside or behind the sensor: its outline has no bounds
      u_min = v_min = 0;
      u_max = static_cast<float>(width_);
      v_max = static_cast<float>(height_);
      break;
    }
    u_min = std::min(u_min, seen->u);
    u_max = std::max(u_max, seen->u);
    v_min = std::min(v_min, seen->v);
    v_max = std::max(v_max, seen->v);
  }
  const int u_first = static_cast<int>(std::max(0.0F, std::floor(u_min) - 1));
  const int v_first = static_cast<int>(std::max(0.0F, std::floor(v_min) - 1));
  const int u_last =
      static_cast<int>(std::min(static_cast<float>(width_) - 1, std::ceil(u_max) + 1));
  const int v_last =
      static_cast<int>(std::min(static_cast<float>(height_) - 1, std::ceil(v_max) + 1));
  const Eigen::Vector3f near_grid =
      Eigen::Vector3f(static_cast<float>(index[0]), static_cast<float>(index[1]),
                      static_cast<float>(index[2])) -
      view.origin_grid();
  for (int v = v_first; v <= v_last; ++v) {
    for (int u = u_first; u <= u_last; ++u) {
      const std::size_t pixel = static_cast<std::size_t>(v) * width_ + static_cast<std::size_t>(u);
      if (!view.has_ray(pixel)) continue;
      const Eigen::Array3f per_ray = steep(view.ray_grid(pixel)).array().inverse();
      const Eigen::Array3f a = near_grid.array() * per_ray;
      const Eigen::Array3f b = (near_grid.array() + 1.0F) * per_ray;
      const float z_enter = std::max(0.0F, a.min(b).maxCoeff());
      const float z_leave = a.max(b).minCoeff();
      if (z_enter < z_leave) visit(pixel, z_enter, z_leave);
    }
  }
  const auto rows = static_cast<std::size_t>(std::max(0, v_last - v_first + 1));
  return rows * static_cast<std::size_t>(std::max(0, u_last - u_first + 1));
}

std::size_t RayThresholds::leaf_added(const SensorView& view, const BitOctree& background,
                                      LeafAddress leaf) {
  return visit_pixels(view, leaf, [&](std::size_t pixel, float z_enter, float z_leave) {
    join(view, background, pixel, view.depth().readings_of(z_enter, z_leave));
  });
}

void RayThresholds::leaf_removed(const SensorView& view, LeafAddress leaf) {
  (void)visit_pixels(view, leaf, [&](std::size_t pixel, float, float) {
    stale_[pixel / 64] |= std::uint64_t{1} << (pixel % 64);
  });
  any_stale_ = true;
}

void RayThresholds::settle(const SensorView& view, const BitOctree& background) {
  if (!any_stale_) return;
  any_stale_ = false;
  for (std::size_t word = 0; word < stale_.size(); ++word) {
    for (std::uint64_t rest = stale_[word]; rest != 0; rest &= rest - 1) {
      walk_again(view, background, word * 64 + static_cast<std::size_t>(std::countr_zero(rest)));
    }
    stale_[word] = 0;
  }
}

void RayThresholds::join(const SensorView& view, const BitOctree& background, std::size_t pixel,
                         RawInterval readings) {
  if (readings.first > readings.last) return;
  const RawInterval first{first_near_[pixel], first_far_[pixel]};
  const RawInterval second = this->second(pixel);
  if (readings.first >= first.first && readings.last <= first.last) return;
  if (is_crowded(pixel)) {
    store(pixel, walk(view, background, pixel, 0.0F, view.depth().z_max()));
    return;
  }
  Intervals joined;
  const bool before_first = readings.first < first.first || first.first > first.last;
  const bool before_second = readings.first < second.first || second.first > second.last;
  if (before_first) joined.append(readings);
  joined.append(first);
  if (!before_first && before_second) joined.append(readings);
  joined.append(second);
  if (!before_first && !before_second) joined.append(readings);
  store(pixel, joined);
}

void RayThresholds::walk_again(const SensorView& view, const BitOctree& background,
                               std::size_t pixel) {
  // Nothing came, so all leaves of the ray are still where they were known.
  const DepthModel& depth = view.depth();
  if (!has_background(pixel)) return;
  const std::uint16_t near = first_near_[pixel];
  const std::uint16_t last = is_crowded(pixel) ? depth.raw_far() : second_far_[pixel];
  const float z_from =
      near <= depth.raw_near() ? 0.0F : depth.z(static_cast<std::uint16_t>(near - 1));
  const float z_to =
      last >= depth.raw_far() ? depth.z_max() : depth.z(static_cast<std::uint16_t>(last + 1));
  store(pixel, walk(view, background, pixel, z_from, z_to));
}

Reading RayThresholds::classify_by_octree(const SensorView& view, const BitOctree& background,
                                          std::size_t pixel, std::uint16_t raw) const {
  if (is_outside(view, pixel, raw)) return Reading::kOutside;
  bool hit = false;
  std::uint16_t last = 0;
  walk_ray(view, background, pixel, 0.0F, view.depth().z_max(), [&](float z_enter, float z_leave) {
    const RawInterval leaf = view.depth().readings_of(z_enter, z_leave);
    if (leaf.first > leaf.last) return true;
    hit = leaf.first <= raw && raw <= leaf.last;
    last = std::max(last, leaf.last);
    return !hit;
  });
  if (hit) return Reading::kBackground;
  return raw <= last || is_open(pixel) ? Reading::kForeground : Reading::kUnknown;
}

Reading RayThresholds::classify(const SensorView& view, const BitOctree& background,
                                std::size_t pixel, std::uint16_t raw) const {
  if (is_outside(view, pixel, raw)) return Reading::kOutside;
  if (raw >= first_near_[pixel] && raw <= first_far_[pixel]) return Reading::kBackground;
  if (raw >= second_near_[pixel] && raw <= second_far_[pixel]) return Reading::kBackground;
  if (is_crowded(pixel) && raw > second_far_[pixel]) {
    return classify_crowded(view, background, pixel, raw);
  }
  return raw <= second_far_[pixel] || is_open(pixel) ? Reading::kForeground : Reading::kUnknown;
}

// A reading beyond the two intervals that are remembered, of more. Leaves come nearest first, so
// the first that reaches the reading or begins beyond it decides; two millimetres more, because
// readings_of() rounds to one.
Reading RayThresholds::classify_crowded(const SensorView& view, const BitOctree& background,
                                        std::size_t pixel, std::uint16_t raw) const {
  const float z = view.depth().z(raw);
  const float reach = view.depth().tolerance(raw) + 0.002F;
  Reading reading = is_open(pixel) ? Reading::kForeground : Reading::kUnknown;
  walk_ray(view, background, pixel, std::max(0.0F, z - reach), view.depth().z_max(),
           [&](float z_enter, float z_leave) {
             const RawInterval leaf = view.depth().readings_of(z_enter, z_leave);
             if (leaf.first > leaf.last || leaf.last < raw) return true;
             reading = leaf.first <= raw ? Reading::kBackground : Reading::kForeground;
             return false;
           });
  return reading;
}

void RayThresholds::classify(const SensorView& view, const BitOctree& background, DepthImage image,
                             std::span<std::uint64_t> foreground,
                             std::span<std::uint64_t> unknown) const {
  const std::size_t whole = image.pixel_count() / 64;
  const IntervalArrays arrays{near_.data(),        near_all_,          far_most_.data(),
                              far_least_.data(),   first_near_.data(), first_far_.data(),
                              second_near_.data(), second_far_.data()};
  kernel_(image.pixels, arrays, whole, foreground.data(), unknown.data());
  for (std::size_t word = 0; word < whole; ++word) {
    const std::uint64_t told = foreground[word] | unknown[word];
    if (told == 0) continue;
    const std::uint64_t doubtful = foreground[word] & unknown[word];
    const std::uint64_t one_by_one = (told & crowded_[word]) | doubtful;
    const std::uint64_t open = unknown[word] & open_[word];
    foreground[word] |= open;
    unknown[word] ^= open;
    if (one_by_one != 0) {
      classify_pixels(view, background, image, one_by_one, word, foreground, unknown);
    }
  }
  if (image.pixel_count() % 64 == 0) return;
  const std::uint64_t rest = ~(~std::uint64_t{0} << (image.pixel_count() % 64));
  foreground[whole] = unknown[whole] = 0;
  classify_pixels(view, background, image, rest, whole, foreground, unknown);
}

void RayThresholds::classify_pixels(const SensorView& view, const BitOctree& background,
                                    DepthImage image, std::uint64_t which, std::size_t word,
                                    std::span<std::uint64_t> foreground,
                                    std::span<std::uint64_t> unknown) const {
  for (; which != 0; which &= which - 1) {
    const auto place = static_cast<std::size_t>(std::countr_zero(which));
    const std::size_t pixel = word * 64 + place;
    const Reading reading = classify(view, background, pixel, image.pixels[pixel]);
    const std::uint64_t bit = std::uint64_t{1} << place;
    foreground[word] &= ~bit;
    unknown[word] &= ~bit;
    if (reading == Reading::kForeground) foreground[word] |= bit;
    if (reading == Reading::kUnknown) unknown[word] |= bit;
  }
}

// From the intervals: where the first reading that could be of a leaf stops, the leaf begins.
bool RayThresholds::is_near_background(const SensorView& view, const BitOctree& background,
                                       std::size_t pixel, std::uint16_t raw, float times) const {
  const DepthModel& depth = view.depth();
  const float z = depth.z(raw), reach = times * depth.tolerance(raw);
  const auto reaches = [&](RawInterval readings) {
    return readings.first <= readings.last &&
           z + reach >= depth.z(readings.first) + depth.tolerance(readings.first) &&
           z - reach <= depth.z(readings.last) - depth.tolerance(readings.last);
  };
  if (reaches({first_near_[pixel], first_far_[pixel]}) || reaches(second(pixel))) return true;
  if (!is_crowded(pixel) || z + reach < depth.z(second_far_[pixel])) return false;
  bool found = false;
  walk_ray(view, background, pixel, std::max(0.0F, z - reach), z + reach, [&](float, float) {
    found = true;
    return false;
  });
  return found;
}

void RayThresholds::forgive(const SensorView& view, const BitOctree& background, DepthImage image,
                            std::span<const std::uint8_t> noise,
                            std::span<std::uint64_t> foreground,
                            std::span<std::uint64_t> unknown) const {
  constexpr std::uint8_t kAsStated = 16;
  for (std::size_t word = 0; word < foreground.size(); ++word) {
    std::uint64_t forgiven = 0;
    for (std::uint64_t rest = foreground[word] | unknown[word]; rest != 0; rest &= rest - 1) {
      const std::size_t pixel = word * 64 + static_cast<std::size_t>(std::countr_zero(rest));
      if (noise[pixel] <= kAsStated) continue;
      const float times = static_cast<float>(noise[pixel]) / kAsStated;
      if (is_near_background(view, background, pixel, image.pixels[pixel], times))
        forgiven |= rest & -rest;
    }
    foreground[word] &= ~forgiven;
    unknown[word] &= ~forgiven;
  }
}

}  // namespace wagonsight

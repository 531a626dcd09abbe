#include "foreground/ray_thresholds.h"

#include <algorithm>
#include <cmath>

#include "base/check.h"
#include "foreground/ray_walk.h"

namespace wagonsight {

RayThresholds::RayThresholds(const SensorView& view)
    : width_(static_cast<std::size_t>(view.width())),
      height_(static_cast<std::size_t>(view.height())),
      tiles_x_((width_ + kTile - 1) / kTile),
      tiles_y_((height_ + kTile - 1) / kTile),
      marked_(tiles_x_ * tiles_y_) {
  const std::size_t pixels = view.pixel_count();
  const std::size_t words = (pixels + 63) / 64;
  for (auto* array :
       {&near_, &far_, &first_near_, &first_far_, &second_near_, &second_far_, &unknown_above_}) {
    *array = std::make_unique<std::uint16_t[]>(pixels);
  }
  open_ = std::make_unique<std::uint64_t[]>(words);
  crowded_ = std::make_unique<std::uint64_t[]>(words);
  tile_marked_ = std::make_unique<std::uint8_t[]>(tile_count());
  for (std::size_t pixel = 0; pixel < pixels; ++pixel) {
    const RawInterval inside = view.inside(pixel);
    near_[pixel] = inside.first;
    far_[pixel] = inside.last;
  }
  std::fill_n(first_near_.get(), pixels, std::uint16_t{1});
  std::fill_n(second_near_.get(), pixels, std::uint16_t{1});
}

RayThresholds::Intervals RayThresholds::intervals_of(const SensorView& view,
                                                     const BitOctree& background,
                                                     std::size_t pixel) const {
  Intervals result;
  if (!view.has_ray(pixel)) return result;
  int count = 0;
  RawInterval open;  // the interval that may still grow
  const auto close = [&] {
    if (open.first > open.last) return;
    if (count == 0) {
      result.first = open;
    } else if (count == 1) {
      result.second = open;
    } else {
      result.more = true;
    }
    ++count;
    result.last = std::max(result.last, open.last);
  };
  const float z_max = view.depth().z(view.depth().raw_far()) + 1.0F;
  walk_ray(view, background, pixel, 0.0F, z_max, [&](float z_enter, float z_leave) {
    const RawInterval leaf = view.depth().readings_of(z_enter, z_leave);
    if (leaf.first > leaf.last) return true;
    if (open.first <= open.last && leaf.first <= open.last + 1) {
      open.last = std::max(open.last, leaf.last);
    } else {
      close();
      open = leaf;
    }
    return true;
  });
  close();
  return result;
}

Reading RayThresholds::classify_by_octree(const SensorView& view, const BitOctree& background,
                                          std::size_t pixel, std::uint16_t raw) const {
  if (raw == 0 || raw < near_[pixel] || raw > far_[pixel]) return Reading::kOutside;
  const float z_max = view.depth().z(view.depth().raw_far()) + 1.0F;
  bool hit = false;
  std::uint16_t last = 0;
  walk_ray(view, background, pixel, 0.0F, z_max, [&](float z_enter, float z_leave) {
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
  if (raw == 0 || raw < near_[pixel] || raw > far_[pixel]) return Reading::kOutside;
  if (raw >= first_near_[pixel] && raw <= first_far_[pixel]) return Reading::kBackground;
  if (raw >= second_near_[pixel] && raw <= second_far_[pixel]) return Reading::kBackground;
  if (((crowded_[pixel / 64] >> (pixel % 64)) & 1) != 0 && raw > second_far_[pixel]) {
    return classify_by_octree(view, background, pixel, raw);
  }
  return raw <= unknown_above_[pixel] ? Reading::kForeground : Reading::kUnknown;
}

void RayThresholds::classify(const SensorView& view, const BitOctree& background, DepthImage image,
                             std::span<std::uint64_t> foreground,
                             std::span<std::uint64_t> unknown) const {
  const std::size_t pixels = image.pixel_count();
  for (std::size_t word = 0; word * 64 < pixels; ++word) {
    std::uint64_t is_foreground = 0, is_unknown = 0;
    const std::size_t end = std::min(pixels, word * 64 + 64);
    for (std::size_t pixel = word * 64; pixel < end; ++pixel) {
      const Reading reading = classify(view, background, pixel, image.pixels[pixel]);
      is_foreground |= std::uint64_t{reading == Reading::kForeground} << (pixel & 63);
      is_unknown |= std::uint64_t{reading == Reading::kUnknown} << (pixel & 63);
    }
    foreground[word] = is_foreground;
    unknown[word] = is_unknown;
  }
}

void RayThresholds::set_open(std::size_t pixel) {
  open_[pixel / 64] |= std::uint64_t{1} << (pixel % 64);
  unknown_above_[pixel] = UINT16_MAX;
}

void RayThresholds::clear_open() {
  std::fill_n(open_.get(), (width_ * height_ + 63) / 64, std::uint64_t{0});
  all_changed();
}

void RayThresholds::mark_tile(std::size_t tile) {
  if (tile_marked_[tile] != 0) return;
  tile_marked_[tile] = 1;
  // A marked tile is listed once; tiles that are done are removed from the front when all are.
  if (marked_.full()) {
    std::copy(marked_.begin() + marked_done_, marked_.end(), marked_.begin());
    marked_.resize(marked_.size() - marked_done_);
    marked_done_ = 0;
  }
  WS_CHECK(marked_.try_push_back(static_cast<std::uint32_t>(tile)), "%zu tiles", tile_count());
}

void RayThresholds::leaf_changed(const SensorView& view, LeafAddress leaf) {
  const LeafGrid& grid = view.grid();
  const Eigen::Vector3f centre = grid.centre(grid.leaf_at(leaf)).cast<float>();
  const float half_diagonal = 0.87F * static_cast<float>(grid.leaf_m());
  const auto seen = view.project_anywhere(centre);
  if (!seen) return;
  if (seen->z < 2 * half_diagonal) {
    all_changed();  // so near that its outline cannot be bounded
    return;
  }
  // A pixel more for the rounding of rays and of this projection.
  // Off the axis a ball's outline is longer than on it.
  const float stretch = (centre - view.origin_W()).norm() / seen->z;
  const float radius = view.focal() * half_diagonal * stretch / (seen->z - half_diagonal) + 1.0F;
  const auto tile_of = [](float pixel, std::size_t tiles) {
    const float tile = std::floor(pixel / static_cast<float>(kTile));
    return static_cast<std::size_t>(std::clamp(tile, 0.0F, static_cast<float>(tiles - 1)));
  };
  if (seen->u + radius < 0 || seen->v + radius < 0 ||
      seen->u - radius > static_cast<float>(width_) ||
      seen->v - radius > static_cast<float>(height_)) {
    return;
  }
  const std::size_t u_last = tile_of(seen->u + radius, tiles_x_);
  const std::size_t v_last = tile_of(seen->v + radius, tiles_y_);
  for (std::size_t v = tile_of(seen->v - radius, tiles_y_); v <= v_last; ++v) {
    for (std::size_t u = tile_of(seen->u - radius, tiles_x_); u <= u_last; ++u) {
      mark_tile(v * tiles_x_ + u);
    }
  }
}

void RayThresholds::all_changed() {
  for (std::size_t tile = 0; tile < tile_count(); ++tile) mark_tile(tile);
}

std::size_t RayThresholds::refresh(const SensorView& view, const BitOctree& background,
                                   std::size_t tiles_max) {
  for (; tiles_max > 0 && marked_done_ < marked_.size(); --tiles_max, ++marked_done_) {
    refresh_tile(view, background, marked_[marked_done_]);
  }
  if (marked_done_ == marked_.size()) {
    marked_.clear();
    marked_done_ = 0;
  }
  return marked_.size() - marked_done_;
}

void RayThresholds::refresh_tile(const SensorView& view, const BitOctree& background,
                                 std::size_t tile) {
  tile_marked_[tile] = 0;
  const std::size_t u_first = tile % tiles_x_ * kTile, v_first = tile / tiles_x_ * kTile;
  const std::size_t u_end = std::min(width_, u_first + kTile);
  const std::size_t v_end = std::min(height_, v_first + kTile);
  for (std::size_t v = v_first; v < v_end; ++v) {
    for (std::size_t u = u_first; u < u_end; ++u) {
      const std::size_t pixel = v * width_ + u;
      const Intervals intervals = intervals_of(view, background, pixel);
      first_near_[pixel] = intervals.first.first;
      first_far_[pixel] = intervals.first.last;
      second_near_[pixel] = intervals.second.first;
      second_far_[pixel] = intervals.second.last;
      unknown_above_[pixel] = is_open(pixel) ? UINT16_MAX : intervals.last;
      const std::uint64_t bit = std::uint64_t{1} << (pixel % 64);
      std::uint64_t& crowded = crowded_[pixel / 64];
      crowded = intervals.more ? crowded | bit : crowded & ~bit;
    }
  }
}

}  // namespace wagonsight

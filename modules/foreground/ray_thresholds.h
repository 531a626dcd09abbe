#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "base/bounded_vector.h"
#include "foreground/sensor_view.h"
#include "voxel/bit_octree.h"

namespace wagonsight {

// What a reading says about the background along its pixel's ray.
enum class Reading : std::uint8_t {
  kOutside,     // invalid, trimmed, or not inside the wagon
  kBackground,  // a background leaf lies within the noise
  kForeground,  // nearer than known background, or on a ray that is known to be empty
  kUnknown,     // beyond all that is known of this ray
};

// The octree of the background, remembered as intervals of raw readings for every pixel. The octree
// stays the truth: where a tile of pixels is up to date, classify() equals classify_by_octree().
// Allocates in the constructor only.
class RayThresholds {
 public:
  explicit RayThresholds(const SensorView& view);

  // The definition: walks the pixel's ray through the octree's leaves.
  Reading classify_by_octree(const SensorView& view, const BitOctree& background, std::size_t pixel,
                             std::uint16_t raw) const;
  // The same from the remembered intervals.
  Reading classify(const SensorView& view, const BitOctree& background, std::size_t pixel,
                   std::uint16_t raw) const;
  // The same for a whole image: a bit a pixel each, words of 64 pixels of one row after the other.
  void classify(const SensorView& view, const BitOctree& background, DepthImage image,
                std::span<std::uint64_t> foreground, std::span<std::uint64_t> unknown) const;

  // A ray on which nothing is background as far as the wagon goes: whatever is in it is foreground.
  void set_open(std::size_t pixel);
  bool is_open(std::size_t pixel) const { return (open_[pixel / 64] >> (pixel % 64) & 1) != 0; }
  bool has_background(std::size_t pixel) const { return first_near_[pixel] <= first_far_[pixel]; }
  std::span<const std::uint64_t> open_rays() const {
    return {open_.get(), (width_ * height_ + 63) / 64};
  }
  // No opinion of any pixel.
  void clear_open();

  // Marks what a leaf that came or went may have changed.
  void leaf_changed(const SensorView& view, LeafAddress leaf);
  void all_changed();
  // Brings at most `tiles_max` marked tiles up to date; returns how many are left.
  std::size_t refresh(const SensorView& view, const BitOctree& background, std::size_t tiles_max);
  std::size_t tile_count() const { return tiles_x_ * tiles_y_; }

 private:
  static constexpr std::size_t kTile = 4;  // pixels along u and v; a leaf covers 2 to 12

  struct Intervals {  // two at most; `more`: there are others beyond them, up to `last`
    RawInterval first, second;
    std::uint16_t last = 0;
    bool more = false;
  };
  Intervals intervals_of(const SensorView& view, const BitOctree& background,
                         std::size_t pixel) const;
  void refresh_tile(const SensorView& view, const BitOctree& background, std::size_t tile);
  void mark_tile(std::size_t tile);

  std::size_t width_, height_, tiles_x_, tiles_y_;
  std::unique_ptr<std::uint16_t[]> near_, far_;  // inside the wagon
  std::unique_ptr<std::uint16_t[]> first_near_, first_far_, second_near_, second_far_;
  std::unique_ptr<std::uint16_t[]> unknown_above_;
  std::unique_ptr<std::uint64_t[]> open_, crowded_;  // a bit a pixel
  std::unique_ptr<std::uint8_t[]> tile_marked_;
  BoundedVector<std::uint32_t> marked_;
  std::size_t marked_done_ = 0;
};

}  // namespace wagonsight

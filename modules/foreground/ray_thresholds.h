#pragma once

#include <cstdint>
#include <span>

#include "base/bounded_vector.h"
#include "foreground/interval_kernel.h"
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
// stays the truth: told of every leaf that comes or goes, classify() equals classify_by_octree().
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

  // Takes from both what noise may have carried away from the background, where a reading is more
  // uncertain than its sensor's noise says: `noise` has a byte a pixel, the reading's standard
  // deviation in 16ths of DepthModel's (16 and less changes nothing).
  void forgive(const SensorView& view, const BitOctree& background, DepthImage image,
               std::span<const std::uint8_t> noise, std::span<std::uint64_t> foreground,
               std::span<std::uint64_t> unknown) const;
  // The test of one reading: does background lie within `times` the noise of it?
  bool is_near_background(const SensorView& view, const BitOctree& background, std::size_t pixel,
                          std::uint16_t raw, float times) const;

  // A ray on which nothing is background as far as the wagon goes: whatever is in it is foreground.
  void set_open(std::size_t pixel);
  bool is_open(std::size_t pixel) const { return (open_[pixel / 64] >> (pixel % 64) & 1) != 0; }
  bool has_background(std::size_t pixel) const { return first_near_[pixel] <= first_far_[pixel]; }
  std::span<const std::uint64_t> open_rays() const { return open_.span(); }
  // The pixels of a word (64 from word * 64) of whose ray nothing is known.
  std::uint64_t unknown_rays(std::size_t word) const { return ~(open_[word] | known_[word]); }

  // A leaf came: its readings join those of the pixels whose rays pass through it. Returns how many
  // pixels were looked at.
  std::size_t leaf_added(const SensorView& view, const BitOctree& background, LeafAddress leaf);
  // A leaf went: those pixels' rays must be walked again, once by settle() whatever the number of
  // their leaves that went.
  void leaf_removed(const SensorView& view, LeafAddress leaf);
  // After leaf_removed() and before classify().
  void settle(const SensorView& view, const BitOctree& background);
  // Forgets everything, as for an empty octree.
  void reset();

 private:
  struct Intervals {  // of background readings, ascending, apart by one at least
    RawInterval first, second;
    bool more = false;  // there are more than two
    void append(RawInterval next);
  };
  Intervals walk(const SensorView& view, const BitOctree& background, std::size_t pixel,
                 float z_from, float z_to) const;
  void walk_again(const SensorView& view, const BitOctree& background, std::size_t pixel);
  void join(const SensorView& view, const BitOctree& background, std::size_t pixel,
            RawInterval readings);
  void store(std::size_t pixel, const Intervals& intervals);
  bool is_crowded(std::size_t pixel) const {
    return ((crowded_[pixel / 64] >> (pixel % 64)) & 1) != 0;
  }
  // Calls visit(pixel, z_enter, z_leave) for every pixel whose ray passes through the leaf; returns
  // how many were tried.
  template <class Visit>
  std::size_t visit_pixels(const SensorView& view, LeafAddress leaf, Visit&& visit) const;

  std::uint16_t near_of(std::size_t pixel) const {
    return near_.empty() ? near_all_ : near_[pixel];
  }
  bool is_outside(const SensorView& view, std::size_t pixel, std::uint16_t raw) const {
    if (raw == 0 || raw < near_of(pixel) || raw > far_most_[pixel / 64]) return true;
    return raw > far_least_[pixel / 64] && !view.is_inside(pixel, raw);
  }
  RawInterval second(std::size_t pixel) const { return {second_near_[pixel], second_far_[pixel]}; }
  Reading classify_crowded(const SensorView& view, const BitOctree& background, std::size_t pixel,
                           std::uint16_t raw) const;
  void classify_pixels(const SensorView& view, const BitOctree& background, DepthImage image,
                       std::uint64_t which, std::size_t word, std::span<std::uint64_t> foreground,
                       std::span<std::uint64_t> unknown) const;

  std::size_t width_, height_;
  IntervalKernel kernel_;
  std::uint16_t near_all_;
  BoundedVector<std::uint16_t> near_;  // inside the wagon from here; empty: from near_all_
  // To here by word of 64 pixels: the farthest and the nearest of their ends, 0: nowhere. Only of
  // readings in between the pixel's own end is worked out.
  BoundedVector<std::uint16_t> far_most_, far_least_;
  BoundedVector<std::uint16_t> first_near_, first_far_;
  // Where there is no second interval it begins behind every reading and ends where the first does.
  BoundedVector<std::uint16_t> second_near_, second_far_;
  BoundedVector<std::uint64_t> open_;     // a bit a pixel, as all that follow
  BoundedVector<std::uint64_t> known_;    // there is background on the ray
  BoundedVector<std::uint64_t> crowded_;  // there are more than two intervals
  BoundedVector<std::uint64_t> stale_;    // waits for settle()
  bool any_stale_ = false;
};

}  // namespace wagonsight

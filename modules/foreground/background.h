#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "base/bounded_vector.h"
#include "base/time.h"
#include "foreground/ray_thresholds.h"
#include "foreground/sensor_view.h"
#include "voxel/bit_octree.h"
#include "voxel/evidence_pool.h"

namespace wagonsight {

// What of a sensor's view never moves, as leaves of an octree, each with the evidence for it: how
// often something was there and how often it was seen through. Time is cut into rounds of a quarter
// of a second (or a frame, when frames come slower), so that a leaf gets one vote a round at any
// frame rate. Allocates in the constructor only, except where said. Not thread-safe.
class Background {
 public:
  // `evidence_nodes_max`: how many nodes of 64 leaves can have evidence at a time.
  explicit Background(const SensorView& view, std::size_t evidence_nodes_max = kEvidenceNodesMax);

  // Takes one frame as evidence for and against every leaf. Costs some milliseconds.
  void gather(const SensorView& view, DepthImage image);
  // Background is what was there in most of the rounds in which its place could be seen.
  void decide(const SensorView& view);

  // Everything in this image is taken for background until it is seen through.
  void assume(const SensorView& view, DepthImage image);
  // The same for the next rows of the image only, as many as `work_max` allows and one at least;
  // returns the work done: pixels that were looked at, once each and again for every new leaf that
  // may lie on their rays. Rows are taken from the image in which their turn comes, first to last.
  std::size_t assume_rows(const SensorView& view, DepthImage image, std::size_t work_max);
  int assumed_rows() const { return assumed_rows_; }
  // Starts a round when one is due; says which share of a round this frame is.
  float advance(HostTime instant);
  // Surfaces seen beyond all background (`unknown`), and noise (`noise`), become background when
  // they persist; readings of accepted foreground never do.
  void observe_new(const SensorView& view, DepthImage image, std::span<const std::uint64_t> unknown,
                   std::span<const std::uint64_t> noise);
  // Projects this frame's share of the background leaves into the image: seen again, or seen
  // through.
  void observe_free(const SensorView& view, DepthImage image, float round_share);
  // Rays on which nothing comes back, or only from beyond the wagon, become known to be empty.
  void observe_empty(const SensorView& view, DepthImage image, float round_share,
                     int rounds_needed);

  const BitOctree& leaves() const { return leaves_; }
  const RayThresholds& thresholds() const { return thresholds_; }
  double known_share(const SensorView& view) const;
  std::uint32_t rounds() const { return rounds_; }
  const EvidencePool& evidence() const { return evidence_; }

  // Allocate.
  void save(std::vector<std::byte>& bytes) const;
  bool load(const SensorView& view, std::span<const std::byte> bytes);

 private:
  enum class Seen : std::uint8_t { kNothing, kThere, kThrough };
  Seen look(const SensorView& view, DepthImage image, const LeafIndex& leaf) const;
  // The reading's leaf when it is new background, or kNoLeaf.
  LeafAddress assume_reading(const SensorView& view, DepthImage image, std::size_t pixel);
  void redo_thresholds(const SensorView& view);
  void add_leaf(const SensorView& view, LeafAddress leaf);
  void remove_leaf(const SensorView& view, LeafAddress leaf);
  void hit(const SensorView& view, LeafAddress leaf, int hits_needed);
  void forget_candidates();
  void fade_candidates(float round_share);
  bool is_candidate(BrickAddress brick) const {
    return ((candidate_[brick / 64] >> (brick % 64)) & 1) != 0;
  }
  // Gives the counters of a brick back that is neither background nor about to become it.
  void release_if_idle(BrickAddress brick);

  BitOctree leaves_;
  EvidencePool evidence_;
  RayThresholds thresholds_;
  std::unique_ptr<std::uint8_t[]> empty_rounds_;  // by pixel
  std::uint32_t rounds_ = 0;
  std::uint32_t vote_ = 2;  // each leaf gets one vote of this number; the one before is vote_ - 1
  int assumed_rows_ = 0;
  bool started_ = false;
  bool slow_frames_ = false;  // a frame is a round
  HostTime last_instant_{}, round_start_{};
  BoundedVector<BrickAddress> candidates_;      // bricks with hits in leaves that are no background
  std::unique_ptr<std::uint64_t[]> candidate_;  // a bit a brick: it is in candidates_
  std::size_t next_leaf_brick_ = 0, next_pixel_ = 0, next_candidate_ = 0;
  float fade_share_ = 0;
  std::uint32_t gathered_ = 0;
};

}  // namespace wagonsight

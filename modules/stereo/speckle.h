#pragma once

#include <cstdint>

#include "frame/image.h"
#include "stereo/aligned_array.h"

namespace wagonsight {

// Removes small islands from a disparity image: a connected region (by edges; neighbours whose
// disparities differ by no more than a limit belong together) of fewer pixels than wanted becomes
// invalid. Union-find over runs of a row, in memory allocated at construction.
class SpeckleFilter {
 public:
  // Edges of the image beyond which there is more: an island that touches one is not small.
  struct OpenEdges {
    bool left = false, top = false, right = false, bottom = false;
  };

  SpeckleFilter(int width_max, int height_max);

  // Negative disparities are invalid and belong to no region. One thread at a time.
  void apply(ImageView<std::int16_t> disparity, int pixels_min, int difference_max,
             const OpenEdges& open);
  void apply(ImageView<std::int16_t> disparity, int pixels_min, int difference_max) {
    apply(disparity, pixels_min, difference_max, OpenEdges{});
  }

  std::size_t workspace_bytes() const {
    return runs_.size() * sizeof(Run) + row_begin_.size() * sizeof(std::int32_t);
  }

 private:
  struct Run {
    std::int32_t parent;  // index of a run, itself at a root
    std::int32_t pixels;  // of the whole region at a root
    std::int16_t begin;
    std::int16_t end;
  };
  std::int32_t root(std::int32_t run);
  void join(std::int32_t a, std::int32_t b);
  std::int32_t append_runs(const std::int16_t* row, int width, int difference_max,
                           std::int32_t count);
  void join_rows(const std::int16_t* upper, const std::int16_t* lower, std::int32_t first_upper,
                 std::int32_t first_lower, std::int32_t end_lower, int difference_max);

  int width_max_;
  int height_max_;
  AlignedArray<Run> runs_;
  AlignedArray<std::int32_t> row_begin_;
};

}  // namespace wagonsight

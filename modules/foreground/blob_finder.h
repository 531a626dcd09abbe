#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "base/bounded_vector.h"
#include "foreground/foreground.h"
#include "foreground/sensor_view.h"
#include "frame/image.h"
#include "voxel/voxel_grid.h"

namespace wagonsight {

// What finding the blobs of one image needs to write in. Nothing of it lasts until the next image,
// so the sensors of one thread share one. Allocates in the constructor only.
class BlobWorkspace {
 public:
  explicit BlobWorkspace(double voxel_m);

 private:
  friend class BlobFinder;
  // Pixels of one row that are foreground or unknown, without a jump in depth.
  struct Run {
    std::uint16_t v, first, last;        // inclusive
    std::uint16_t foreground_pixels;     // of them
    std::uint32_t parent;                // while labelling; then the root
    float depth, area, foreground_area;  // sums over its pixels; areas in pixels at one metre
  };
  struct Component {
    std::uint32_t foreground_pixels = 0, pixels = 0;
    float foreground_area = 0, area = 0, depth = 0;  // sums
    std::uint16_t u_min = UINT16_MAX, u_max = 0, v_min = UINT16_MAX, v_max = 0;
    std::int32_t blob = -1;
  };

  BoundedVector<Run> runs_;
  FreshArray<Component> components_;      // by root run
  BoundedVector<std::uint32_t> by_blob_;  // kept runs, blob by blob
  VoxelGrid voxels_;
};

// Connected components of the foreground in the image plane (the paper's projection on a 2D plane,
// lines 8 to 11 of Algorithm 1), split where depth jumps, kept where large enough in square metres.
// Run-length union-find (He, Chao and Suzuki 2008). Allocates in the constructor only.
class BlobFinder {
 public:
  BlobFinder(const SensorView& view, double blob_area_min_m2, double large_area_m2, double voxel_m,
             std::shared_ptr<BlobWorkspace> workspace);

  // Components over `foreground` or `unknown` pixels. One is kept when its foreground pixels alone
  // reach the area and are at least a quarter of it; its unknown pixels are then kept with it.
  // Fills out.mask, blobs and points (lines 8 to 12). `rejected` gets the foreground pixels of
  // dropped components.
  void find(const SensorView& view, DepthImage image, std::span<const std::uint64_t> foreground,
            std::span<const std::uint64_t> unknown, std::span<std::uint64_t> rejected,
            Foreground& out);

  // Pixels of the last image's kept blobs of at least large_area_m2.
  std::span<const std::uint64_t> large_mask() const { return large_mask_.span(); }
  std::uint64_t runs_dropped() const { return runs_dropped_; }
  std::shared_ptr<BlobWorkspace> workspace() const { return workspace_; }
  void use(const std::shared_ptr<BlobWorkspace>& workspace) { workspace_ = workspace; }

 private:
  using Run = BlobWorkspace::Run;
  using Component = BlobWorkspace::Component;
  class RunWriter;

  void collect_runs(const SensorView& view, DepthImage image,
                    std::span<const std::uint64_t> foreground,
                    std::span<const std::uint64_t> unknown);
  bool touches(DepthImage image, const Run& above, const Run& below) const;
  void join_rows(DepthImage image, std::size_t above_first, std::size_t row_first,
                 std::size_t row_end);
  std::uint32_t root(std::uint32_t run);
  void measure();
  void keep_large(Foreground& out);
  void write_mask(std::span<const std::uint64_t> foreground, std::span<std::uint64_t> rejected,
                  Foreground& out);
  void reduce(const SensorView& view, DepthImage image, Foreground& out);
  void keep_dense(const SensorView& view, std::uint16_t blob, Foreground& out);

  std::shared_ptr<BlobWorkspace> workspace_;
  float area_min_, large_area_, pixel_area_, leaf_pixels_at_1m_;
  std::size_t width_;
  std::unique_ptr<std::uint16_t[]> jump_;  // raw units, by raw reading
  BoundedVector<std::uint64_t> large_mask_;
  std::uint64_t runs_dropped_ = 0;
};

}  // namespace wagonsight

#include "foreground/blob_finder.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

namespace wagonsight {
namespace {

// Neighbouring pixels of one body differ by less than this besides the noise: an arm's thickness.
constexpr float kDepthJump_m = 0.10F;
// Of a component's pixels so many must be foreground for certain.
constexpr float kForegroundShareMin = 0.25F;
// A voxel with fewer than this share of the pixels that a facing surface puts in it is noise.
constexpr float kDensityMin = 0.08F;

// Sets bits first..last (inclusive) of `to` that are set in `from`, or all when `from` is empty.
void copy_bits(std::span<std::uint64_t> to, std::span<const std::uint64_t> from, std::size_t first,
               std::size_t last) {
  for (std::size_t word = first / 64; word <= last / 64; ++word) {
    std::uint64_t bits = ~std::uint64_t{0};
    if (word == first / 64) bits &= ~std::uint64_t{0} << (first % 64);
    if (word == last / 64) bits &= ~std::uint64_t{0} >> (63 - last % 64);
    to[word] |= from.empty() ? bits : bits & from[word];
  }
}

// Pixels become points so many at a time.
constexpr std::size_t kTogether = 256;

}  // namespace

BlobWorkspace::BlobWorkspace(double voxel_m)
    : runs_(kRunsMax),
      components_(make_fresh_array<Component>(kRunsMax)),
      by_blob_(kRunsMax),
      voxels_(kSensorPointsMax, voxel_m) {}

BlobFinder::BlobFinder(const SensorView& view, double blob_area_min_m2, double large_area_m2,
                       double voxel_m, std::shared_ptr<BlobWorkspace> workspace)
    : workspace_(std::move(workspace)),
      area_min_(static_cast<float>(blob_area_min_m2)),
      large_area_(static_cast<float>(large_area_m2)),
      pixel_area_(view.pixel_area()),
      leaf_pixels_at_1m_(static_cast<float>(voxel_m * voxel_m) / view.pixel_area()),
      width_(static_cast<std::size_t>(view.width())),
      jump_(std::make_unique<std::uint16_t[]>(std::size_t{view.depth().raw_far()} + 1)),
      large_mask_((view.pixel_count() + 63) / 64) {
  large_mask_.resize(large_mask_.capacity());
  const DepthModel& depth = view.depth();
  const float per_unit = depth.z(depth.raw_far()) - depth.z(depth.raw_far() - 1);
  for (std::uint16_t raw = 0; raw < depth.raw_far(); ++raw) {
    jump_[raw] = static_cast<std::uint16_t>((kDepthJump_m + depth.tolerance(raw)) / per_unit);
  }
  jump_[depth.raw_far()] = jump_[depth.raw_far() - 1];
}

void BlobFinder::find(const SensorView& view, DepthImage image,
                      std::span<const std::uint64_t> foreground,
                      std::span<const std::uint64_t> unknown, std::span<std::uint64_t> rejected,
                      Foreground& out) {
  std::fill(out.mask.begin(), out.mask.end(), std::uint64_t{0});
  std::fill(rejected.begin(), rejected.end(), std::uint64_t{0});
  std::fill(large_mask_.begin(), large_mask_.end(), std::uint64_t{0});
  out.blobs.clear();
  out.points.clear();
  out.points_dropped = 0;
  collect_runs(view, image, foreground, unknown);
  measure();
  keep_large(out);
  write_mask(foreground, rejected, out);
  reduce(view, image, out);
}

// Cuts the pixels of one row into runs and sums them up on the way.
class BlobFinder::RunWriter {
 public:
  RunWriter(BlobFinder& finder, const DepthModel& depth, DepthImage image)
      : finder_(finder), runs_(finder.workspace_->runs_), depth_(depth), image_(image) {}

  void begin_row(int v) {
    row_ = image_.pixels + image_.index(0, v);
    run_.v = static_cast<std::uint16_t>(v);
    open_ = false;
  }
  // Pixels first..last of the row; bit i of `foreground` belongs to pixel first + i.
  void take(std::size_t first, std::size_t last, std::uint64_t foreground) {
    if (open_ && first != std::size_t{run_.last} + 1) end_run();
    std::size_t u = first;
    if (!open_) start_run(u);
    while (u <= last) {
      const std::uint16_t raw = row_[u];
      if (u > run_.first && std::abs(raw - row_[u - 1]) > finder_.jump_[raw]) {
        run_.last = static_cast<std::uint16_t>(u - 1);
        end_run();
        start_run(u);
      }
      const float z = depth_.z(raw), area = z * z;
      const std::uint64_t sure = (foreground >> (u - first)) & 1;
      run_.depth += z;
      run_.area += area;
      run_.foreground_area += sure != 0 ? area : 0.0F;
      run_.foreground_pixels = static_cast<std::uint16_t>(run_.foreground_pixels + sure);
      ++u;
    }
    run_.last = static_cast<std::uint16_t>(last);
  }
  void end_row() {
    if (open_) end_run();
  }

 private:
  void start_run(std::size_t u) {
    open_ = true;
    run_ = {run_.v, static_cast<std::uint16_t>(u), 0, 0, 0, 0, 0, 0};
  }
  void end_run() {
    open_ = false;
    run_.parent = static_cast<std::uint32_t>(runs_.size());
    if (!runs_.try_push_back(run_)) ++finder_.runs_dropped_;
  }

  BlobFinder& finder_;
  BoundedVector<Run>& runs_;
  const DepthModel& depth_;
  DepthImage image_;
  const std::uint16_t* row_ = nullptr;
  Run run_{};
  bool open_ = false;
};

void BlobFinder::collect_runs(const SensorView& view, DepthImage image,
                              std::span<const std::uint64_t> foreground,
                              std::span<const std::uint64_t> unknown) {
  const auto& runs = workspace_->runs_;
  workspace_->runs_.clear();
  RunWriter writer(*this, view.depth(), image);
  std::size_t above_first = 0, row_first = 0;
  for (int v = 0; v < image.height; ++v) {
    const std::size_t row = image.index(0, v), row_end = row + width_;
    writer.begin_row(v);
    for (std::size_t word = row / 64; word * 64 < row_end; ++word) {
      std::uint64_t bits = foreground[word] | unknown[word];
      if (word == row / 64) bits &= ~std::uint64_t{0} << (row % 64);
      if ((word + 1) * 64 > row_end) bits &= ~std::uint64_t{0} >> (64 - row_end % 64);
      while (bits != 0) {
        const auto from = static_cast<std::size_t>(std::countr_zero(bits));
        const auto count = static_cast<std::size_t>(std::countr_one(bits >> from));
        const std::size_t u = word * 64 + from - row;
        writer.take(u, u + count - 1, foreground[word] >> from);
        bits = from + count < 64 ? bits & (~std::uint64_t{0} << (from + count)) : 0;
      }
    }
    writer.end_row();
    join_rows(image, above_first, row_first, runs.size());
    above_first = row_first;
    row_first = runs.size();
  }
}

bool BlobFinder::touches(DepthImage image, const Run& above, const Run& below) const {
  const int first = std::max(above.first, below.first), last = std::min(above.last, below.last);
  for (int u = first; u <= last; ++u) {
    const std::uint16_t here = image.at(u, below.v);
    if (std::abs(image.at(u, above.v) - here) <= jump_[here]) return true;
  }
  return false;
}

std::uint32_t BlobFinder::root(std::uint32_t run) {
  auto& runs = workspace_->runs_;
  while (runs[run].parent != run) {
    runs[run].parent = runs[runs[run].parent].parent;
    run = runs[run].parent;
  }
  return run;
}

void BlobFinder::join_rows(DepthImage image, std::size_t above_first, std::size_t row_first,
                           std::size_t row_end) {
  auto& runs = workspace_->runs_;
  std::size_t above = above_first;
  for (std::size_t below = row_first; below < row_end;) {
    if (above == row_first) return;
    if (runs[above].last >= runs[below].first && runs[below].last >= runs[above].first &&
        touches(image, runs[above], runs[below])) {
      const std::uint32_t a = root(static_cast<std::uint32_t>(above));
      const std::uint32_t b = root(static_cast<std::uint32_t>(below));
      runs[std::max(a, b)].parent = std::min(a, b);
    }
    if (runs[above].last < runs[below].last) {
      ++above;
    } else {
      ++below;
    }
  }
}

void BlobFinder::measure() {
  auto& runs = workspace_->runs_;
  for (std::uint32_t index = 0; index < runs.size(); ++index) {
    Run& run = runs[index];
    run.parent = root(index);
    if (run.parent == index) workspace_->components_[index] = Component{};
    Component& component = workspace_->components_[run.parent];
    component.v_min = std::min(component.v_min, run.v);
    component.v_max = std::max(component.v_max, run.v);
    component.u_min = std::min(component.u_min, run.first);
    component.u_max = std::max(component.u_max, run.last);
    component.area += run.area * pixel_area_;
    component.foreground_area += run.foreground_area * pixel_area_;
    component.depth += run.depth;
    component.pixels += 1U + run.last - run.first;
    component.foreground_pixels += run.foreground_pixels;
  }
}

void BlobFinder::keep_large(Foreground& out) {
  const auto& runs = workspace_->runs_;
  for (std::uint32_t index = 0; index < runs.size(); ++index) {
    if (runs[index].parent != index) continue;
    Component& component = workspace_->components_[index];
    if (component.foreground_area < area_min_ ||
        component.foreground_area < kForegroundShareMin * component.area) {
      continue;
    }
    const Blob blob{component.u_min,
                    component.v_min,
                    component.u_max,
                    component.v_max,
                    component.pixels,
                    component.area,
                    component.depth / static_cast<float>(component.pixels)};
    if (out.blobs.try_push_back(blob)) {
      component.blob = static_cast<std::int32_t>(out.blobs.size()) - 1;
    }
  }
}

void BlobFinder::write_mask(std::span<const std::uint64_t> foreground,
                            std::span<std::uint64_t> rejected, Foreground& out) {
  const auto& components = workspace_->components_;
  std::array<std::uint32_t, kBlobsMax + 1> starts{};
  for (const Run& run : workspace_->runs_) {
    const std::size_t row = std::size_t{run.v} * width_;
    const Component& component = components[run.parent];
    if (component.blob < 0) {
      copy_bits(rejected, foreground, row + run.first, row + run.last);
    } else {
      copy_bits(out.mask.span(), {}, row + run.first, row + run.last);
      if (component.area >= large_area_) {
        copy_bits(large_mask_.span(), {}, row + run.first, row + run.last);
      }
      ++starts[static_cast<std::size_t>(component.blob) + 1];
    }
  }
  for (std::size_t blob = 1; blob < starts.size(); ++blob) starts[blob] += starts[blob - 1];
  workspace_->by_blob_.resize(starts.back());
  for (std::uint32_t index = 0; index < workspace_->runs_.size(); ++index) {
    const std::int32_t blob = components[workspace_->runs_[index].parent].blob;
    if (blob >= 0) workspace_->by_blob_[starts[static_cast<std::size_t>(blob)]++] = index;
  }
}

void BlobFinder::reduce(const SensorView& view, DepthImage image, Foreground& out) {
  const DepthModel& depth = view.depth();
  VoxelGrid& voxels = workspace_->voxels_;
  std::array<PixelRay, kTogether> rays;
  std::array<float, kTogether> z, x_W, y_W, z_W;
  std::size_t waiting = 0;
  const auto place_waiting = [&] {
    view.points_W(rays, {z.data(), waiting}, x_W.data(), y_W.data(), z_W.data());
    out.points_dropped += static_cast<std::uint32_t>(
        voxels.add({x_W.data(), waiting}, {y_W.data(), waiting}, {z_W.data(), waiting}));
    waiting = 0;
  };
  std::size_t next = 0;
  for (std::size_t blob = 0; blob < out.blobs.size(); ++blob) {
    voxels.clear();
    for (; next < workspace_->by_blob_.size(); ++next) {
      const Run& run = workspace_->runs_[workspace_->by_blob_[next]];
      if (workspace_->components_[run.parent].blob != static_cast<std::int32_t>(blob)) break;
      const std::size_t row = image.index(0, run.v), end = row + run.last + 1;
      for (std::size_t pixel = row + run.first; pixel < end;) {
        for (; pixel < end && waiting < kTogether; ++pixel, ++waiting) {
          rays[waiting] = view.ray(pixel);
          z[waiting] = depth.z(image.pixels[pixel]);
        }
        if (waiting == kTogether) place_waiting();
      }
    }
    place_waiting();
    keep_dense(view, static_cast<std::uint16_t>(blob), out);
  }
}

// Kammerl's density, a voxel's worth: what holds too few pixels for its distance is noise.
void BlobFinder::keep_dense(const SensorView& view, std::uint16_t blob, Foreground& out) {
  const VoxelGrid& voxels = workspace_->voxels_;
  for (std::size_t index = 0; index < voxels.size(); ++index) {
    const VoxelMean mean = voxels.mean(index);
    const float z = view.depth_of({mean.x, mean.y, mean.z});
    const float pixels = static_cast<float>(mean.points);
    if (pixels < kDensityMin * leaf_pixels_at_1m_ / (z * z)) continue;
    const ForegroundPoint point{
        mean.x,
        mean.y,
        mean.z,
        view.depth().sigma_at(z),
        static_cast<std::uint16_t>(std::min<std::uint32_t>(mean.points, UINT16_MAX)),
        blob};
    if (!out.points.try_push_back(point)) ++out.points_dropped;
  }
}

}  // namespace wagonsight

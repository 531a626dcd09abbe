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

bool bit(std::span<const std::uint64_t> bits, std::size_t index) {
  return ((bits[index / 64] >> (index % 64)) & 1) != 0;
}

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

}  // namespace

BlobFinder::BlobFinder(const SensorView& view, double blob_area_min_m2, double large_area_m2,
                       double voxel_m)
    : area_min_(static_cast<float>(blob_area_min_m2)),
      large_area_(static_cast<float>(large_area_m2)),
      leaf_pixels_at_1m_(static_cast<float>(voxel_m * voxel_m) / view.pixel_area()),
      width_(static_cast<std::size_t>(view.width())),
      jump_(std::make_unique<std::uint16_t[]>(std::size_t{view.depth().raw_far()} + 1)),
      runs_(kRunsMax),
      components_(std::make_unique<Component[]>(kRunsMax)),
      by_blob_(kRunsMax),
      large_mask_((view.pixel_count() + 63) / 64),
      voxels_(kSensorPointsMax, voxel_m) {
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
  measure(view, image, foreground);
  keep_large(out);
  write_mask(foreground, rejected, out);
  reduce(view, image, out);
}

void BlobFinder::add_run(int v, int first, int last) {
  const auto index = static_cast<std::uint32_t>(runs_.size());
  if (!runs_.try_push_back({static_cast<std::uint16_t>(v), static_cast<std::uint16_t>(first),
                            static_cast<std::uint16_t>(last), index})) {
    ++runs_dropped_;
  }
}

void BlobFinder::collect_runs(const SensorView& view, DepthImage image,
                              std::span<const std::uint64_t> foreground,
                              std::span<const std::uint64_t> unknown) {
  runs_.clear();
  std::size_t above_first = 0, row_first = 0;
  for (int v = 0; v < image.height; ++v) {
    const std::size_t row = image.index(0, v);
    int start = -1, last = -2;
    const auto take = [&](std::size_t pixel) {
      const int u = static_cast<int>(pixel - row);
      const bool goes_on =
          u == last + 1 &&
          std::abs(image.pixels[pixel] - image.pixels[pixel - 1]) <= jump_[image.pixels[pixel]];
      if (!goes_on) {
        if (start >= 0) add_run(v, start, last);
        start = u;
      }
      last = u;
    };
    const std::size_t row_end = row + width_;
    for (std::size_t word = row / 64; word * 64 < row_end; ++word) {
      std::uint64_t bits = foreground[word] | unknown[word];
      if (word == row / 64) bits &= ~std::uint64_t{0} << (row % 64);
      if ((word + 1) * 64 > row_end) bits &= ~std::uint64_t{0} >> (64 - row_end % 64);
      for (; bits != 0; bits &= bits - 1) {
        take(word * 64 + static_cast<std::size_t>(std::countr_zero(bits)));
      }
    }
    if (start >= 0) add_run(v, start, last);
    join_rows(view, image, above_first, row_first, runs_.size());
    above_first = row_first;
    row_first = runs_.size();
  }
}

bool BlobFinder::touches(const SensorView&, DepthImage image, const Run& above,
                         const Run& below) const {
  const int first = std::max(above.first, below.first), last = std::min(above.last, below.last);
  for (int u = first; u <= last; ++u) {
    const std::uint16_t here = image.at(u, below.v);
    if (std::abs(image.at(u, above.v) - here) <= jump_[here]) return true;
  }
  return false;
}

std::uint32_t BlobFinder::root(std::uint32_t run) {
  while (runs_[run].parent != run) {
    runs_[run].parent = runs_[runs_[run].parent].parent;
    run = runs_[run].parent;
  }
  return run;
}

void BlobFinder::join_rows(const SensorView& view, DepthImage image, std::size_t above_first,
                           std::size_t row_first, std::size_t row_end) {
  std::size_t above = above_first;
  for (std::size_t below = row_first; below < row_end;) {
    if (above == row_first) return;
    if (runs_[above].last >= runs_[below].first && runs_[below].last >= runs_[above].first &&
        touches(view, image, runs_[above], runs_[below])) {
      const std::uint32_t a = root(static_cast<std::uint32_t>(above));
      const std::uint32_t b = root(static_cast<std::uint32_t>(below));
      runs_[std::max(a, b)].parent = std::min(a, b);
    }
    if (runs_[above].last < runs_[below].last) {
      ++above;
    } else {
      ++below;
    }
  }
}

void BlobFinder::measure(const SensorView& view, DepthImage image,
                         std::span<const std::uint64_t> foreground) {
  for (std::uint32_t index = 0; index < runs_.size(); ++index) {
    Run& run = runs_[index];
    run.parent = root(index);
    if (run.parent == index) components_[index] = Component{};
    Component& component = components_[run.parent];
    component.v_min = std::min(component.v_min, run.v);
    component.v_max = std::max(component.v_max, run.v);
    component.u_min = std::min(component.u_min, run.first);
    component.u_max = std::max(component.u_max, run.last);
    const std::size_t row = image.index(0, run.v);
    for (std::size_t pixel = row + run.first; pixel <= row + run.last; ++pixel) {
      const float z = view.depth().z(image.pixels[pixel]);
      const float area = z * z * view.pixel_area();
      component.area += area;
      component.depth += z;
      ++component.pixels;
      if (bit(foreground, pixel)) {
        component.foreground_area += area;
        ++component.foreground_pixels;
      }
    }
  }
}

void BlobFinder::keep_large(Foreground& out) {
  for (std::uint32_t index = 0; index < runs_.size(); ++index) {
    if (runs_[index].parent != index) continue;
    Component& component = components_[index];
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
  std::array<std::uint32_t, kBlobsMax + 1> starts{};
  for (const Run& run : runs_) {
    const std::size_t row = std::size_t{run.v} * width_;
    const std::int32_t blob = components_[run.parent].blob;
    if (blob < 0) {
      copy_bits(rejected, foreground, row + run.first, row + run.last);
    } else {
      copy_bits(out.mask.span(), {}, row + run.first, row + run.last);
      if (components_[run.parent].area >= large_area_) {
        copy_bits(large_mask_.span(), {}, row + run.first, row + run.last);
      }
      ++starts[static_cast<std::size_t>(blob) + 1];
    }
  }
  for (std::size_t blob = 1; blob < starts.size(); ++blob) starts[blob] += starts[blob - 1];
  by_blob_.resize(starts.back());
  for (std::uint32_t index = 0; index < runs_.size(); ++index) {
    const std::int32_t blob = components_[runs_[index].parent].blob;
    if (blob >= 0) by_blob_[starts[static_cast<std::size_t>(blob)]++] = index;
  }
}

void BlobFinder::reduce(const SensorView& view, DepthImage image, Foreground& out) {
  const DepthModel& depth = view.depth();
  std::size_t next = 0;
  for (std::size_t blob = 0; blob < out.blobs.size(); ++blob) {
    voxels_.clear();
    for (; next < by_blob_.size(); ++next) {
      const Run& run = runs_[by_blob_[next]];
      if (components_[run.parent].blob != static_cast<std::int32_t>(blob)) break;
      const std::size_t row = image.index(0, run.v);
      for (std::size_t pixel = row + run.first; pixel <= row + run.last; ++pixel) {
        const Eigen::Vector3f p_W = view.point_W(pixel, depth.z(image.pixels[pixel]));
        if (!voxels_.add(p_W.x(), p_W.y(), p_W.z())) ++out.points_dropped;
      }
    }
    for (std::size_t index = 0; index < voxels_.size(); ++index) {
      const VoxelMean mean = voxels_.mean(index);
      const float z = view.depth_of({mean.x, mean.y, mean.z});
      const float pixels = static_cast<float>(mean.points);
      if (pixels < kDensityMin * leaf_pixels_at_1m_ / (z * z)) continue;
      const ForegroundPoint point{
          mean.x,
          mean.y,
          mean.z,
          depth.sigma_at(z),
          static_cast<std::uint16_t>(std::min<std::uint32_t>(mean.points, UINT16_MAX)),
          static_cast<std::uint16_t>(blob)};
      if (!out.points.try_push_back(point)) ++out.points_dropped;
    }
  }
}

}  // namespace wagonsight

#include "stereo/speckle.h"

#include <algorithm>
#include <cstdlib>

#include "base/check.h"
#include "stereo/matcher_kernels.h"

namespace wagonsight {

using stereo_kernels::kNoDisparity;

SpeckleFilter::SpeckleFilter(int width_max, int height_max)
    : width_max_(width_max),
      height_max_(height_max),
      runs_(static_cast<std::size_t>(width_max) * static_cast<std::size_t>(height_max)),
      row_begin_(static_cast<std::size_t>(height_max) + 1) {}

std::int32_t SpeckleFilter::root(std::int32_t run) {
  Run* runs = runs_.data();
  while (runs[run].parent != run) {
    runs[run].parent = runs[runs[run].parent].parent;  // halves the way for the next who asks
    run = runs[run].parent;
  }
  return run;
}

void SpeckleFilter::join(std::int32_t a, std::int32_t b) {
  a = root(a);
  b = root(b);
  if (a == b) return;
  // The older run stays root, so that the forest does not depend on sizes and stays shallow.
  if (b < a) std::swap(a, b);
  runs_[static_cast<std::size_t>(b)].parent = a;
  runs_[static_cast<std::size_t>(a)].pixels += runs_[static_cast<std::size_t>(b)].pixels;
}

std::int32_t SpeckleFilter::append_runs(const std::int16_t* row, int width, int difference_max,
                                        std::int32_t count) {
  int x = 0;
  while (x < width) {
    if (row[x] < 0) {
      ++x;
      continue;
    }
    const int begin = x++;
    while (x < width && row[x] >= 0 && std::abs(row[x] - row[x - 1]) <= difference_max) ++x;
    runs_[static_cast<std::size_t>(count)] = {count, x - begin, static_cast<std::int16_t>(begin),
                                              static_cast<std::int16_t>(x)};
    ++count;
  }
  return count;
}

void SpeckleFilter::join_rows(const std::int16_t* upper, const std::int16_t* lower,
                              std::int32_t first_upper, std::int32_t first_lower,
                              std::int32_t end_lower, int difference_max) {
  std::int32_t above = first_upper, below = first_lower;
  while (above < first_lower && below < end_lower) {
    const Run& a = runs_[static_cast<std::size_t>(above)];
    const Run& b = runs_[static_cast<std::size_t>(below)];
    const int end = std::min(a.end, b.end);
    for (int x = std::max(a.begin, b.begin); x < end; ++x)
      if (std::abs(upper[x] - lower[x]) <= difference_max) {
        join(above, below);
        break;
      }
    // Whichever ends first cannot touch anything further on.
    (a.end <= b.end ? above : below) += 1;
  }
}

void SpeckleFilter::apply(ImageView<std::int16_t> disparity, int pixels_min, int difference_max,
                          const OpenEdges& open) {
  WS_CHECK(disparity.width <= width_max_ && disparity.height <= height_max_, "%d x %d of %d x %d",
           disparity.width, disparity.height, width_max_, height_max_);
  if (pixels_min <= 1) return;
  std::int32_t count = 0;
  for (int y = 0; y < disparity.height; ++y) {
    row_begin_[static_cast<std::size_t>(y)] = count;
    const std::int16_t* row = disparity.pixels + disparity.index(0, y);
    const std::int32_t before = count;
    count = append_runs(row, disparity.width, difference_max, count);
    const bool open_row = (y == 0 && open.top) || (y + 1 == disparity.height && open.bottom);
    for (std::int32_t run = before; run < count; ++run) {
      Run& r = runs_[static_cast<std::size_t>(run)];
      if (open_row || (r.begin == 0 && open.left) || (r.end == disparity.width && open.right))
        r.pixels += pixels_min;
    }
    if (y > 0)
      join_rows(row - disparity.width, row, row_begin_[static_cast<std::size_t>(y) - 1], before,
                count, difference_max);
  }
  row_begin_[static_cast<std::size_t>(disparity.height)] = count;
  for (int y = 0; y < disparity.height; ++y) {
    std::int16_t* row = disparity.pixels + disparity.index(0, y);
    for (std::int32_t run = row_begin_[static_cast<std::size_t>(y)];
         run < row_begin_[static_cast<std::size_t>(y) + 1]; ++run) {
      const Run& r = runs_[static_cast<std::size_t>(run)];
      if (runs_[static_cast<std::size_t>(root(run))].pixels < pixels_min)
        std::fill(row + r.begin, row + r.end, kNoDisparity);
    }
  }
}

}  // namespace wagonsight

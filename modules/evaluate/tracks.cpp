#include "evaluate/tracks.h"

#include <algorithm>

#include "base/check.h"

namespace wagonsight {

DenseIds::DenseIds(std::vector<std::uint32_t> ids) : ids_(std::move(ids)) {
  std::sort(ids_.begin(), ids_.end());
  ids_.erase(std::unique(ids_.begin(), ids_.end()), ids_.end());
}

DenseIds DenseIds::of_truth(std::span<const TrackFrame> frames) {
  std::vector<std::uint32_t> ids;
  for (const TrackFrame& frame : frames) {
    ids.insert(ids.end(), frame.truth_ids.begin(), frame.truth_ids.end());
  }
  return DenseIds(std::move(ids));
}

DenseIds DenseIds::of_found(std::span<const TrackFrame> frames) {
  std::vector<std::uint32_t> ids;
  for (const TrackFrame& frame : frames) {
    ids.insert(ids.end(), frame.found_ids.begin(), frame.found_ids.end());
  }
  return DenseIds(std::move(ids));
}

std::size_t DenseIds::index_of(std::uint32_t id) const {
  const auto at = std::lower_bound(ids_.begin(), ids_.end(), id);
  WS_CHECK(at != ids_.end() && *at == id, "id %u is not in the list", id);
  return static_cast<std::size_t>(at - ids_.begin());
}

double intersection_over_union(const ImageBox& a, const ImageBox& b) {
  const double width = std::min(a.left + a.width, b.left + b.width) - std::max(a.left, b.left);
  const double height = std::min(a.top + a.height, b.top + b.height) - std::max(a.top, b.top);
  if (width <= 0 || height <= 0) return 0;
  const double both = width * height;
  return both / (a.width * a.height + b.width * b.height - both);
}

}  // namespace wagonsight

#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

// Scores of a tracker against truth, whatever is tracked: people on a floor or boxes in an image.
// All of it runs after the fact and allocates.
namespace wagonsight {

// One instant: who is truly there, who was found, and how alike each pair is, from 0 (not at all)
// to 1 (the same). An id appears at most once in a list.
struct TrackFrame {
  std::vector<std::uint32_t> truth_ids;
  std::vector<std::uint32_t> found_ids;
  std::vector<double> similarity;  // truth_ids.size() x found_ids.size(), row by row

  double at(std::size_t truth_index, std::size_t found_index) const {
    return similarity[truth_index * found_ids.size() + found_index];
  }
};

// A pair that belongs together; indices into the TrackFrame's lists.
struct Match {
  std::size_t frame_index = 0;
  std::size_t truth_index = 0;
  std::size_t found_index = 0;
};

// A similarity may miss its limit by this much: 1 - 0.5 m / 1 m must count as 0.5 whatever the
// rounding (TrackEval uses the machine epsilon).
inline constexpr double kSimilarityTolerance = 2.3e-16;

// Pairs of similarity >= similarity_min, frame by frame: a pair that was together in the frame
// before stays together, the rest is assigned for the largest sum of similarity (Bernardin and
// Stiefelhagen 2008, "Evaluating Multiple Object Tracking Performance: The CLEAR MOT Metrics").
std::vector<Match> match_frames(std::span<const TrackFrame> frames, double similarity_min);

struct ClearMot {
  std::size_t truth_count = 0;  // over all frames
  std::size_t found_count = 0;
  std::size_t match_count = 0;
  std::size_t miss_count = 0;            // FN
  std::size_t false_positive_count = 0;  // FP
  std::size_t switch_count = 0;          // a truth is found under another id than the last time
  std::size_t fragmentation_count = 0;   // a truth is lost and found again
  // Truths that were found in at least 80%, in 20% to 80%, in less than 20% of their frames.
  std::size_t mostly_tracked = 0, partly_tracked = 0, mostly_lost = 0;
  double mota = 0;  // 1 - (FN + FP + switches) / truths; NaN without truth
  double motp = 0;  // mean of 1 - similarity over the matches; NaN without a match
};
// `matches` as match_frames gives them: ascending by frame, then by truth.
ClearMot clear_mot(std::span<const TrackFrame> frames, std::span<const Match> matches);

// How well identities are kept when each truth may have one found id for good (Ristani et al. 2016,
// "Performance Measures and a Data Set for Multi-Target, Multi-Camera Tracking").
struct Identity {
  std::size_t true_positive_count = 0, false_positive_count = 0, false_negative_count = 0;
  double idf1 = 0, idp = 0, idr = 0;  // NaN where there is nothing to divide by
};
Identity identity(std::span<const TrackFrame> frames, double similarity_min);

// Higher Order Tracking Accuracy (Luiten et al. 2021, doi 10.1007/s11263-020-01375-2) as TrackEval
// computes it: a mean over the similarity limits 0.05, 0.10, ... 0.95.
inline constexpr std::size_t kHotaLimitCount = 19;
struct Hota {
  double hota = 0, det_a = 0, ass_a = 0, loc_a = 0;
  std::array<double, kHotaLimitCount> hota_at{}, det_a_at{}, ass_a_at{};
};
Hota hota(std::span<const TrackFrame> frames);

// A box in an image, pixels.
struct ImageBox {
  double left = 0, top = 0, width = 0, height = 0;
};
double intersection_over_union(const ImageBox& a, const ImageBox& b);

// The distinct ids of a list of frames as indices from 0, in ascending order.
class DenseIds {
 public:
  static DenseIds of_truth(std::span<const TrackFrame> frames);
  static DenseIds of_found(std::span<const TrackFrame> frames);
  std::size_t count() const { return ids_.size(); }
  std::size_t index_of(std::uint32_t id) const;

 private:
  explicit DenseIds(std::vector<std::uint32_t> ids);
  std::vector<std::uint32_t> ids_;
};

}  // namespace wagonsight

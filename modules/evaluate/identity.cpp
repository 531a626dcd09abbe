#include "evaluate/assignment.h"
#include "evaluate/statistics.h"
#include "evaluate/tracks.h"

namespace wagonsight {
Identity identity(std::span<const TrackFrame> frames, double similarity_min) {
  const DenseIds truths = DenseIds::of_truth(frames);
  const DenseIds founds = DenseIds::of_found(frames);
  // How often each truth and each found id were alike. One-to-one and for the largest sum: what the
  // paper's assignment with its false positives and negatives comes to, since each true positive
  // saves one of both.
  std::vector<double> together(truths.count() * founds.count(), 0);
  std::size_t truth_count = 0, found_count = 0;
  for (const TrackFrame& frame : frames) {
    truth_count += frame.truth_ids.size();
    found_count += frame.found_ids.size();
    for (std::size_t t = 0; t < frame.truth_ids.size(); ++t) {
      const std::size_t row = truths.index_of(frame.truth_ids[t]) * founds.count();
      for (std::size_t f = 0; f < frame.found_ids.size(); ++f) {
        if (frame.at(t, f) < similarity_min - kSimilarityTolerance) continue;
        together[row + founds.index_of(frame.found_ids[f])] += 1;
      }
    }
  }
  const std::vector<std::size_t> found_of = assign_best(together, truths.count(), founds.count());
  double true_positives = 0;
  for (std::size_t t = 0; t < found_of.size(); ++t) {
    if (found_of[t] != kUnassigned) true_positives += together[t * founds.count() + found_of[t]];
  }
  Identity scores;
  scores.true_positive_count = static_cast<std::size_t>(true_positives);
  scores.false_negative_count = truth_count - scores.true_positive_count;
  scores.false_positive_count = found_count - scores.true_positive_count;
  scores.idp = ratio(true_positives, static_cast<double>(found_count));
  scores.idr = ratio(true_positives, static_cast<double>(truth_count));
  scores.idf1 = ratio(2 * true_positives, static_cast<double>(truth_count + found_count));
  return scores;
}

}  // namespace wagonsight

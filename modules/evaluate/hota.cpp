#include <algorithm>
#include <cmath>

#include "evaluate/assignment.h"
#include "evaluate/tracks.h"

namespace wagonsight {
namespace {

// A pair that was assigned, before any limit.
struct Pair {
  std::size_t truth = 0, found = 0;  // dense
  double similarity = 0;
};

struct Totals {
  DenseIds truths, founds;
  std::vector<double> truth_frames, found_frames;  // by dense index: in how many frames it is
  std::vector<double> alignment;                   // truths x founds: how much they belong together
  double truth_count = 0, found_count = 0;

  double& alignment_of(std::size_t truth, std::size_t found) {
    return alignment[truth * founds.count() + found];
  }
};

// Similarities of a frame as a soft assignment: a pair counts less when others are alike, too.
void add_alignment(const TrackFrame& frame, Totals& totals) {
  const std::size_t rows = frame.truth_ids.size(), columns = frame.found_ids.size();
  std::vector<double> row_sums(rows, 0), column_sums(columns, 0);
  for (std::size_t t = 0; t < rows; ++t) {
    for (std::size_t f = 0; f < columns; ++f) {
      row_sums[t] += frame.at(t, f);
      column_sums[f] += frame.at(t, f);
    }
  }
  for (std::size_t t = 0; t < rows; ++t) {
    const std::size_t truth = totals.truths.index_of(frame.truth_ids[t]);
    for (std::size_t f = 0; f < columns; ++f) {
      const double whole = row_sums[t] + column_sums[f] - frame.at(t, f);
      if (whole <= kSimilarityTolerance) continue;
      totals.alignment_of(truth, totals.founds.index_of(frame.found_ids[f])) +=
          frame.at(t, f) / whole;
    }
  }
}

Totals gather(std::span<const TrackFrame> frames) {
  Totals totals{DenseIds::of_truth(frames), DenseIds::of_found(frames), {}, {}, {}, 0, 0};
  totals.truth_frames.assign(totals.truths.count(), 0);
  totals.found_frames.assign(totals.founds.count(), 0);
  totals.alignment.assign(totals.truths.count() * totals.founds.count(), 0);
  for (const TrackFrame& frame : frames) {
    for (const std::uint32_t id : frame.truth_ids) {
      totals.truth_frames[totals.truths.index_of(id)] += 1;
    }
    for (const std::uint32_t id : frame.found_ids) {
      totals.found_frames[totals.founds.index_of(id)] += 1;
    }
    totals.truth_count += static_cast<double>(frame.truth_ids.size());
    totals.found_count += static_cast<double>(frame.found_ids.size());
    add_alignment(frame, totals);
  }
  for (std::size_t t = 0; t < totals.truths.count(); ++t) {
    for (std::size_t f = 0; f < totals.founds.count(); ++f) {
      double& alignment = totals.alignment_of(t, f);
      alignment /= totals.truth_frames[t] + totals.found_frames[f] - alignment;
    }
  }
  return totals;
}

std::vector<Pair> assign(std::span<const TrackFrame> frames, Totals& totals) {
  std::vector<Pair> pairs;
  std::vector<double> scores;
  for (const TrackFrame& frame : frames) {
    const std::size_t columns = frame.found_ids.size();
    scores.assign(frame.similarity.size(), 0);
    for (std::size_t t = 0; t < frame.truth_ids.size(); ++t) {
      const std::size_t truth = totals.truths.index_of(frame.truth_ids[t]);
      for (std::size_t f = 0; f < columns; ++f) {
        scores[t * columns + f] =
            frame.at(t, f) * totals.alignment_of(truth, totals.founds.index_of(frame.found_ids[f]));
      }
    }
    const std::vector<std::size_t> found_of = assign_best(scores, frame.truth_ids.size(), columns);
    for (std::size_t t = 0; t < found_of.size(); ++t) {
      const std::size_t f = found_of[t];
      if (f == kUnassigned) continue;
      pairs.push_back({totals.truths.index_of(frame.truth_ids[t]),
                       totals.founds.index_of(frame.found_ids[f]), frame.at(t, f)});
    }
  }
  return pairs;
}

// One limit's share in the means.
void add_limit(std::size_t index, std::span<const Pair> pairs, const Totals& totals, Hota& scores) {
  const double limit = 0.05 * static_cast<double>(index + 1);
  std::vector<double> together(totals.alignment.size(), 0);
  double matches = 0, similarity_sum = 0;
  for (const Pair& pair : pairs) {
    if (pair.similarity < limit - kSimilarityTolerance) continue;
    together[pair.truth * totals.founds.count() + pair.found] += 1;
    similarity_sum += pair.similarity;
    matches += 1;
  }
  double association = 0;
  for (std::size_t t = 0; t < totals.truths.count(); ++t) {
    for (std::size_t f = 0; f < totals.founds.count(); ++f) {
      const double count = together[t * totals.founds.count() + f];
      association += count * count / (totals.truth_frames[t] + totals.found_frames[f] - count);
    }
  }
  scores.ass_a_at[index] = association / std::max(1.0, matches);
  scores.det_a_at[index] =
      matches / std::max(1.0, totals.truth_count + totals.found_count - matches);
  scores.hota_at[index] = std::sqrt(scores.det_a_at[index] * scores.ass_a_at[index]);
  scores.hota += scores.hota_at[index] / kHotaLimitCount;
  scores.det_a += scores.det_a_at[index] / kHotaLimitCount;
  scores.ass_a += scores.ass_a_at[index] / kHotaLimitCount;
  // A limit that nothing reaches counts as perfectly placed, as in TrackEval.
  scores.loc_a += (matches > 0 ? similarity_sum / matches : 1.0) / kHotaLimitCount;
}

}  // namespace

Hota hota(std::span<const TrackFrame> frames) {
  Totals totals = gather(frames);
  const std::vector<Pair> pairs = assign(frames, totals);
  Hota scores;
  for (std::size_t i = 0; i < kHotaLimitCount; ++i) add_limit(i, pairs, totals, scores);
  return scores;
}

}  // namespace wagonsight

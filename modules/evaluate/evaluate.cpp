#include "evaluate/evaluate.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "evaluate/statistics.h"

namespace wagonsight {
namespace {

constexpr std::size_t kNoLine = static_cast<std::size_t>(-1);

double distance_m(const PersonSeen& a, const PersonSeen& b) {
  return std::hypot(a.position[0] - b.position[0], a.position[1] - b.position[1]);
}

double median_step_s(std::span<const Instant> instants) {
  std::vector<double> steps;
  for (std::size_t i = 1; i < instants.size(); ++i) {
    steps.push_back(instants[i].time - instants[i - 1].time);
  }
  return steps.empty() ? 0 : quantile(steps, 0.5);
}

std::size_t nearest_line(std::span<const Instant> people, double time) {
  const auto after = std::lower_bound(people.begin(), people.end(), time,
                                      [](const Instant& i, double t) { return i.time < t; });
  auto at = static_cast<std::size_t>(after - people.begin());
  if (at == people.size() || (at > 0 && time - people[at - 1].time <= people[at].time - time)) {
    --at;
  }
  return at;
}

// The line of people for each instant of the truth, kNoLine where there is none.
std::vector<std::size_t> align(std::span<const Instant> truth, std::span<const Instant> people,
                               AlignmentScores& scores) {
  scores.truth_count = truth.size();
  scores.frame_s = median_step_s(truth);
  // Times are written to the microsecond, so half a frame is meant with that much slack.
  double reach_s = 0.5 * scores.frame_s + 1e-6;
  if (truth.size() == 1) reach_s = 0.5 * median_step_s(people) + 1e-6;
  std::vector<std::size_t> line_of(truth.size(), kNoLine);
  std::vector<std::size_t> taken_by(people.size(), kNoLine);
  for (std::size_t i = 0; i < truth.size() && !people.empty(); ++i) {
    const std::size_t line = nearest_line(people, truth[i].time);
    const double apart_s = std::abs(people[line].time - truth[i].time);
    if (apart_s > reach_s) continue;
    const std::size_t rival = taken_by[line];
    if (rival != kNoLine) {
      if (std::abs(people[line].time - truth[rival].time) <= apart_s) continue;
      line_of[rival] = kNoLine;
      --scores.answered_count;
    }
    line_of[i] = line;
    taken_by[line] = i;
    ++scores.answered_count;
  }
  scores.unused_count = people.size() - scores.answered_count;
  return line_of;
}

TrackFrame compare(const Instant& truth, const Instant& found, double range_m) {
  TrackFrame frame;
  for (const PersonSeen& person : truth.people) frame.truth_ids.push_back(person.id);
  for (const PersonSeen& person : found.people) frame.found_ids.push_back(person.id);
  for (const PersonSeen& a : truth.people) {
    for (const PersonSeen& b : found.people) {
      frame.similarity.push_back(std::max(0.0, 1 - distance_m(a, b) / range_m));
    }
  }
  return frame;
}

// Everything of one evaluation side by side, index by instant of the truth.
struct Comparison {
  std::span<const Instant> truth;
  std::vector<const Instant*> found;
  std::vector<TrackFrame> frames;
  std::vector<Match> matches;

  const PersonSeen& truth_of(const Match& m) const {
    return truth[m.frame_index].people[m.truth_index];
  }
  const PersonSeen& found_of(const Match& m) const {
    return found[m.frame_index]->people[m.found_index];
  }
};

CountScores score_counts(const Comparison& all) {
  CountScores scores;
  scores.instant_count = all.truth.size();
  std::size_t exact = 0, off_by_one = 0;
  double sum = 0, absolute_sum = 0;
  for (std::size_t i = 0; i < all.truth.size(); ++i) {
    const auto error = static_cast<double>(all.found[i]->people.size()) -
                       static_cast<double>(all.truth[i].people.size());
    sum += error;
    absolute_sum += std::abs(error);
    exact += error == 0 ? 1U : 0U;
    off_by_one += std::abs(error) <= 1 ? 1U : 0U;
    if (all.truth[i].people.empty()) {
      ++scores.empty_count;
      if (error > 0) ++scores.empty_with_people_count;
    }
  }
  const auto count = static_cast<double>(scores.instant_count);
  scores.exact_share = ratio(static_cast<double>(exact), count);
  scores.off_by_one_share = ratio(static_cast<double>(off_by_one), count);
  scores.mean_error = ratio(sum, count);
  scores.mean_absolute_error = ratio(absolute_sum, count);
  return scores;
}

PositionScores score_positions(const Comparison& all) {
  std::vector<double> errors;
  double error_sum = 0, height_sum = 0, height_count = 0;
  for (const Match& match : all.matches) {
    const PersonSeen& truth = all.truth_of(match);
    const PersonSeen& found = all.found_of(match);
    errors.push_back(distance_m(truth, found));
    error_sum += errors.back();
    if (truth.height > 0 && found.height > 0) {
      height_sum += std::abs(truth.height - found.height);
      height_count += 1;
    }
  }
  PositionScores scores;
  scores.mean_m = ratio(error_sum, static_cast<double>(errors.size()));
  scores.median_m = quantile(errors, 0.5);
  scores.p95_m = quantile(errors, 0.95);
  scores.max_m = quantile(errors, 1);
  scores.height_mean_absolute_m = ratio(height_sum, height_count);
  return scores;
}

PostureScores score_postures(const Comparison& all) {
  PostureScores scores;
  std::size_t agreed = 0;
  for (const Match& match : all.matches) {
    const Posture truth = all.truth_of(match).posture;
    const Posture found = all.found_of(match).posture;
    ++scores.confusion[static_cast<std::size_t>(truth)][static_cast<std::size_t>(found)];
    if (truth == Posture::kUnknown) continue;
    ++scores.compared_count;
    agreed += truth == found ? 1U : 0U;
  }
  scores.agreed_share =
      ratio(static_cast<double>(agreed), static_cast<double>(scores.compared_count));
  return scores;
}

}  // namespace

Scores evaluate(std::span<const Instant> truth, std::span<const Instant> people,
                const EvaluateOptions& options) {
  static const Instant kNobody;
  Scores scores;
  Comparison all{truth, {}, {}, {}};
  for (const std::size_t line : align(truth, people, scores.alignment)) {
    const Instant& found = line == kNoLine ? kNobody : people[line];
    all.frames.push_back(compare(truth[all.found.size()], found, options.similarity_range_m));
    all.found.push_back(&found);
  }
  const double similarity_min = 1 - options.gate_m / options.similarity_range_m;
  all.matches = match_frames(all.frames, similarity_min);
  scores.clear = clear_mot(all.frames, all.matches);
  scores.identity = identity(all.frames, similarity_min);
  scores.hota = hota(all.frames);
  scores.count = score_counts(all);
  scores.position = score_positions(all);
  scores.posture = score_postures(all);
  return scores;
}

}  // namespace wagonsight

#include <unordered_map>

#include "evaluate/assignment.h"
#include "evaluate/statistics.h"
#include "evaluate/tracks.h"

namespace wagonsight {
namespace {

// Above any sum of similarities in a frame, so that staying together beats every other assignment.
constexpr double kStayBonus = 1e4;

using Partners = std::unordered_map<std::uint32_t, std::uint32_t>;  // truth id -> found id

std::vector<std::size_t> match_frame(const TrackFrame& frame, const Partners& before,
                                     double similarity_min) {
  std::vector<double> scores(frame.similarity.size(), 0);
  for (std::size_t t = 0; t < frame.truth_ids.size(); ++t) {
    const auto partner = before.find(frame.truth_ids[t]);
    for (std::size_t f = 0; f < frame.found_ids.size(); ++f) {
      const double similarity = frame.at(t, f);
      if (similarity < similarity_min - kSimilarityTolerance) continue;
      const bool stays = partner != before.end() && partner->second == frame.found_ids[f];
      scores[t * frame.found_ids.size() + f] = similarity + (stays ? kStayBonus : 0);
    }
  }
  return assign_best(scores, frame.truth_ids.size(), frame.found_ids.size());
}

// What is known of one truth over all frames.
struct Life {
  std::size_t frame_count = 0, match_count = 0;
  std::size_t run_count = 0;  // stretches in which it was found
  bool found_before = false;  // in the last frame in which it was there
  bool has_found_id = false;
  std::uint32_t found_id = 0;  // the last it was found under
};

void count_lives(std::span<const Life> lives, ClearMot& scores) {
  for (const Life& life : lives) {
    const double share =
        static_cast<double>(life.match_count) / static_cast<double>(life.frame_count);
    if (share >= 0.8) {
      ++scores.mostly_tracked;
    } else if (share >= 0.2) {
      ++scores.partly_tracked;
    } else {
      ++scores.mostly_lost;
    }
    if (life.run_count > 1) scores.fragmentation_count += life.run_count - 1;
  }
}

}  // namespace

std::vector<Match> match_frames(std::span<const TrackFrame> frames, double similarity_min) {
  std::vector<Match> matches;
  Partners before;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const TrackFrame& frame = frames[i];
    const std::vector<std::size_t> found_of = match_frame(frame, before, similarity_min);
    before.clear();
    for (std::size_t t = 0; t < frame.truth_ids.size(); ++t) {
      const std::size_t f = found_of[t];
      if (f == kUnassigned) continue;
      if (frame.at(t, f) < similarity_min - kSimilarityTolerance) continue;
      matches.push_back({i, t, f});
      before.emplace(frame.truth_ids[t], frame.found_ids[f]);
    }
  }
  return matches;
}

ClearMot clear_mot(std::span<const TrackFrame> frames, std::span<const Match> matches) {
  ClearMot scores;
  const DenseIds truths = DenseIds::of_truth(frames);
  std::vector<Life> lives(truths.count());
  double distance_sum = 0;
  std::size_t next = 0;  // the first match of the frame
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const TrackFrame& frame = frames[i];
    scores.truth_count += frame.truth_ids.size();
    scores.found_count += frame.found_ids.size();
    for (std::size_t t = 0; t < frame.truth_ids.size(); ++t) {
      Life& life = lives[truths.index_of(frame.truth_ids[t])];
      ++life.frame_count;
      const bool found =
          next < matches.size() && matches[next].frame_index == i && matches[next].truth_index == t;
      if (found) {
        const std::uint32_t id = frame.found_ids[matches[next].found_index];
        distance_sum += 1 - frame.at(t, matches[next].found_index);
        if (life.has_found_id && life.found_id != id) ++scores.switch_count;
        if (!life.found_before) ++life.run_count;
        ++life.match_count;
        life.has_found_id = true;
        life.found_id = id;
        ++next;
      }
      life.found_before = found;
    }
  }
  scores.match_count = matches.size();
  scores.miss_count = scores.truth_count - scores.match_count;
  scores.false_positive_count = scores.found_count - scores.match_count;
  count_lives(lives, scores);
  const auto errors =
      static_cast<double>(scores.miss_count + scores.false_positive_count + scores.switch_count);
  scores.mota = 1 - ratio(errors, static_cast<double>(scores.truth_count));
  scores.motp = ratio(distance_sum, static_cast<double>(scores.match_count));
  return scores;
}

}  // namespace wagonsight

#include "evaluate/tracks.h"

#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <cmath>

namespace wagonsight {
namespace {

// One truth, one found person of the given id and similarity; id 0: nobody was found.
TrackFrame one_to_one(std::uint32_t truth_id, std::uint32_t found_id, double similarity = 1) {
  TrackFrame frame;
  frame.truth_ids = {truth_id};
  if (found_id != 0) {
    frame.found_ids = {found_id};
    frame.similarity = {similarity};
  }
  return frame;
}

ClearMot clear_of(const std::vector<TrackFrame>& frames) {
  return clear_mot(frames, match_frames(frames, 0.5));
}

TEST(ClearMot, CountsAPerfectTrackAsPerfect) {
  const ClearMot scores = clear_of({one_to_one(1, 4), one_to_one(1, 4), one_to_one(1, 4)});
  EXPECT_EQ(scores.mota, 1);
  EXPECT_EQ(scores.motp, 0);
  EXPECT_EQ(scores.mostly_tracked, 1U);
  EXPECT_EQ(scores.fragmentation_count, 0U);
}

TEST(ClearMot, CountsMissesSwitchesAndFragmentations) {
  // found as 4, missed, found as 4, found as 5: one miss, one fragmentation, one switch of four.
  const ClearMot scores =
      clear_of({one_to_one(1, 4), one_to_one(1, 0), one_to_one(1, 4), one_to_one(1, 5)});
  EXPECT_EQ(scores.miss_count, 1U);
  EXPECT_EQ(scores.fragmentation_count, 1U);
  EXPECT_EQ(scores.switch_count, 1U);
  EXPECT_EQ(scores.false_positive_count, 0U);
  EXPECT_DOUBLE_EQ(scores.mota, 0.5);
  EXPECT_EQ(scores.partly_tracked, 1U);
}

TEST(ClearMot, CountsASwitchAcrossAGap) {
  const ClearMot scores = clear_of({one_to_one(1, 4), one_to_one(1, 0), one_to_one(1, 5)});
  EXPECT_EQ(scores.switch_count, 1U);
}

TEST(ClearMot, KeepsAPairTogetherThoughAnotherIsNearer) {
  TrackFrame crowded = one_to_one(1, 4, 0.6);
  crowded.found_ids = {4, 5};
  crowded.similarity = {0.6, 0.9};
  const ClearMot scores = clear_of({one_to_one(1, 4), crowded});
  EXPECT_EQ(scores.switch_count, 0U);
  EXPECT_EQ(scores.false_positive_count, 1U);
  EXPECT_DOUBLE_EQ(scores.motp, 0.2);
}

TEST(ClearMot, LetsGoOfAPairBeyondTheGate) {
  const ClearMot scores = clear_of({one_to_one(1, 4), one_to_one(1, 4, 0.49)});
  EXPECT_EQ(scores.miss_count, 1U);
  EXPECT_EQ(scores.false_positive_count, 1U);
  EXPECT_EQ(scores.mota, 0);
}

TEST(ClearMot, HasNoScoreWithoutTruth) {
  TrackFrame ghost;
  ghost.found_ids = {7};
  const ClearMot scores = clear_of({ghost});
  EXPECT_EQ(scores.false_positive_count, 1U);
  EXPECT_TRUE(std::isnan(scores.mota));
  EXPECT_TRUE(std::isnan(scores.motp));
}

TEST(Identity, GivesATruthItsMostFrequentId) {
  // Three frames as 4, one as 5: IDTP 3, IDFP 1, IDFN 1.
  const std::vector<TrackFrame> frames = {one_to_one(1, 4), one_to_one(1, 4), one_to_one(1, 5),
                                          one_to_one(1, 4)};
  const Identity scores = identity(frames, 0.5);
  EXPECT_EQ(scores.true_positive_count, 3U);
  EXPECT_EQ(scores.false_positive_count, 1U);
  EXPECT_EQ(scores.false_negative_count, 1U);
  EXPECT_DOUBLE_EQ(scores.idf1, 0.75);
}

TEST(Identity, IsGlobalAndNotGreedy) {
  // Truth 1 is with 8 in 3 frames and with 9 in 2; truth 2 with 8 in 2. Greedily 3; at best 2 + 2.
  std::vector<TrackFrame> frames = {one_to_one(1, 8), one_to_one(1, 8), one_to_one(1, 8),
                                    one_to_one(1, 9), one_to_one(1, 9), one_to_one(2, 8),
                                    one_to_one(2, 8)};
  EXPECT_EQ(identity(frames, 0.5).true_positive_count, 4U);
}

TEST(Hota, IsOneWhenAllIsRight) {
  const std::vector<TrackFrame> frames = {one_to_one(1, 4), one_to_one(1, 4)};
  const Hota scores = hota(frames);
  EXPECT_DOUBLE_EQ(scores.hota, 1);
  EXPECT_DOUBLE_EQ(scores.det_a, 1);
  EXPECT_DOUBLE_EQ(scores.ass_a, 1);
  EXPECT_DOUBLE_EQ(scores.loc_a, 1);
}

TEST(Hota, SplitsDetectionFromAssociation) {
  // Always found, but two ids for two frames each: DetA 1; each match has TPA 2 of 4: AssA 0.5.
  const std::vector<TrackFrame> frames = {one_to_one(1, 4), one_to_one(1, 4), one_to_one(1, 5),
                                          one_to_one(1, 5)};
  const Hota scores = hota(frames);
  EXPECT_DOUBLE_EQ(scores.det_a, 1);
  EXPECT_DOUBLE_EQ(scores.ass_a, 0.5);
  EXPECT_DOUBLE_EQ(scores.hota, std::sqrt(0.5));
}

TEST(Hota, FallsWithTheLimitOfSimilarity) {
  // Similarity 0.5 satisfies the limits 0.05 to 0.50: ten of nineteen.
  const std::vector<TrackFrame> frames = {one_to_one(1, 4, 0.5)};
  const Hota scores = hota(frames);
  EXPECT_NEAR(scores.hota, 10.0 / 19.0, 1e-12);
  EXPECT_NEAR(scores.loc_a, (10 * 0.5 + 9 * 1.0) / 19.0, 1e-12);
}

TEST(IntersectionOverUnion, MeasuresOverlap) {
  EXPECT_EQ(intersection_over_union({0, 0, 10, 10}, {20, 0, 10, 10}), 0);
  EXPECT_EQ(intersection_over_union({0, 0, 10, 10}, {0, 0, 10, 10}), 1);
  EXPECT_DOUBLE_EQ(intersection_over_union({0, 0, 10, 10}, {5, 0, 10, 10}), 50.0 / 150.0);
}

// Who is there is drawn by coin: truths 1 to 5, found people 11 to 16.
std::vector<std::uint32_t> random_ids(std::uint32_t first, std::size_t count) {
  const auto there = *rc::gen::container<std::vector<bool>>(count, rc::gen::arbitrary<bool>());
  std::vector<std::uint32_t> ids;
  for (std::size_t i = 0; i < count; ++i) {
    if (there[i]) ids.push_back(first + static_cast<std::uint32_t>(i));
  }
  return ids;
}

std::vector<TrackFrame> random_frames() {
  const auto frame_count = *rc::gen::inRange<std::size_t>(1, 12);
  std::vector<TrackFrame> frames(frame_count);
  for (TrackFrame& frame : frames) {
    frame.truth_ids = random_ids(1, 5);
    frame.found_ids = random_ids(11, 6);
    const auto tenths = *rc::gen::container<std::vector<int>>(
        frame.truth_ids.size() * frame.found_ids.size(), rc::gen::inRange(0, 11));
    for (const int t : tenths) frame.similarity.push_back(t / 10.0);
  }
  return frames;
}

RC_GTEST_PROP(Scores, BalanceAndStayInRange, ()) {
  const std::vector<TrackFrame> frames = random_frames();
  const std::vector<Match> matches = match_frames(frames, 0.5);
  const ClearMot clear = clear_mot(frames, matches);
  RC_ASSERT(clear.match_count + clear.miss_count == clear.truth_count);
  RC_ASSERT(clear.match_count + clear.false_positive_count == clear.found_count);
  const Identity ids = identity(frames, 0.5);
  RC_ASSERT(ids.true_positive_count + ids.false_negative_count == clear.truth_count);
  RC_ASSERT(ids.true_positive_count + ids.false_positive_count == clear.found_count);
  const Hota scores = hota(frames);
  for (const double score : {scores.hota, scores.det_a, scores.ass_a, scores.loc_a}) {
    RC_ASSERT(score >= 0 && score <= 1 + 1e-12);
  }
}

RC_GTEST_PROP(Scores, DoNotDependOnNames, ()) {
  std::vector<TrackFrame> frames = random_frames();
  const Hota before = hota(frames);
  const std::vector<Match> matches_before = match_frames(frames, 0.5);
  const ClearMot clear_before = clear_mot(frames, matches_before);
  for (TrackFrame& frame : frames) {
    for (std::uint32_t& id : frame.found_ids) id = 1000 - id;  // turns their order around, too
    for (std::uint32_t& id : frame.truth_ids) id = 500 + id * 7 % 6;
  }
  const Hota after = hota(frames);
  RC_ASSERT(std::abs(after.hota - before.hota) < 1e-12);
  RC_ASSERT(std::abs(after.ass_a - before.ass_a) < 1e-12);
  RC_ASSERT(clear_mot(frames, match_frames(frames, 0.5)).switch_count == clear_before.switch_count);
}

// The oracle of the identity score: every one-to-one renaming of truths to found ids.
std::size_t most_together_by_trying_all(const std::vector<TrackFrame>& frames) {
  std::vector<std::uint32_t> names = {11, 12, 13, 14, 15, 16};
  std::size_t best = 0;
  do {
    std::size_t together = 0;
    for (const TrackFrame& frame : frames) {
      for (std::size_t t = 0; t < frame.truth_ids.size(); ++t) {
        for (std::size_t f = 0; f < frame.found_ids.size(); ++f) {
          const bool same = names[frame.truth_ids[t] - 1] == frame.found_ids[f];
          if (same && frame.at(t, f) >= 0.5) ++together;
        }
      }
    }
    best = std::max(best, together);
  } while (std::next_permutation(names.begin(), names.end()));
  return best;
}

RC_GTEST_PROP(Identity, EqualsTryingAllRenamings, ()) {
  const std::vector<TrackFrame> frames = random_frames();
  RC_ASSERT(identity(frames, 0.5).true_positive_count == most_together_by_trying_all(frames));
}

}  // namespace
}  // namespace wagonsight

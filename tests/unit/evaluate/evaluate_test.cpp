#include "evaluate/evaluate.h"

#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <rapidcheck/gtest.h>

#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>

namespace wagonsight {
namespace {

PersonSeen person(std::uint32_t id, double x, double y, Posture posture = Posture::kStanding) {
  return {id, {x, y}, 1.7, posture};
}

// `count` instants at 10 Hz, shifted by `shift_s`, of one walker at x = time.
std::vector<Instant> walk(std::size_t count, double shift_s = 0) {
  std::vector<Instant> instants;
  for (std::size_t i = 0; i < count; ++i) {
    const double time = 0.1 * static_cast<double>(i);
    instants.push_back({time + shift_s, {person(1, time, 2)}});
  }
  return instants;
}

TEST(Evaluate, FindsNothingWrongWithTheTruthItself) {
  const std::vector<Instant> truth = walk(50);
  const Scores scores = evaluate(truth, truth);
  EXPECT_EQ(scores.clear.mota, 1);
  EXPECT_EQ(scores.identity.idf1, 1);
  EXPECT_NEAR(scores.hota.hota, 1, 1e-12);
  EXPECT_EQ(scores.count.exact_share, 1);
  EXPECT_EQ(scores.position.max_m, 0);
  EXPECT_EQ(scores.posture.agreed_share, 1);
}

TEST(Evaluate, GatesAtHalfAMetre) {
  std::vector<Instant> people = walk(10);
  for (Instant& instant : people) instant.people[0].position[1] += 0.5;
  const Scores at_gate = evaluate(walk(10), people);
  EXPECT_EQ(at_gate.clear.mota, 1);
  EXPECT_NEAR(at_gate.clear.motp, 0.5, 1e-12);
  for (Instant& instant : people) instant.people[0].position[1] += 0.001;
  EXPECT_EQ(evaluate(walk(10), people).clear.mota, -1);  // all missed and as many invented
}

TEST(Evaluate, TakesTheNearestLineWithinHalfAFrame) {
  EXPECT_EQ(evaluate(walk(20), walk(20, 0.049)).alignment.answered_count, 20U);
  // 0.051 s late: each instant but the first is answered by the line before it.
  const Scores late = evaluate(walk(20), walk(20, 0.051));
  EXPECT_EQ(late.alignment.answered_count, 19U);
  EXPECT_EQ(late.alignment.unused_count, 1U);
  EXPECT_NEAR(late.alignment.frame_s, 0.1, 1e-9);
}

TEST(Evaluate, CountsAnInstantWithoutAnswerAsNobodyFound) {
  std::vector<Instant> people = walk(10);
  people.erase(people.begin() + 4, people.begin() + 6);
  const Scores scores = evaluate(walk(10), people);
  EXPECT_EQ(scores.alignment.answered_count, 8U);
  EXPECT_EQ(scores.clear.miss_count, 2U);
  EXPECT_DOUBLE_EQ(scores.count.exact_share, 0.8);
}

TEST(Evaluate, LetsALineAnswerOnlyOneInstant) {
  const std::vector<Instant> one = {{0.52, {person(9, 0.5, 2)}}};
  const Scores scores = evaluate(walk(10), one);
  EXPECT_EQ(scores.alignment.answered_count, 1U);
  EXPECT_EQ(scores.clear.match_count, 1U);
}

TEST(Evaluate, ScoresCounts) {
  const std::vector<Instant> truth = {{0.0, {}}, {0.1, {person(1, 0, 0)}}, {0.2, {}}, {0.3, {}}};
  const std::vector<Instant> people = {{0.0, {}},
                                       {0.1, {person(1, 0, 0)}},
                                       {0.2, {person(1, 0, 0)}},
                                       {0.3, {person(1, 0, 0), person(2, 5, 0)}}};
  const CountScores count = evaluate(truth, people).count;
  EXPECT_DOUBLE_EQ(count.exact_share, 0.5);
  EXPECT_DOUBLE_EQ(count.off_by_one_share, 0.75);
  EXPECT_DOUBLE_EQ(count.mean_error, 0.75);
  EXPECT_DOUBLE_EQ(count.mean_absolute_error, 0.75);
  EXPECT_EQ(count.empty_count, 3U);
  EXPECT_EQ(count.empty_with_people_count, 2U);
}

TEST(Evaluate, ScoresPositionsAndHeights) {
  std::vector<Instant> people = walk(5);
  for (std::size_t i = 0; i < 5; ++i) {
    people[i].people[0].position[1] += 0.1 * static_cast<double>(i);  // 0, 10, 20, 30, 40 cm
    people[i].people[0].height += 0.05;
  }
  const PositionScores scores = evaluate(walk(5), people).position;
  EXPECT_NEAR(scores.mean_m, 0.2, 1e-12);
  EXPECT_NEAR(scores.median_m, 0.2, 1e-12);
  EXPECT_NEAR(scores.p95_m, 0.38, 1e-12);
  EXPECT_NEAR(scores.max_m, 0.4, 1e-12);
  EXPECT_NEAR(scores.height_mean_absolute_m, 0.05, 1e-12);
}

TEST(Evaluate, ScoresPosturesWhereTheTruthIsKnown) {
  std::vector<Instant> truth = walk(4);
  std::vector<Instant> people = walk(4);
  truth[0].people[0].posture = Posture::kUnknown;
  truth[1].people[0].posture = Posture::kSitting;
  people[2].people[0].posture = Posture::kUnknown;
  const PostureScores scores = evaluate(truth, people).posture;
  EXPECT_EQ(scores.compared_count, 3U);
  EXPECT_DOUBLE_EQ(scores.agreed_share, 1.0 / 3.0);
  EXPECT_EQ(scores.confusion[static_cast<std::size_t>(Posture::kSitting)]
                            [static_cast<std::size_t>(Posture::kStanding)],
            1U);
}

TEST(Evaluate, SurvivesEmptyFiles) {
  EXPECT_TRUE(std::isnan(evaluate({}, {}).clear.mota));
  EXPECT_EQ(evaluate(walk(3), {}).clear.mota, 0);
  EXPECT_EQ(evaluate({}, walk(3)).alignment.unused_count, 3U);
}

TEST(Evaluate, WritesJsonWithNullForWhatDoesNotExist) {
  const auto json = nlohmann::json::parse(to_json(evaluate({}, {})));
  EXPECT_TRUE(json["mota"].is_null());
  const auto good = nlohmann::json::parse(to_json(evaluate(walk(5), walk(5))));
  EXPECT_EQ(good["mota"], 1.0);
  EXPECT_EQ(good["count"]["exact_share"], 1.0);
  EXPECT_EQ(good["posture"]["confusion"]["standing"]["standing"], 5);
}

TEST(Evaluate, WritesATableForAPerson) {
  std::vector<Instant> people = walk(10);
  people[3].people.clear();
  const std::string table = to_table(evaluate(walk(10), people));
  EXPECT_NE(table.find("MOTA                 0.900   1 misses"), std::string::npos) << table;
  EXPECT_NE(table.find("count exact          90.0%"), std::string::npos) << table;
  EXPECT_EQ(to_table(evaluate({}, {})).find("nan"), std::string::npos);
}

RC_GTEST_PROP(Evaluate, WorsensWithEveryPersonTakenAway, ()) {
  const std::vector<Instant> truth = walk(20);
  std::vector<Instant> people = truth;
  double last = 1;
  const auto order =
      *rc::gen::unique<std::vector<std::size_t>>(rc::gen::inRange<std::size_t>(0, 20));
  for (const std::size_t index : order) {
    people[index].people.clear();
    const double mota = evaluate(truth, people).clear.mota;
    RC_ASSERT(std::abs(last - mota - 0.05) < 1e-9);
    last = mota;
  }
}

}  // namespace
}  // namespace wagonsight

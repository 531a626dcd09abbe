#include "people/detect.h"

#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <array>

#include "support/body_cloud.h"

namespace wagonsight {
namespace {

using testing::add_column;
using testing::add_person;

std::vector<Detection> people_in(const FusedCloud& cloud,
                                 std::span<const PersonPrior> priors = {}) {
  Detector detector(testing::room());
  std::vector<Detection> found;
  for (const Detection& detection : detector.detect(cloud, priors))
    if (detection.stands_alone) found.push_back(detection);
  return found;
}

TEST(Detector, FindsNobodyInAnEmptyRoom) {
  EXPECT_TRUE(people_in(FusedCloud{}).empty());
}

TEST(Detector, FindsOnePersonWhereItStands) {
  EXPECT_TRUE(rc::check([] {
    const double x = 1 + 0.01 * *rc::gen::inRange(0, 400);
    const double y = 1 + 0.01 * *rc::gen::inRange(0, 200);
    const double height = 0.01 * *rc::gen::inRange(95, 201);
    FusedCloud cloud;
    add_person(cloud, x, y, height);
    const auto found = people_in(cloud);
    RC_ASSERT(found.size() == 1U);
    RC_ASSERT(std::hypot(found[0].x - x, found[0].y - y) < 0.03);
    RC_ASSERT(std::abs(found[0].top - height) < 0.04);
  }));
}

TEST(Detector, PutsATorsoSeenFromOneSideAtItsCentre) {
  FusedCloud cloud;
  add_person(cloud, 3.0, 2.0, 1.75, {false, 0.0, 2.0});
  const auto found = people_in(cloud);
  ASSERT_EQ(found.size(), 1U);
  EXPECT_NEAR(found[0].x, 3.0, 0.05);
  EXPECT_NEAR(found[0].y, 2.0, 0.03);
}

TEST(Detector, SeparatesPeopleWhoseShouldersTouch) {
  FusedCloud cloud;
  add_person(cloud, 2.0, 1.0, 1.75);
  add_person(cloud, 2.0, 1.45, 1.70);
  add_person(cloud, 2.0, 1.90, 1.80);
  EXPECT_EQ(people_in(cloud).size(), 3U);
}

TEST(Detector, FindsAChildBesideAnAdult) {
  FusedCloud cloud;
  add_person(cloud, 2.0, 1.0, 1.75);
  add_person(cloud, 2.0, 1.48, 1.05);
  EXPECT_EQ(people_in(cloud).size(), 2U);
}

TEST(Detector, TakesARaisedArmForPartOfItsPerson) {
  FusedCloud cloud;
  add_person(cloud, 2.0, 1.0, 1.75);
  add_column(cloud, 2.0, 1.24, 1.3, 2.1, 0.04, 0.04, {});
  EXPECT_EQ(people_in(cloud).size(), 1U);
}

TEST(Detector, FindsNobodyInABagOrInScatteredNoise) {
  FusedCloud cloud;
  add_column(cloud, 2.0, 1.0, 0.0, 0.5, 0.2, 0.15, {});
  EXPECT_TRUE(people_in(cloud).empty());
  for (int i = 0; i < 40; ++i)  // flickering pixels of a far wall
    add_column(cloud, 4.0 + 0.02 * i, 3.0, 0.9 + 0.017 * (i * 7 % 40), 0.92 + 0.017 * (i * 7 % 40),
               0.02, 0.02, {});
  EXPECT_TRUE(people_in(cloud).empty());
}

TEST(Detector, FindsSomebodyWhoLies) {
  FusedCloud cloud;
  add_column(cloud, 3.0, 2.0, 0.0, 0.25, 0.2, 0.85, {});
  add_column(cloud, 3.0, 2.0, 0.22, 0.25, 0.1, 0.75, {});
  const auto found = people_in(cloud);
  ASSERT_EQ(found.size(), 1U);
  EXPECT_LT(found[0].top, 0.3F);
  EXPECT_GT(found[0].length, 1.2F);
}

TEST(Detector, JoinsHeadAndLegsOfOneWhoLiesPartlyHidden) {
  FusedCloud cloud;
  add_column(cloud, 3.0, 1.7, 0.0, 0.30, 0.30, 0.22, {});   // torso and head
  add_column(cloud, 3.0, 2.55, 0.0, 0.22, 0.30, 0.12, {});  // legs behind a seat's edge
  const auto found = people_in(cloud);
  ASSERT_EQ(found.size(), 1U);
  EXPECT_GT(found[0].length, 0.9F);
  EXPECT_NEAR(found[0].y, 1.7, 0.12);  // the torso, not the middle of the body
}

TEST(Detector, KeepsOneWhoLiesApartFromAHelperWhenHeIsExpectedThere) {
  FusedCloud cloud;
  add_column(cloud, 3.0, 2.0, 0.0, 0.30, 0.75, 0.22, {});
  add_person(cloud, 3.42, 1.9, 1.75);
  PersonPrior lying{3.0F, 2.0F, 0.30F, true, true, 1.57F};
  Detector detector(testing::room());
  bool on_the_floor = false, upright = false;
  for (const Detection& detection : detector.detect(cloud, {&lying, 1})) {
    on_the_floor = on_the_floor || (detection.top < 0.4F && detection.length > 0.8F);
    upright = upright || detection.top > 1.7F;
  }
  EXPECT_TRUE(on_the_floor);
  EXPECT_TRUE(upright);
}

TEST(Detector, DoesNotTakeTheTorsoOfOneWhoRisesForAHelper) {
  FusedCloud cloud;
  add_column(cloud, 3.0, 1.8, 0.0, 0.25, 0.55, 0.18, {});
  add_column(cloud, 3.0, 2.3, 0.0, 0.78, 0.25, 0.15, {});
  PersonPrior lying{3.0F, 2.0F, 0.74F, true, true, 1.57F};  // of a thirtieth of a second before
  Detector detector(testing::room());
  EXPECT_EQ(detector.detect(cloud, {&lying, 1}).size(), 1U);
  lying.head_top = 0.30F;  // who lies flat does not rise at once: this is somebody else
  EXPECT_EQ(detector.detect(cloud, {&lying, 1}).size(), 2U);
}

TEST(Detector, IsNotPulledForwardByTheLapOfASittingChild) {
  FusedCloud cloud;
  add_column(cloud, 3.0, 2.0, 0.75, 0.95, 0.08, 0.08, {});
  add_column(cloud, 3.0, 2.0, 0.42, 0.72, 0.15, 0.10, {});
  add_column(cloud, 3.3, 2.0, 0.30, 0.44, 0.12, 0.22, {});  // thighs
  Detector detector(testing::room());
  const auto found = detector.detect(cloud, {});
  ASSERT_EQ(found.size(), 1U);
  EXPECT_NEAR(found[0].x, 3.0, 0.04);
  EXPECT_NEAR(found[0].y, 2.0, 0.03);
}

TEST(Detector, KeepsAChildApartWhoseHeadATrackExpectsBelowAnAdultsShoulder) {
  FusedCloud cloud;
  add_person(cloud, 2.0, 1.0, 1.80);
  add_person(cloud, 2.0, 1.36, 1.20);
  const std::array<PersonPrior, 2> priors{PersonPrior{2.0F, 1.0F, 1.80F, false, false},
                                          PersonPrior{2.0F, 1.36F, 1.20F, false, false}};
  Detector detector(testing::room());
  const auto found = detector.detect(cloud, priors);
  ASSERT_EQ(found.size(), 2U);
  EXPECT_NEAR(found[0].y, 1.0, 0.08);
  EXPECT_NEAR(found[1].y, 1.36, 0.08);
  EXPECT_LT(found[1].top, 1.3F);
}

TEST(Detector, LabelsEveryPointOfAPersonWithIt) {
  FusedCloud cloud;
  add_person(cloud, 2.0, 1.0, 1.75);
  const std::size_t first = cloud.points.size();
  add_person(cloud, 4.0, 3.0, 1.60);
  Detector detector(testing::room());
  const auto found = detector.detect(cloud, {});
  ASSERT_EQ(found.size(), 2U);
  for (std::size_t i = 0; i < cloud.points.size(); ++i) {
    if (cloud.points[i].z < 0.2F) continue;  // feet are within the floor's noise
    const auto label = detector.labels()[i];
    ASSERT_NE(label, kNoDetection);
    EXPECT_NEAR(found[label].x, i < first ? 2.0 : 4.0, 0.1);
  }
}

}  // namespace
}  // namespace wagonsight

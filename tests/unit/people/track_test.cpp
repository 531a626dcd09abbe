#include "people/track.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "support/body_cloud.h"

namespace wagonsight {
namespace {

// A tracker over clouds of stand-ins, without any sensor: every unseen place is out of sight.
class Stage {
 public:
  explicit Stage(double rate_hz) : rate_hz_(rate_hz) {
    wagon_.inside = testing::room();
    wagon_.doors.push_back({Name("south"), {2.0, 0.0}, {4.0, 0.0}});
    tracker_ = std::make_unique<Tracker>(wagon_);
    visibility_ = std::make_unique<VisibilityGrid>(Rig{}, wagon_.inside);
    detector_ = std::make_unique<Detector>(wagon_.inside);
  }

  struct Stand {
    double x, y, height;
  };
  void step(std::initializer_list<Stand> people) {
    step(people, [](FusedCloud&) {});
  }
  // `furnish` adds what else is seen.
  template <class Furnish>
  void step(std::initializer_list<Stand> people, Furnish&& furnish) {
    cloud_.points.clear();
    cloud_.contributions.clear();
    furnish(cloud_);
    for (const Stand& stand : people) testing::add_person(cloud_, stand.x, stand.y, stand.height);
    const auto priors = tracker_->predict(frame_++ / rate_hz_);
    const auto found = detector_->detect(cloud_, priors);
    const auto shapes = describer_.describe(cloud_, detector_->labels(), found);
    tracker_->update(found, shapes, *visibility_);
  }
  std::vector<Person> told() const {
    std::vector<Person> people;
    for (const Track& track : tracker_->tracks())
      if (track.told) people.push_back(track.person);
    return people;
  }

 private:
  double rate_hz_;
  int frame_ = 0;
  Wagon wagon_;
  FusedCloud cloud_;
  std::unique_ptr<Tracker> tracker_;
  std::unique_ptr<VisibilityGrid> visibility_;
  std::unique_ptr<Detector> detector_;
  Describer describer_;
};

class TrackerAtRate : public ::testing::TestWithParam<double> {};

TEST_P(TrackerAtRate, FollowsAWalkWithOneIdentity) {
  const double rate = GetParam();
  Stage stage(rate);
  std::set<std::uint32_t> ids;
  for (int i = 0; i < 4 * rate; ++i) {
    stage.step({{1.0 + 1.0 * i / rate, 2.0, 1.75}});
    for (const Person& person : stage.told()) ids.insert(person.id);
  }
  EXPECT_EQ(ids.size(), 1U);
  ASSERT_EQ(stage.told().size(), 1U);
  EXPECT_NEAR(stage.told()[0].velocity[0], 1.0, 0.15);
  EXPECT_EQ(stage.told()[0].posture, Posture::kStanding);
  EXPECT_TRUE(stage.told()[0].has_head);
}

TEST_P(TrackerAtRate, KeepsTwoWhoPassEachOtherApart) {
  const double rate = GetParam();
  Stage stage(rate);
  const int last = static_cast<int>(4 * rate);
  std::uint32_t left_first = 0;
  for (int i = 0; i <= last; ++i) {
    const double along = 4.0 * i / last;
    stage.step({{1.0 + along, 1.7, 1.80}, {5.0 - along, 2.3, 1.60}});
    if (i == last / 4) {
      ASSERT_EQ(stage.told().size(), 2U);
      for (const Person& person : stage.told())
        if (person.position[0] < 3) left_first = person.id;
    }
  }
  ASSERT_EQ(stage.told().size(), 2U);
  for (const Person& person : stage.told()) {
    EXPECT_EQ(person.id == left_first, person.position[0] > 3);
  }
}

INSTANTIATE_TEST_SUITE_P(Rates, TrackerAtRate, ::testing::Values(2.5, 4.0, 10.0, 30.0));

TEST(Tracker, TellsNobodyAfterASingleFrame) {
  Stage stage(30);
  stage.step({{2, 2, 1.75}});
  EXPECT_TRUE(stage.told().empty());
  for (int i = 0; i < 5; ++i) stage.step({});
  EXPECT_TRUE(stage.told().empty());
}

TEST(Tracker, RecognisesWhoComesBackIntoSight) {
  Stage stage(10);
  for (int i = 0; i < 20; ++i) stage.step({{1.0 + 0.1 * i, 2.0, 1.75}});
  ASSERT_EQ(stage.told().size(), 1U);
  const auto id = stage.told()[0].id;
  for (int i = 0; i < 6; ++i) stage.step({});
  EXPECT_TRUE(stage.told().empty());  // out of every sensor's sight
  for (int i = 26; i < 32; ++i) stage.step({{1.0 + 0.1 * i, 2.0, 1.75}});
  ASSERT_EQ(stage.told().size(), 1U);
  EXPECT_EQ(stage.told()[0].id, id);
}

TEST(Tracker, KeepsTheHeightOfOneWhoSitsDown) {
  Stage stage(10);
  for (int i = 0; i < 15; ++i) stage.step({{2.0, 2.0, 1.80}});
  for (int i = 0; i < 15; ++i) stage.step({{2.0, 2.0, 1.80 - 0.03 * i}});
  for (int i = 0; i < 15; ++i) stage.step({{2.0, 2.0, 1.35}});
  ASSERT_EQ(stage.told().size(), 1U);
  EXPECT_NEAR(stage.told()[0].height, 1.80, 0.06);
  EXPECT_EQ(stage.told()[0].posture, Posture::kSitting);
}

TEST(Tracker, TellsWhoComesInByADoorFromTheThresholdOn) {
  Stage stage(30);
  double first_told = -9;
  for (int i = 0; i < 60; ++i) {
    const double y = -0.5 + i / 30.0;
    stage.step({{3.0, y, 1.75}});
    if (first_told < -1 && !stage.told().empty()) first_told = y;
  }
  EXPECT_NEAR(first_told, 0.0, 0.1);
  ASSERT_EQ(stage.told().size(), 1U);
}

TEST(Tracker, ForgetsWhoWentOutByADoorAtOnceAndTakesNoLeafForHim) {
  Stage stage(30);
  double last_told = 9;
  for (int i = 0; i < 75; ++i) {
    const double y = 2.0 - i / 30.0;
    stage.step({{3.0, y, 1.75}});
    if (!stage.told().empty()) last_told = y;
  }
  EXPECT_NEAR(last_told, 0.0, 0.12);
  for (int i = 0; i < 20; ++i) {  // the door's leaf closes
    stage.step({}, [&](FusedCloud& cloud) {
      testing::add_column(cloud, 2.9 + 0.01 * i, 0.06, 0.1, 1.4, 0.04, 0.15, {});
    });
    EXPECT_TRUE(stage.told().empty()) << i;
  }
}

TEST(Tracker, NeverTellsOfAPramAndKeepsTheOneWhoPushesIt) {
  Stage stage(30);
  std::set<std::uint32_t> ids;
  for (int i = 0; i < 120; ++i) {
    const double y = -0.9 + 0.8 * i / 30.0;
    stage.step({{3.0, y, 1.70}}, [&](FusedCloud& cloud) {
      testing::add_column(cloud, 3.0, y + 0.95, 0.05, 1.0, 0.42, 0.24, {});
    });
    for (const Person& person : stage.told()) ids.insert(person.id);
    EXPECT_LE(stage.told().size(), 1U) << i;
  }
  EXPECT_EQ(ids.size(), 1U);
  ASSERT_EQ(stage.told().size(), 1U);
  EXPECT_GT(stage.told()[0].height, 1.5);
}

TEST(Tracker, KeepsTwoWhoSitSideBySideApartWhenOneLeansOver) {
  Stage stage(30);
  for (int i = 0; i < 90; ++i) stage.step({{2.0, 2.0, 1.30}, {2.0, 2.55, 1.22}});
  ASSERT_EQ(stage.told().size(), 2U);
  const auto before = stage.told();
  for (int i = 0; i < 90; ++i) {  // until their heads touch, and for a while half of one is hidden
    const double lean = 0.35 * std::min(1.0, i / 20.0);
    if (i > 30 && i < 60)
      stage.step({{2.0, 2.55, 1.22}}, [&](FusedCloud& cloud) {
        testing::add_column(cloud, 2.0, 2.0 + lean, 1.06, 1.30, 0.08, 0.10, {});
      });
    else
      stage.step({{2.0, 2.0 + lean, 1.30}, {2.0, 2.55, 1.22}});
  }
  for (int i = 0; i < 60; ++i) stage.step({{2.0, 2.0, 1.30}, {2.0, 2.55, 1.22}});
  const auto after = stage.told();
  ASSERT_EQ(after.size(), 2U);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(after[i].id, before[i].id);
    EXPECT_NEAR(after[i].position[1], before[i].position[1], 0.1);
  }
}

// The child's head is under the adult's elbow for a while, and the adult's shoulder stands out of
// their common outline more than the child does.
TEST(Tracker, DoesNotTakeAnAdultsShoulderForTheChildBesideHim) {
  Stage stage(30);
  const auto arm = [](double x, double y) {
    return [x, y](FusedCloud& cloud) {
      testing::add_column(cloud, x, y + 0.20, 0.85, 1.52, 0.05, 0.05, {});
    };
  };
  for (int i = 0; i < 60; ++i) stage.step({{2.2, 1.95, 1.22}, {3.8, 1.60, 1.83}}, arm(3.8, 1.60));
  ASSERT_EQ(stage.told().size(), 2U);
  const auto child = stage.told()[0].position[0] < 3 ? stage.told()[0].id : stage.told()[1].id;
  for (int i = 0; i < 110; ++i) {  // he comes, stays, and the child walks on around him
    const double adult_x = std::max(2.25, 3.8 - i / 30.0);
    const double child_x = i < 50 ? 2.2 : std::min(3.2, 2.2 + (i - 50) / 30.0);
    stage.step({{child_x, 1.95, 1.22}, {adult_x, 1.60, 1.83}}, arm(adult_x, 1.60));
  }
  ASSERT_EQ(stage.told().size(), 2U);
  for (const Person& person : stage.told()) {
    EXPECT_EQ(person.id == child, person.position[0] > 2.9);
    EXPECT_NEAR(person.height, person.id == child ? 1.22 : 1.83, 0.08);
  }
}

TEST(Tracker, WaitsForWhoIsTakenForAPartOfANeighbourWhereHeWas) {
  Stage stage(30);
  for (int i = 0; i < 60; ++i) stage.step({{4.0, 2.0, 1.75}, {1.4 + i / 30.0, 2.0, 1.20}});
  ASSERT_EQ(stage.told().size(), 2U);
  for (int i = 0; i < 5; ++i) stage.step({{4.0, 2.0, 1.75}});
  const auto told = stage.told();
  ASSERT_EQ(told.size(), 2U);
  const double nearest = std::min(told[0].position[0], told[1].position[0]);
  EXPECT_NEAR(nearest, 3.37, 0.12);  // going on as he walked, he would be 16 cm farther
}

TEST(Tracker, KnowsWhoTurnsUpInTheMiddleForTheOneWhoWasLostThere) {
  Stage stage(30);
  for (int i = 0; i < 60; ++i) stage.step({{2.0, 2.0, 1.75}, {4.0, 2.0, 1.60}});
  ASSERT_EQ(stage.told().size(), 2U);
  const auto lost = stage.told()[0].position[0] < 3 ? stage.told()[0].id : stage.told()[1].id;
  for (int i = 0; i < 300; ++i) stage.step({{4.0, 2.0, 1.60}});
  EXPECT_EQ(stage.told().size(), 1U);
  for (int i = 0; i < 30; ++i) stage.step({{1.0, 3.0, 1.75}, {4.0, 2.0, 1.60}});
  ASSERT_EQ(stage.told().size(), 2U);
  for (const Person& person : stage.told()) EXPECT_EQ(person.id == lost, person.position[0] < 3);
}

TEST(Tracker, TakesWhoComesInByADoorForSomebodyElse) {
  Stage stage(30);
  for (int i = 0; i < 60; ++i) stage.step({{2.0, 2.0, 1.75}});
  ASSERT_EQ(stage.told().size(), 1U);
  const auto lost = stage.told()[0].id;
  for (int i = 0; i < 300; ++i) stage.step({});
  for (int i = 0; i < 60; ++i) stage.step({{3.0, -0.5 + i / 30.0, 1.75}});
  ASSERT_EQ(stage.told().size(), 1U);
  EXPECT_NE(stage.told()[0].id, lost);
}

TEST(Tracker, FollowsAFallWithOneIdentityAndSaysLying) {
  Stage stage(30);
  std::set<std::uint32_t> ids;
  const auto tell = [&] {
    for (const Person& person : stage.told()) ids.insert(person.id);
  };
  for (int i = 0; i < 60; ++i) stage.step({{3.0, 2.0, 1.75}}), tell();
  for (int i = 0; i < 12; ++i) {  // sinks and grows long
    const double share = (i + 1) / 12.0;
    stage.step({}, [&](FusedCloud& cloud) {
      testing::add_column(cloud, 3.0, 2.0 + 0.5 * share, 0.05, 1.70 - 1.42 * share,
                          0.22 + 0.5 * share, 0.15, {});
    });
    tell();
  }
  for (int i = 0; i < 60; ++i) {
    stage.step({}, [](FusedCloud& cloud) {
      testing::add_column(cloud, 3.0, 2.5, 0.0, 0.28, 0.75, 0.2, {});
    });
    tell();
  }
  EXPECT_EQ(ids.size(), 1U);
  ASSERT_EQ(stage.told().size(), 1U);
  EXPECT_EQ(stage.told()[0].posture, Posture::kLying);
  EXPECT_NEAR(stage.told()[0].height, 1.75, 0.06);
}

// The pram is pushed past the child faster than anybody is followed.
TEST(Tracker, DoesNotTakeAChildForThePramThatStoodBesideHim) {
  Stage stage(30);
  const auto pram = [](double x, double y) {
    return
        [x, y](FusedCloud& cloud) { testing::add_column(cloud, x, y, 0.05, 1.0, 0.42, 0.24, {}); };
  };
  for (int i = 0; i < 90; ++i)
    stage.step({{3.0, -0.9 + i / 30.0, 1.70}}, pram(3.0, 0.05 + i / 30.0));
  for (int i = 0; i < 90; ++i)
    stage.step({{3.0, 2.1, 1.70}, {2.3, std::min(2.0, -0.9 + i / 20.0), 1.22}}, pram(3.0, 3.05));
  ASSERT_EQ(stage.told().size(), 2U);
  const auto child = stage.told()[0].position[0] < 2.6 ? stage.told()[0].id : stage.told()[1].id;
  for (int i = 0; i < 45; ++i)  // beside the child
    stage.step({{3.0, 2.1, 1.70}, {2.3, 2.0, 1.22}}, pram(2.3, 3.05 - std::min(0.35, i * 0.02)));
  for (int i = 0; i < 30; ++i)
    stage.step({{3.0, 2.1, 1.70}, {2.3, 2.0, 1.22}}, pram(2.3 - 0.1, 1.3 - 0.01 * i));
  ASSERT_EQ(stage.told().size(), 2U);
  for (const Person& person : stage.told())
    if (person.position[0] < 2.6) {
      EXPECT_EQ(person.id, child);
      EXPECT_NEAR(person.position[1], 2.0, 0.1);
    }
}

TEST(Tracker, KeepsTwoWhoLieSideBySideApart) {
  Stage stage(30);
  const auto lying = [](FusedCloud& cloud, double x, double share) {
    testing::add_column(cloud, x, 2.0 + 0.4 * share, 0.0, 1.70 - 1.42 * share,
                        0.22 + 0.5 * share * share, 0.17, {});
  };
  for (int i = 0; i < 60; ++i) stage.step({{2.5, 2.0, 1.75}, {4.0, 2.0, 1.75}});
  for (int i = 0; i < 60; ++i)
    stage.step({{std::max(2.92, 4.0 - i / 40.0), 2.0, 1.75}},
               [&](FusedCloud& cloud) { lying(cloud, 2.5, std::min(1.0, i / 12.0)); });
  ASSERT_EQ(stage.told().size(), 2U);
  const auto before = stage.told();
  for (int i = 0; i < 90; ++i)
    stage.step({}, [&](FusedCloud& cloud) {
      lying(cloud, 2.5, 1.0);
      lying(cloud, 2.92, std::min(1.0, i / 15.0));
    });
  const auto after = stage.told();
  ASSERT_EQ(after.size(), 2U);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(after[i].id, before[i].id);
    EXPECT_EQ(after[i].posture, Posture::kLying);
    EXPECT_NEAR(after[i].position[0], before[i].position[0], 0.12);
  }
}

}  // namespace
}  // namespace wagonsight

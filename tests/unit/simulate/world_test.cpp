#include "simulate/world.h"

#include <gmock/gmock.h>

#include <cmath>
#include <string>

#include "support/scene_text.h"

namespace wagonsight {
namespace {

using testing::act_text;
using testing::door_text;
using testing::passenger_text;
using testing::seat_text;
using testing::wagon_text;

// A wagon with two seats, a door and nobody in it.
const std::string kRoom = wagon_text(6.0) + seat_text("left", "1.0, 0.35", 90) +
                          seat_text("right", "5.0, 2.35", -90) + door_text("door", 2.4, 3.6);

class Play {  // a world and its truth, by passenger name
 public:
  explicit Play(const std::string& passengers, std::uint64_t seed = 3)
      : scene_(*parse_scene(kRoom + passengers, "play.toml")), world_(scene_, seed) {}

  const Person* at(double seconds, const std::string& name) {
    world_.truth_at(HostTime(from_seconds(seconds)), truth_);
    for (const Person& person : truth_.people)
      if (scene_.passengers[person.id - 1].name == name) return &person;
    return nullptr;
  }
  std::size_t count(double seconds) {
    world_.truth_at(HostTime(from_seconds(seconds)), truth_);
    return truth_.people.size();
  }
  std::size_t standing_items(double seconds) {
    std::size_t count = 0;
    for (const StandingItem& item : world_.items_at(HostTime(from_seconds(seconds))))
      count += item.there ? 1 : 0;
    return count;
  }
  World& world() { return world_; }

 private:
  Scene scene_;
  World world_;
  PeopleFrame truth_;
};

double distance(const Person& person, double x, double y) {
  return std::hypot(person.position[0] - x, person.position[1] - y);
}

TEST(WorldTest, APassengerWithoutActsStandsWhereItStarts) {
  Play play(passenger_text("A", "height = 1.81\nstart = [3.0, 1.3]"));
  for (const double t : {0.0, 5.0, 60.0}) {
    const Person* person = play.at(t, "A");
    ASSERT_NE(person, nullptr);
    EXPECT_EQ(person->posture, Posture::kStanding);
    EXPECT_LT(distance(*person, 3.0, 1.3), 0.02);
    EXPECT_DOUBLE_EQ(person->height, 1.81);
    EXPECT_NEAR(person->box.center[2] + 0.5 * person->box.size[2], 1.81, 0.03);
  }
}

TEST(WorldTest, WhoHasADoorComesInByItAndCountsOnlyInside) {
  Play play(passenger_text("A", "door = 'door'"));
  EXPECT_EQ(play.count(0.5), 0U);
  bool came_by_the_door = false;
  for (double t = 0.5; t < 6; t += 0.02) {
    const Person* person = play.at(t, "A");
    if (person == nullptr) continue;
    if (!came_by_the_door) {
      EXPECT_GT(person->position[1], 2.6);
      EXPECT_GT(person->position[0], 2.4);
      EXPECT_LT(person->position[0], 3.6);
    }
    came_by_the_door = true;
  }
  EXPECT_TRUE(came_by_the_door);
  EXPECT_EQ(play.count(10), 1U);
}

TEST(WorldTest, SittingWalksToTheSeatFirstAndLeavingRisesFirst) {
  Play play(passenger_text("A", "start = [4.5, 1.3]") + act_text(1, "sit", "seat = 'left'") +
            act_text(20, "leave", "door = 'door'"));
  const Person* sitting = play.at(15, "A");
  ASSERT_NE(sitting, nullptr);
  EXPECT_EQ(sitting->posture, Posture::kSitting);
  EXPECT_LT(distance(*sitting, 1.0, 0.35), 0.2);
  EXPECT_LT(sitting->box.center[2] + 0.5 * sitting->box.size[2], 1.45);
  EXPECT_NEAR(std::hypot(sitting->velocity[0], sitting->velocity[1]), 0, 1e-9);
  EXPECT_EQ(play.count(19), 1U);
  const Person* walking = play.at(23, "A");
  ASSERT_NE(walking, nullptr);
  EXPECT_EQ(walking->posture, Posture::kStanding);
  EXPECT_GT(std::hypot(walking->velocity[0], walking->velocity[1]), 0.4);
  EXPECT_EQ(play.count(35), 0U);
}

TEST(WorldTest, AnActRunsToItsEndBeforeTheNextOneBegins) {
  Play play(passenger_text("A", "start = [0.6, 1.3]") +
            act_text(1, "walk", "to = [5.2, 1.3]\nspeed = 0.8") + act_text(1.5, "fall"));
  const Person* under_way = play.at(3, "A");
  ASSERT_NE(under_way, nullptr);
  EXPECT_EQ(under_way->posture, Posture::kStanding);
  const Person* fallen = play.at(15, "A");
  ASSERT_NE(fallen, nullptr);
  EXPECT_EQ(fallen->posture, Posture::kLying);
  EXPECT_GT(fallen->position[0], 3.5);
}

TEST(WorldTest, FallingLiesOnTheFloorAndRisingStandsUp) {
  Play play(passenger_text("A", "start = [3.0, 1.3]") + act_text(2, "fall") + act_text(10, "rise"));
  EXPECT_EQ(play.at(1.9, "A")->posture, Posture::kStanding);
  for (const double t : {3.5, 9.0}) {
    const Person* person = play.at(t, "A");
    EXPECT_EQ(person->posture, Posture::kLying);
    EXPECT_LT(person->box.center[2] + 0.5 * person->box.size[2], 0.45);
    EXPECT_GT(person->box.center[2] - 0.5 * person->box.size[2], -0.08);
    EXPECT_GT(std::max(person->box.size[0], person->box.size[1]), 1.4);
  }
  EXPECT_EQ(play.at(13, "A")->posture, Posture::kStanding);
  EXPECT_LT(distance(*play.at(13, "A"), 3.0, 1.3), 0.1);
}

TEST(WorldTest, ABagIsPutDownAndTakenByAnother) {
  Play play(passenger_text("A", "start = [2.0, 1.3]\ncarries = ['bag']") +
            act_text(2, "put", "item = 'bag'") + passenger_text("B", "start = [5.0, 1.3]") +
            act_text(6, "take", "item = 'bag'"));
  EXPECT_EQ(play.standing_items(1), 0U);
  EXPECT_EQ(play.standing_items(5), 1U);
  EXPECT_EQ(play.standing_items(16), 0U);
  EXPECT_TRUE(play.world().pose_at(1, HostTime(from_seconds(16))).bag);
  EXPECT_FALSE(play.world().pose_at(0, HostTime(from_seconds(16))).bag);
}

TEST(WorldTest, TwoLeanTogether) {
  Play play(passenger_text("A", "start = [3.0, 1.3]") + act_text(1, "lean") +
            passenger_text("B", "start = [3.5, 1.3]") + act_text(1, "lean"));
  const double apart = play.at(0.5, "B")->position[0] - play.at(0.5, "A")->position[0];
  const double together = play.at(4, "B")->position[0] - play.at(4, "A")->position[0];
  EXPECT_LT(together, apart - 0.1);
}

TEST(WorldTest, AChildIsSmallAndASeatIsReachedFromASeat) {
  Play play(passenger_text("C", "build = 'child'\nheight = 1.15\nseat = 'left'") +
            act_text(3, "sit", "seat = 'right'"));
  EXPECT_EQ(play.at(1, "C")->posture, Posture::kSitting);
  EXPECT_LT(distance(*play.at(1, "C"), 1.0, 0.35), 0.2);
  EXPECT_DOUBLE_EQ(play.at(1, "C")->height, 1.15);
  EXPECT_EQ(play.at(18, "C")->posture, Posture::kSitting);
  EXPECT_LT(distance(*play.at(18, "C"), 5.0, 2.35), 0.2);
}

TEST(WorldTest, NobodyWalksThroughSeatsOrOthers) {
  std::string passengers;
  for (int i = 0; i < 8; ++i) {
    const double x = i % 2 == 0 ? 0.5 : 5.5;
    passengers +=
        passenger_text(
            fmt::format("P{}", i),
            fmt::format("start = [{}, {}]", x + 0.1 * i * (i % 2 == 0 ? 1 : -1), 0.95 + 0.12 * i)) +
        act_text(i, "walk", fmt::format("to = [{}, {}]", 6.0 - x, 1.7 - 0.1 * i));
  }
  Play play(passengers);
  int close = 0, pairs = 0;
  for (double t = 0; t < 25; t += 0.1) {
    PeopleFrame truth;
    play.world().truth_at(HostTime(from_seconds(t)), truth);
    for (const Person& a : truth.people) {
      const bool in_left_seat = std::abs(a.position[0] - 1.0) < 0.15 && a.position[1] < 0.5;
      EXPECT_FALSE(in_left_seat);
      for (const Person& b : truth.people) {
        if (b.id <= a.id) continue;
        ++pairs;
        close += distance(a, b.position[0], b.position[1]) < 0.3 ? 1 : 0;
      }
    }
  }
  EXPECT_LT(close, pairs / 200);
}

TEST(WorldTest, ASceneThatRepeatsBeginsAgain) {
  const std::string text = "repeat = 20\n" + kRoom + passenger_text("A", "carries = ['bag']") +
                           act_text(1, "enter") + act_text(6, "put") + act_text(9, "take") +
                           act_text(12, "leave");
  World world(*parse_scene(text, "repeat.toml"), 3);
  PeopleFrame truth;
  for (int round = 0; round < 5; ++round) {
    const auto people_at = [&](double t) {
      world.truth_at(HostTime(from_seconds(20.0 * round + t)), truth);
      return truth.people.size();
    };
    const auto bag_at = [&](double t) {
      for (const StandingItem& item : world.items_at(HostTime(from_seconds(20.0 * round + t))))
        if (item.there) return true;
      return false;
    };
    EXPECT_EQ(people_at(0.5), 0U);
    EXPECT_EQ(people_at(5), 1U);
    EXPECT_FALSE(bag_at(5.5));
    EXPECT_TRUE(bag_at(8.5));
    EXPECT_FALSE(bag_at(11.9));
    EXPECT_EQ(people_at(18), 0U);
  }
}

TEST(WorldTest, VelocityIsThatOfThePosition) {
  Play play(passenger_text("A", "start = [0.6, 1.3]") + act_text(1, "walk", "to = [5.4, 1.3]"));
  double before = play.at(2.5, "A")->position[0];
  for (double t = 2.6; t < 4.5; t += 0.1) {
    const Person* person = play.at(t, "A");
    const double mean = (person->position[0] - before) / 0.1;
    EXPECT_NEAR(person->velocity[0], mean, 0.25) << t;
    before = person->position[0];
  }
}

TEST(WorldTest, TwoWorldsOfOneSeedAreEqualAndOfTwoAreNot) {
  const std::string passengers =
      passenger_text("A", "door = 'door'") + act_text(1, "walk", "to = [5.0, 1.2]");
  Play a(passengers, 5), b(passengers, 5), c(passengers, 6);
  const Person* p = a.at(4, "A");
  const Person* q = b.at(4, "A");
  const Person* r = c.at(4, "A");
  ASSERT_TRUE(p != nullptr && q != nullptr && r != nullptr);
  EXPECT_EQ(p->position, q->position);
  EXPECT_EQ(p->ellipsoid.semi_axes, q->ellipsoid.semi_axes);
  EXPECT_NE(p->position, r->position);
}

}  // namespace
}  // namespace wagonsight

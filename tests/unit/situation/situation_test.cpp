#include "situation/situation.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace wagonsight {
namespace {

Wagon small_wagon() {
  Wagon wagon;
  wagon.inside = {{0, 0, 0}, {6, 2.7, 2.4}};
  Zone front;
  front.name = "front";
  for (const std::array<double, 2> corner :
       {std::array{0.0, 0.0}, std::array{2.0, 0.0}, std::array{2.0, 2.7}, std::array{0.0, 2.7}})
    front.polygon.push_back(corner);
  front.capacity = 2;
  wagon.zones.push_back(front);
  wagon.seats.push_back({"s1", {0.75, 0.35}, 1.57, 0.48});
  wagon.seats.push_back({"s2", {1.25, 0.35}, 1.57, 0.48});
  wagon.doors.push_back({"north", {2.35, 2.7}, {3.65, 2.7}});
  return wagon;
}

Person somebody(std::uint32_t id, double x, double y, Posture posture, double top) {
  Person person;
  person.id = id;
  person.position = {x, y};
  person.posture = posture;
  person.height = 1.75;
  person.box.center = {x, y, top / 2};
  person.box.size = {0.5, 0.3, top};
  return person;
}

class SituationTest : public ::testing::Test {
 protected:
  void at(double time, std::initializer_list<Person> people) {
    frame_.time = time;
    frame_.people.clear();
    for (Person person : people) {
      person.last_seen = time;
      frame_.people.push_back(person);
    }
    occupancy_ = &situation_.update(frame_, unseen_, doors_);
  }
  std::vector<EventKind> events() const {
    std::vector<EventKind> kinds;
    for (const Event& event : frame_.events) kinds.push_back(event.kind);
    return kinds;
  }

  VisibilityGrid unseen_{Rig{}, small_wagon().inside};  // no sensor: nothing is observed
  Situation situation_{small_wagon()};
  PeopleFrame frame_;
  const Occupancy* occupancy_ = nullptr;
  std::vector<DoorState> doors_;  // what the train says; empty: nothing
};

TEST_F(SituationTest, CountsZonesAndSeats) {
  at(0,
     {somebody(1, 0.8, 0.4, Posture::kSitting, 1.3), somebody(2, 4, 1, Posture::kStanding, 1.7)});
  EXPECT_EQ(occupancy_->count, 2U);
  EXPECT_EQ(occupancy_->zones[0].count, 1U);
  EXPECT_EQ(occupancy_->seats[0].state, Occupied::kOccupied);
  EXPECT_EQ(occupancy_->seats[0].person, 1U);
  // Nobody there and nobody looking: not free.
  EXPECT_EQ(occupancy_->seats[1].state, Occupied::kUnobserved);
  EXPECT_EQ(occupancy_->observed_share, 0);
}

TEST_F(SituationTest, TellsAFallFromLyingDown) {
  for (int i = 0; i <= 10; ++i) at(0.1 * i, {somebody(7, 3, 1, Posture::kStanding, 1.7)});
  at(1.6, {somebody(7, 3, 1, Posture::kLying, 0.3)});
  ASSERT_THAT(events(), ::testing::ElementsAre(EventKind::kFall));
  EXPECT_EQ(frame_.events[0].person, 7U);
  EXPECT_NEAR(frame_.events[0].since, 1.6, 1e-9);
  EXPECT_NE(frame_.events[0].evidence.view().find("standing until 1.0 s"), std::string_view::npos);

  for (int i = 0; i <= 10; ++i) at(10 + 0.1 * i, {somebody(8, 3, 1, Posture::kStanding, 1.7)});
  for (int i = 0; i <= 50; ++i) at(11 + 0.1 * i, {somebody(8, 3, 1, Posture::kSitting, 1.2)});
  at(16.1, {somebody(8, 3, 1, Posture::kLying, 0.6)});
  EXPECT_TRUE(events().empty());
}

TEST_F(SituationTest, TellsNoFallOfOneWhoLiesDownInASecondOrMore) {
  const auto sink = [&](std::uint32_t id, double start, double seconds) {
    for (int i = 0; i <= 10; ++i)
      at(start + 0.1 * i, {somebody(id, 3, 1, Posture::kStanding, 1.7)});
    for (int i = 1; i <= 30; ++i) {
      const double share = i / 30.0;
      const double top = 1.7 - 1.3 * share;
      at(start + 1 + seconds * share,
         {somebody(id, 3, 1, top < 0.65 ? Posture::kLying : Posture::kStanding, top)});
    }
  };
  sink(1, 0, 0.7);
  ASSERT_THAT(events(), ::testing::ElementsAre(EventKind::kFall));
  sink(2, 10, 2.2);
  EXPECT_TRUE(events().empty());
}

TEST_F(SituationTest, CountsWhoBoardsAndWhoAlights) {
  for (int i = 0; i <= 20; ++i)
    at(0.1 * i, {somebody(3, 3, 2.5 - 0.1 * i, Posture::kStanding, 1.7)});
  EXPECT_EQ(occupancy_->doors[0].boarded, 1U);
  EXPECT_EQ(occupancy_->doors[0].alighted, 0U);
  for (int i = 0; i <= 20; ++i)
    at(5 + 0.1 * i, {somebody(4, 3, 0.5 + 0.1 * i, Posture::kStanding, 1.7)});
  at(10, {});
  EXPECT_EQ(occupancy_->doors[0].boarded, 1U);
  EXPECT_EQ(occupancy_->doors[0].alighted, 1U);
}

TEST_F(SituationTest, NobodyComesOrGoesByAClosedDoor) {
  const auto walk_in = [&](std::uint32_t id, double start) {
    for (int i = 0; i <= 20; ++i)
      at(start + 0.1 * i, {somebody(id, 3, 2.5 - 0.1 * i, Posture::kStanding, 1.7)});
  };
  const auto walk_out = [&](std::uint32_t id, double start) {
    for (int i = 0; i <= 20; ++i)
      at(start + 0.1 * i, {somebody(id, 3, 0.5 + 0.1 * i, Posture::kStanding, 1.7)});
    at(start + 5, {});
  };
  doors_ = {DoorState::kClosed};
  walk_in(3, 0);   // was hidden, and is seen again in the doorway
  walk_out(4, 5);  // and is hidden there
  EXPECT_EQ(occupancy_->doors[0].boarded, 0U);
  EXPECT_EQ(occupancy_->doors[0].alighted, 0U);
  doors_ = {DoorState::kOpen};
  walk_in(5, 20);
  EXPECT_EQ(occupancy_->doors[0].boarded, 1U);
  walk_out(6, 30);
  EXPECT_EQ(occupancy_->doors[0].alighted, 1U);
  // The train stopped telling: as without its signals.
  doors_ = {DoorState::kUnknown};
  walk_out(7, 40);
  EXPECT_EQ(occupancy_->doors[0].alighted, 2U);
}

TEST_F(SituationTest, ThoseWhoPassAsTheDoorClosesAreCounted) {
  doors_ = {DoorState::kOpen};
  at(0, {});
  doors_ = {DoorState::kClosed};
  for (int i = 0; i <= 20; ++i)  // the track begins when the door is a second behind them
    at(1 + 0.1 * i, {somebody(3, 3, 2.2 - 0.1 * i, Posture::kStanding, 1.7)});
  EXPECT_EQ(occupancy_->doors[0].boarded, 1U);
}

TEST_F(SituationTest, DoesNotCountWhoOnlyLooksIn) {
  for (int i = 0; i <= 20; ++i) at(0.1 * i, {somebody(3, 3, 2.5, Posture::kStanding, 1.7)});
  at(10, {});
  EXPECT_EQ(occupancy_->doors[0].boarded, 0U);
  EXPECT_EQ(occupancy_->doors[0].alighted, 0U);
}

TEST_F(SituationTest, TellsRunningAndCrowding) {
  for (int i = 0; i <= 10; ++i) {
    Person runner = somebody(5, 0.5 + 0.3 * i, 1, Posture::kStanding, 1.7);
    runner.velocity = {3.0, 0};
    at(0.1 * i, {runner});
  }
  EXPECT_THAT(events(), ::testing::ElementsAre(EventKind::kRunning));
  for (int i = 0; i <= 40; ++i)
    at(10 + 0.1 * i, {somebody(11, 0.5, 1, Posture::kStanding, 1.7),
                      somebody(12, 1.0, 1, Posture::kStanding, 1.7),
                      somebody(13, 1.5, 1, Posture::kStanding, 1.7)});
  EXPECT_THAT(events(), ::testing::ElementsAre(EventKind::kCrowding));  // capacity 2
}

}  // namespace
}  // namespace wagonsight

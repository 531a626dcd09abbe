#include "pipeline/pipeline.h"

#include <gtest/gtest.h>

#include <set>

#include "allocation_count.h"
#include "snapshot/json_lines.h"
#include "support/drawn_room.h"

namespace wagonsight {
namespace {

using testing::Column;
using testing::drawn_person;

// Two sensors in opposite corners of the drawn room.
class DrawnRoom {
 public:
  DrawnRoom() {
    rig_.sensors.push_back(testing::drawn_sensor("k0", {0.1, 0.1, 2.3}, {3.5, 2.2, 0.8}));
    rig_.sensors.push_back(testing::drawn_sensor("k1", {5.9, 3.9, 2.3}, {2.5, 1.8, 0.8}));
    for (std::size_t i = 0; i < 2; ++i) {
      tables_[i] = make_ray_table(rig_.sensors[i].camera);
      rays_[i] = tables_[i];
    }
    auto made = Pipeline::create(rig_, rays_, testing::drawn_wagon(), {});
    EXPECT_TRUE(made.has_value());
    pipeline_ = std::move(*made);
  }

  FrameSet frames(double seconds, const std::vector<Column>& columns) {
    FrameSet set;
    set.instant = HostTime{from_seconds(seconds)};
    for (std::size_t i = 0; i < 2; ++i) {
      testing::draw(rig_.sensors[i], columns, pixels_[i]);
      slots_[i].width = 320;
      slots_[i].height = 240;
      slots_[i].instant = set.instant;
      slots_[i].bytes = std::as_writable_bytes(std::span(pixels_[i]));
      set.sensors[i] = {FrameState::kPresent, &slots_[i], {}};
    }
    return set;
  }
  void learn_empty() {
    for (int i = 0; i < 8; ++i) pipeline_->learn(frames(0.25 * i, {}));
    pipeline_->finish_learning();
  }
  Pipeline& pipeline() { return *pipeline_; }

 private:
  Rig rig_;
  std::array<std::vector<PixelRay>, 2> tables_;
  std::array<RayTable, kSensorsMax> rays_{};
  std::array<std::vector<std::uint16_t>, 2> pixels_;
  std::array<FrameSlot, 2> slots_;
  std::unique_ptr<Pipeline> pipeline_;
};

TEST(Pipeline, FollowsAWalkerThroughTheRoom) {
  DrawnRoom room;
  room.learn_empty();
  std::set<std::uint32_t> ids;
  double error = 0;
  int seen = 0;
  for (int i = 0; i < 40; ++i) {
    const double x = 1.5 + 0.08 * i;
    const auto set = room.frames(3 + 0.1 * i, drawn_person(x, 2.0, 1.75));
    const PeopleFrame& frame = room.pipeline().process(set);
    ASSERT_LE(frame.people.size(), 1U) << "frame " << i;
    EXPECT_EQ(frame.skews.size(), 2U);
    for (const Person& person : frame.people) {
      ids.insert(person.id);
      error += std::hypot(person.position[0] - x, person.position[1] - 2.0);
      ++seen;
      EXPECT_EQ(person.posture, Posture::kStanding);
      EXPECT_NEAR(person.height, 1.75, 0.06);
    }
  }
  EXPECT_EQ(ids.size(), 1U);
  EXPECT_GE(seen, 38);
  EXPECT_LT(error / seen, 0.06);
}

TEST(Pipeline, DoesNotAllocateAfterItWasMade) {
  DrawnRoom room;
  room.learn_empty();
  std::array<FrameSet, 1> set;
  std::size_t during = 0;
  std::size_t people = 0;
  for (int i = 0; i < 20; ++i) {
    auto columns = drawn_person(1.5 + 0.1 * i, 2.0, 1.75);
    for (const Column& column : drawn_person(4.0, 1.2 + 0.05 * i, 1.60)) columns.push_back(column);
    set[0] = room.frames(3 + 0.1 * i, columns);
    if (i == 12) set[0].sensors[1] = {FrameState::kLost, nullptr, {}};
    const std::size_t before = testing::allocation_count();
    people = room.pipeline().process(set[0]).people.size();
    during += testing::allocation_count() - before;
  }
  EXPECT_EQ(during, 0U);
  EXPECT_EQ(people, 2U);
  EXPECT_GT(testing::allocation_count(), 0U);  // the counter itself is at work
}

TEST(Pipeline, GivesTheSameBytesForTheSameFrames) {
  std::array<std::string, 2> told;
  for (std::string& text : told) {
    DrawnRoom room;
    room.learn_empty();
    for (int i = 0; i < 12; ++i)
      append_people_line(
          room.pipeline().process(room.frames(3 + 0.1 * i, drawn_person(2 + 0.1 * i, 2, 1.7))),
          true, text);
  }
  EXPECT_FALSE(told[0].empty());
  EXPECT_EQ(told[0], told[1]);
}

TEST(Pipeline, KeepsWhoIsHiddenWhileASensorIsLost) {
  DrawnRoom room;
  room.learn_empty();
  for (int i = 0; i < 12; ++i)
    room.pipeline().process(room.frames(3 + 0.1 * i, drawn_person(3, 2, 1.7)));
  FrameSet lost = room.frames(4.2, drawn_person(3, 2, 1.7));
  lost.sensors[0] = lost.sensors[1] = {FrameState::kLost, nullptr, {}};
  const PeopleFrame& frame = room.pipeline().process(lost);
  EXPECT_EQ(frame.people.size(), 1U);
  EXPECT_TRUE(frame.skews.empty());
}

TEST(Pipeline, KeepsItsBackgroundAsBytes) {
  DrawnRoom room;
  room.learn_empty();
  const auto bytes = room.pipeline().save_background();
  DrawnRoom other;
  EXPECT_TRUE(other.pipeline().learning());
  ASSERT_TRUE(other.pipeline().load_background(bytes).has_value());
  EXPECT_FALSE(other.pipeline().learning());
  for (int i = 0; i < 4; ++i)
    other.pipeline().process(other.frames(3 + 0.1 * i, drawn_person(3, 2, 1.7)));
  EXPECT_EQ(other.pipeline().process(other.frames(3.4, drawn_person(3, 2, 1.7))).people.size(), 1U);

  auto damaged = bytes;
  damaged[damaged.size() / 2] ^= std::byte{1};
  const auto refused = other.pipeline().load_background(damaged);
  ASSERT_FALSE(refused.has_value());
  EXPECT_NE(refused.error().message.find("damaged"), std::string::npos);
  EXPECT_FALSE(other.pipeline().load_background(std::span(bytes).first(10)).has_value());
}

TEST(Pipeline, RefusesARigWithoutSensors) {
  const auto made = Pipeline::create({}, {}, testing::drawn_wagon(), {});
  ASSERT_FALSE(made.has_value());
  EXPECT_NE(made.error().message.find("no sensor"), std::string::npos);
}

}  // namespace
}  // namespace wagonsight

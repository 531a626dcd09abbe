#include "foreground/extractor.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <vector>

#include "support/allocation_counter.h"
#include "support/rendered_room.h"

namespace wagonsight {
namespace {

using testing_support::RenderedRoom;
using testing_support::RoomBox;

// A room, its extractor and a clock; feeds frames and counts.
struct Watch {
  RenderedRoom room;
  double rate_hz;
  std::unique_ptr<ForegroundExtractor> extractor;
  Foreground foreground;
  int frame = 0;

  explicit Watch(double rate = 30, RenderedRoom the_room = RenderedRoom())
      : room(std::move(the_room)), rate_hz(rate), foreground(room.rays.size()) {
    auto made = ForegroundExtractor::create(room.sensor, room.rays, room.wagon, {});
    EXPECT_TRUE(made.has_value());
    extractor = std::move(*made);
  }
  HostTime now() const { return HostTime{} + from_seconds(frame / rate_hz); }
  void learn(const std::vector<RoomBox>& boxes, double seconds) {
    for (const int end = frame + static_cast<int>(seconds * rate_hz); frame < end; ++frame) {
      const auto image = room.render(boxes, frame);
      extractor->learn(room.view(image), now());
    }
    extractor->finish_learning();
  }
  void see(const std::vector<RoomBox>& boxes) {
    const auto image = room.render(boxes, frame);
    extractor->extract(room.view(image), now(), foreground);
    ++frame;
  }
  void watch(const std::vector<RoomBox>& boxes, double seconds) {
    for (const int end = frame + static_cast<int>(seconds * rate_hz); frame < end;) see(boxes);
  }
  double area() const {
    double sum = 0;
    for (const Blob& blob : foreground.blobs) sum += static_cast<double>(blob.area_m2);
    return sum;
  }
  bool is_foreground(std::size_t pixel) const {
    return ((foreground.mask[pixel / 64] >> (pixel % 64)) & 1) != 0;
  }
  // Intersection over union of the mask and the pixels that truly see one of the boxes, without
  // those that noise cannot tell from what is behind them.
  double overlap(const std::vector<RoomBox>& boxes) {
    std::vector<bool> truth;
    const auto image = room.render(boxes, frame - 1, &truth);
    const auto empty = room.render({}, -1);
    double both = 0, either = 0;
    for (std::size_t pixel = 0; pixel < image.size(); ++pixel) {
      const double tolerance = 3.5 * room.sensor.noise.sigma(empty[pixel] * 0.001) + 0.04;
      if (truth[pixel] && empty[pixel] * 0.001 - image[pixel] * 0.001 < tolerance) continue;
      both += truth[pixel] && is_foreground(pixel) ? 1 : 0;
      either += truth[pixel] || is_foreground(pixel) ? 1 : 0;
    }
    return either == 0 ? 1 : both / either;
  }
};

const std::vector<RoomBox> kNobody;

TEST(ForegroundExtractor, FindsNobodyInALearnedEmptyRoom) {
  Watch watch;
  watch.learn(kNobody, 3);
  for (int i = 0; i < 60; ++i) {
    watch.see(kNobody);
    EXPECT_EQ(watch.foreground.blobs.size(), 0U) << "frame " << i;
    EXPECT_TRUE(watch.foreground.background_known);
  }
}

TEST(ForegroundExtractor, MarksThePixelsOfWhoEntersALearnedRoom) {
  Watch watch;
  watch.learn(kNobody, 3);
  double x = 1.2;
  for (int i = 0; i < 40; ++i, x += 0.05) {
    const std::vector<RoomBox> boxes{RenderedRoom::somebody_at(x, 1.6)};
    watch.see(boxes);
    EXPECT_GT(watch.overlap(boxes), 0.9) << "at " << x;
  }
}

TEST(ForegroundExtractor, PlacesPointsInTheWorld) {
  Watch watch;
  watch.learn(kNobody, 3);
  const RoomBox somebody = RenderedRoom::somebody_at(3.0, 1.7);
  watch.watch({somebody}, 0.2);
  ASSERT_GT(watch.foreground.points.size(), 50U);
  std::size_t blob_before = 0;
  for (const ForegroundPoint& p : watch.foreground.points) {
    EXPECT_GE(p.blob, blob_before);  // grouped by blob
    blob_before = p.blob;
    const double off = 4 * static_cast<double>(p.sigma) + 0.02;
    EXPECT_TRUE((Eigen::Vector3d(static_cast<double>(p.x), static_cast<double>(p.y),
                                 static_cast<double>(p.z))
                     .array() >= somebody.min.array() - off)
                    .all());
    EXPECT_LE(static_cast<double>(p.z), 1.7 + off);
    EXPECT_NEAR(static_cast<double>(p.sigma),
                watch.room.sensor.noise.sigma(
                    static_cast<double>(watch.extractor->view().depth_of({p.x, p.y, p.z}))),
                1e-4);
  }
}

TEST(ForegroundExtractor, NeverAbsorbsAMotionlessPassenger) {
  // Ten minutes at four frames a second. Noise repeats after 40 frames; it is rendered once.
  Watch watch(4);
  watch.watch(kNobody, 4);
  const std::vector<RoomBox> sitter{RenderedRoom::somebody_at(2.8, 0.6)};
  watch.watch(sitter, 2);
  const double at_first = watch.area();
  ASSERT_GT(at_first, 0.2);
  std::vector<std::vector<std::uint16_t>> images;
  for (int i = 0; i < 40; ++i) images.push_back(watch.room.render(sitter, i));
  for (int i = 0; i < 10 * 60 * 4; ++i, ++watch.frame) {
    watch.extractor->extract(watch.room.view(images[static_cast<std::size_t>(i) % 40]), watch.now(),
                             watch.foreground);
    ASSERT_GT(watch.area(), 0.9 * at_first) << "after " << i / 4.0 << " s";
  }
  EXPECT_GT(watch.overlap(sitter), 0.9);
}

TEST(ForegroundExtractor, ShowsWhoWasThereFromTheStartOnceHeMoves) {
  Watch watch(10);
  watch.watch({RenderedRoom::somebody_at(2.2, 1.7)}, 5);
  EXPECT_EQ(watch.foreground.blobs.size(), 0U);  // nobody can know yet
  // He walks across the room in two seconds and stops.
  for (int i = 0; i < 20; ++i) watch.see({RenderedRoom::somebody_at(2.2 + 0.1 * i, 1.7)});
  const std::vector<RoomBox> boxes{RenderedRoom::somebody_at(4.1, 1.7)};
  watch.watch(boxes, 4);
  EXPECT_GT(watch.overlap(boxes), 0.9);
  // He leaves, and no ghost stays anywhere.
  watch.watch(kNobody, 1);
  EXPECT_EQ(watch.foreground.blobs.size(), 0U);
  // The next one where he had stood is seen as if he had never been there.
  const std::vector<RoomBox> next{RenderedRoom::somebody_at(2.2, 1.7)};
  watch.watch(next, 0.3);
  EXPECT_GT(watch.overlap(next), 0.9);
}

TEST(ForegroundExtractor, ForgetsFurnitureThatIsTakenAway) {
  Watch watch(10);
  const RoomBox parcel{{3.0, 1.4, 0.0}, {3.5, 1.9, 0.9}};
  watch.learn({parcel}, 4);
  watch.watch({parcel}, 1);
  EXPECT_EQ(watch.foreground.blobs.size(), 0U);
  watch.watch(kNobody, 12);
  EXPECT_EQ(watch.foreground.blobs.size(), 0U);  // no ghost
  const std::vector<RoomBox> somebody{RenderedRoom::somebody_at(3.25, 1.65)};
  watch.watch(somebody, 0.3);
  EXPECT_GT(watch.overlap(somebody), 0.9);  // nothing is hidden
}

TEST(ForegroundExtractor, SeesSomebodyBeforeAWindowThatNeverGaveAReading) {
  RenderedRoom room;
  room.furniture.push_back({{5.9, 0.3, 0.0}, {6.0, 2.4, 2.3}, true});
  for (const bool learned : {true, false}) {
    Watch watch(10, room);
    if (learned) {
      watch.learn(kNobody, 3);
    } else {
      watch.watch(kNobody, 4);
    }
    EXPECT_EQ(watch.foreground.blobs.size(), 0U);
    const std::vector<RoomBox> somebody{RenderedRoom::somebody_at(5.0, 1.4)};
    watch.watch(somebody, 20);
    EXPECT_GT(watch.overlap(somebody), 0.9) << (learned ? "learned" : "as it went");
  }
}

TEST(ForegroundExtractor, TakesNothingInAMaskVolumeForSomebody) {
  RenderedRoom room;
  MaskVolume screen;
  screen.name = "screen";
  screen.bounds = {{3.0, 1.2, 0.8}, {3.6, 2.0, 1.6}};
  room.wagon.masks.push_back(screen);
  Watch watch(10, room);
  watch.learn(kNobody, 3);
  watch.watch({{{3.1, 1.3, 0.9}, {3.5, 1.9, 1.5}}}, 1);
  EXPECT_EQ(watch.foreground.blobs.size(), 0U);
}

TEST(ForegroundExtractor, LearnsWithPeoplePassing) {
  Watch watch(10);
  for (int i = 0; i < 80; ++i, ++watch.frame) {
    const auto image =
        watch.room.render({RenderedRoom::somebody_at(1.0 + 0.05 * i, 1.8)}, watch.frame);
    watch.extractor->learn(watch.room.view(image), watch.now());
  }
  watch.extractor->finish_learning();
  EXPECT_GT(watch.extractor->background_share(), 0.99);
  watch.see(kNobody);
  EXPECT_EQ(watch.foreground.blobs.size(), 0U);
  const std::vector<RoomBox> somebody{RenderedRoom::somebody_at(3.0, 1.8)};
  watch.see(somebody);
  EXPECT_GT(watch.overlap(somebody), 0.9);
}

TEST(ForegroundExtractor, GivesTheSameBytesForTheSameFrames) {
  Watch a(10), b(10);
  for (int i = 0; i < 30; ++i) {
    const std::vector<RoomBox> boxes{RenderedRoom::somebody_at(1.5 + 0.08 * i, 1.7)};
    a.see(boxes);
    b.see(boxes);
    ASSERT_TRUE(
        std::equal(a.foreground.mask.begin(), a.foreground.mask.end(), b.foreground.mask.begin()));
    ASSERT_EQ(a.foreground.points.size(), b.foreground.points.size());
  }
  EXPECT_EQ(a.extractor->save_background(), b.extractor->save_background());
}

TEST(ForegroundExtractor, AsksNothingOfTheHeapOnceItRuns) {
  Watch watch(10);
  std::vector<std::vector<std::uint16_t>> images;
  for (int i = 0; i < 30; ++i) {
    images.push_back(watch.room.render({RenderedRoom::somebody_at(1.5 + 0.1 * i, 1.7)}, i));
  }
  const long before = testing_support::allocation_count();
  for (const auto& image : images) {
    watch.extractor->extract(watch.room.view(image), watch.now(), watch.foreground);
    ++watch.frame;
  }
  EXPECT_EQ(testing_support::allocation_count(), before);
  EXPECT_GT(before, 0);  // the counter counts
}

TEST(ForegroundExtractor, ReadsBackTheBackgroundItWrote) {
  Watch first(10);
  first.learn(kNobody, 3);
  const auto bytes = first.extractor->save_background();
  Watch second(10);
  ASSERT_TRUE(second.extractor->load_background(bytes).has_value());
  EXPECT_FALSE(second.extractor->learning());
  EXPECT_EQ(second.extractor->save_background(), bytes);
  second.frame = first.frame;
  const std::vector<RoomBox> somebody{RenderedRoom::somebody_at(3.0, 1.7)};
  first.see(somebody);
  second.see(somebody);
  EXPECT_GT(second.overlap(somebody), 0.9);
  EXPECT_TRUE(std::equal(first.foreground.mask.begin(), first.foreground.mask.end(),
                         second.foreground.mask.begin()));
}

TEST(ForegroundExtractor, RefusesABackgroundThatDoesNotFit) {
  using testing::HasSubstr;
  Watch watch(10);
  watch.learn(kNobody, 1);
  const auto good = watch.extractor->save_background();
  const auto message = [&](std::vector<std::byte> bytes) {
    const auto result = watch.extractor->load_background(bytes);
    return result.has_value() ? std::string("accepted") : result.error().message;
  };
  EXPECT_EQ(message(good), "accepted");
  EXPECT_THAT(message({}), HasSubstr("too short"));
  EXPECT_THAT(message({good.begin(), good.end() - 9}), HasSubstr("damaged"));
  auto flipped = good;
  flipped[good.size() / 2] ^= std::byte{4};
  EXPECT_THAT(message(flipped), HasSubstr("damaged"));
  Watch other(10, RenderedRoom(0.125));
  other.learn(kNobody, 1);
  EXPECT_THAT(message(other.extractor->save_background()), HasSubstr("another image size"));
  EXPECT_EQ(message(good), "accepted");
}

TEST(ForegroundExtractor, SaysWhatCannotBeServed) {
  using testing::HasSubstr;
  const RenderedRoom room;
  const auto message = [&](const RigSensor& sensor, const Wagon& wagon, ForegroundOptions options) {
    const auto made = ForegroundExtractor::create(sensor, room.rays, wagon, options);
    return made.has_value() ? std::string("accepted") : made.error().message;
  };
  EXPECT_EQ(message(room.sensor, room.wagon, {}), "accepted");
  ForegroundOptions options;
  options.leaf_m = 0.001;
  EXPECT_THAT(message(room.sensor, room.wagon, options), HasSubstr("leaf size"));
  options = {};
  options.voxel_m = 0;
  EXPECT_THAT(message(room.sensor, room.wagon, options), HasSubstr("voxel_m"));
  RigSensor sensor = room.sensor;
  sensor.trim_far = 0.1;
  EXPECT_THAT(message(sensor, room.wagon, {}), HasSubstr("trim_m"));
  sensor = room.sensor;
  sensor.camera.width = 1;
  EXPECT_THAT(message(sensor, room.wagon, {}), HasSubstr("rays"));
  Wagon wagon = room.wagon;
  wagon.inside.max = {900, 900, 900};
  EXPECT_THAT(message(room.sensor, wagon, {}), HasSubstr("smaller inside"));
}

// No frame may cost much more than another, from the first on: counted, not timed.
TEST(ForegroundExtractor, DrawsTheFirstBackgroundUpInBoundedSteps) {
  RenderedRoom room;
  ForegroundOptions options;
  options.first_background_s = 1.0;
  const auto made = ForegroundExtractor::create(room.sensor, room.rays, room.wagon, options);
  ASSERT_TRUE(made.has_value());
  ForegroundExtractor& extractor = **made;
  const auto at_once = ForegroundExtractor::create(room.sensor, room.rays, room.wagon, {});
  Foreground foreground(room.rays.size()), other(room.rays.size());
  constexpr double kFrame_s = 1.0 / 30;
  std::size_t work = 0, frames = 0;
  bool known = false;
  const auto image = room.render({}, 0);
  for (int frame = 0; frame < 90; ++frame) {
    const HostTime now = HostTime{} + from_seconds(frame * kFrame_s);
    extractor.extract(room.view(image), now, foreground);
    if (frame == 0) (*at_once)->extract(room.view(image), now, other);
    const std::size_t last_row = static_cast<std::size_t>(room.sensor.camera.width) * 50;
    EXPECT_LE(extractor.first_background_work(),
              ForegroundExtractor::first_background_work_max(extractor.view(), kFrame_s * 1.001,
                                                             options.first_background_s) +
                  last_row);
    if (extractor.first_background_work() > 0) {
      ++frames;
      EXPECT_EQ(work == 0, frame == 0);
      EXPECT_TRUE(foreground.blobs.empty());
      EXPECT_FALSE(foreground.background_known);
    }
    known = known || foreground.background_known;
    work += extractor.first_background_work();
  }
  EXPECT_TRUE(known);
  EXPECT_GT(work, room.rays.size());  // every pixel, and those around new leaves
  EXPECT_GE(frames, 10U);
  EXPECT_LE(frames, 75U);
  // The same image gives the same leaves as when they are drawn up at once.
  EXPECT_GE(extractor.background_share(), (*at_once)->background_share() - 0.001);
}

}  // namespace
}  // namespace wagonsight

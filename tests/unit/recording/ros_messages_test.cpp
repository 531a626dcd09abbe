#include "recording/ros_messages.h"

#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <Eigen/Geometry>

#include <rapidcheck/gtest.h>
#include <algorithm>
#include <vector>

namespace wagonsight {
namespace {

RC_GTEST_PROP(FrameInfoMessage, ComesBackAsItWas, ()) {
  FrameInfoMessage info;
  // builtin_interfaces/Time holds 32-bit seconds.
  const auto limit = std::int64_t{2'000'000'000} * 1'000'000'000;
  info.instant = HostTime{Duration{*rc::gen::inRange<std::int64_t>(-limit, limit)}};
  info.arrival = HostTime{Duration{*rc::gen::inRange<std::int64_t>(-limit, limit)}};
  const auto name = *rc::gen::container<std::string>(rc::gen::inRange('a', 'z'));
  info.sensor = name;
  info.device_ticks = *rc::gen::arbitrary<std::uint64_t>();
  info.sequence = *rc::gen::arbitrary<std::uint32_t>();
  info.damaged = *rc::gen::arbitrary<bool>();
  ByteWriter out;
  encode_frame_info(info, out);
  const auto back = decode_frame_info(out.bytes());
  RC_ASSERT(back.has_value());
  RC_ASSERT(back->instant == info.instant);
  RC_ASSERT(back->arrival == info.arrival);
  RC_ASSERT(back->sensor == info.sensor);
  RC_ASSERT(back->device_ticks == info.device_ticks);
  RC_ASSERT(back->sequence == info.sequence);
  RC_ASSERT(back->damaged == info.damaged);
}

RC_GTEST_PROP(VehicleStateMessage, ComesBackAsItWas, ()) {
  VehicleStateMessage state;
  state.stamp = HostTime{Duration{*rc::gen::inRange<std::int64_t>(0, 1'000'000'000'000)}};
  state.has_speed = *rc::gen::arbitrary<bool>();
  state.speed = *rc::gen::inRange(0, 200'000) * 1e-3;
  state.has_stop = *rc::gen::arbitrary<bool>();
  state.stop = *rc::gen::container<std::string>(rc::gen::inRange('a', 'z'));
  const int doors = *rc::gen::inRange(0, 9);
  for (int i = 0; i < doors; ++i)
    state.doors.push_back({*rc::gen::container<std::string>(rc::gen::inRange('a', 'z')),
                           static_cast<std::uint8_t>(i % 3)});
  ByteWriter out;
  encode_vehicle_state(state, out);
  const auto back = decode_vehicle_state(out.bytes());
  RC_ASSERT(back.has_value());
  RC_ASSERT(back->stamp == state.stamp);
  RC_ASSERT(back->has_speed == state.has_speed);
  RC_ASSERT(back->speed == state.speed);
  RC_ASSERT(back->has_stop == state.has_stop);
  RC_ASSERT(back->stop == state.stop);
  RC_ASSERT(back->doors.size() == state.doors.size());
  for (std::size_t i = 0; i < state.doors.size(); ++i) {
    RC_ASSERT(back->doors[i].name == state.doors[i].name);
    RC_ASSERT(back->doors[i].state == state.doors[i].state);
  }
  for (std::size_t size = 0; size < out.size(); ++size)
    RC_ASSERT(!decode_vehicle_state(out.bytes().first(size)).has_value());
}

TEST(CameraInfoMessage, ComesBackAsItWas) {
  CameraInfoMessage info;
  info.frame_id = "k0";
  info.stamp = HostTime{Duration{-1}};
  info.camera = {.width = 640, .height = 480, .fx = 580.5, .fy = 581.25, .cx = 319.5, .cy = 239.5};
  info.camera.distortion = {0.1, -0.2, 0.003, -0.004, 0.05};
  info.baseline = 0.25;
  ByteWriter out;
  encode_camera_info(info, out);
  const auto back = decode_camera_info(out.bytes());
  ASSERT_TRUE(back.has_value());
  EXPECT_EQ(back->stamp, info.stamp);
  EXPECT_EQ(back->frame_id, "k0");
  EXPECT_EQ(back->camera.width, 640);
  EXPECT_EQ(back->camera.height, 480);
  EXPECT_EQ(back->camera.fx, 580.5);
  EXPECT_EQ(back->camera.cy, 239.5);
  EXPECT_EQ(back->camera.distortion, info.camera.distortion);
  EXPECT_EQ(back->baseline, 0.25);
}

// The images of a pair are recorded as they come: K and D are the lens, R and P the rectification.
TEST(CameraInfoMessage, TellsHowAnImagerIsRectified) {
  CameraInfoMessage info;
  info.camera = {.width = 769, .height = 448, .fx = 520, .fy = 521, .cx = 384, .cy = 224};
  info.rectified = {.width = 769, .height = 448, .fx = 519, .fy = 519, .cx = 380, .cy = 225};
  info.R = Eigen::AngleAxisd(0.1, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  info.baseline = 0.08;
  ByteWriter out;
  encode_camera_info(info, out);
  const auto back = decode_camera_info(out.bytes());
  ASSERT_TRUE(back.has_value());
  EXPECT_EQ(back->camera.fy, 521);
  EXPECT_EQ(back->rectified.fx, 519);
  EXPECT_EQ(back->rectified.cx, 380);
  EXPECT_EQ(back->rectified.cy, 225);
  EXPECT_EQ(back->R, info.R);
  EXPECT_NEAR(back->baseline, 0.08, 1e-15);
}

TEST(RosMessages, CutAnywhereAreNothing) {
  ByteWriter out;
  encode_camera_info({.camera = {.width = 4, .height = 4, .fx = 4, .fy = 4, .cx = 2, .cy = 2}},
                     out);
  for (std::size_t size = 0; size < out.size(); ++size)
    EXPECT_FALSE(decode_camera_info(out.bytes().first(size)).has_value()) << size;
}

TEST(ImageMessage, WhosePixelsAreFewerThanItsSizeIsNothing) {
  const std::vector<std::byte> pixels(6);
  const ImageMessage image{.width = 2, .height = 2, .encoding = "16UC1", .step = 4, .data = pixels};
  ByteWriter out;
  encode_image_header(image, out);
  out.raw(pixels);
  EXPECT_FALSE(decode_image(out.bytes()).has_value());
}

}  // namespace
}  // namespace wagonsight

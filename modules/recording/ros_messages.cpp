#include "recording/ros_messages.h"

#include <algorithm>

#include "recording/cdr.h"

namespace wagonsight {
namespace {

// The separator between definitions is 80 equals signs (MCAP registry, ros2msg).
#define WS_SEPARATOR                                     \
  "========================================" /* forty */ \
  "========================================\n"

// What std_msgs/Header brings along, as every message here begins with one.
#define WS_HEADER_TYPES             \
  WS_SEPARATOR                      \
  "MSG: std_msgs/Header\n"          \
  "builtin_interfaces/Time stamp\n" \
  "string frame_id\n" WS_SEPARATOR  \
  "MSG: builtin_interfaces/Time\n"  \
  "int32 sec\n"                     \
  "uint32 nanosec\n"

constexpr std::int64_t kNanosecondsPerSecond = 1'000'000'000;

void append_time(CdrWriter& cdr, HostTime time) {
  const std::int64_t ns = time.time_since_epoch().count();
  std::int64_t seconds = ns / kNanosecondsPerSecond;
  std::int64_t rest = ns % kNanosecondsPerSecond;
  if (rest < 0) {  // builtin_interfaces/Time counts nanoseconds upwards from negative seconds too
    rest += kNanosecondsPerSecond;
    --seconds;
  }
  cdr.number(static_cast<std::int32_t>(seconds));
  cdr.number(static_cast<std::uint32_t>(rest));
}

HostTime read_time(CdrReader& cdr) {
  const std::int64_t seconds = cdr.number<std::int32_t>();
  const std::int64_t rest = cdr.number<std::uint32_t>();
  return HostTime{Duration{seconds * kNanosecondsPerSecond + rest}};
}

void append_header(CdrWriter& cdr, HostTime stamp, std::string_view frame_id) {
  append_time(cdr, stamp);
  cdr.text(frame_id);
}

constexpr std::string_view kPlumbBob = "plumb_bob";  // k1, k2, p1, p2, k3
constexpr std::size_t kCoefficientsMax = 64;         // of any model; above is a damaged message

constexpr std::uint32_t kVehicleDoorsMax = 256;  // above is a damaged message

}  // namespace

const RosSchema& image_schema() {
  static const RosSchema schema{"sensor_msgs/msg/Image",
                                "std_msgs/Header header\n"
                                "uint32 height\n"
                                "uint32 width\n"
                                "string encoding\n"
                                "uint8 is_bigendian\n"
                                "uint32 step\n"
                                "uint8[] data\n" WS_HEADER_TYPES};
  return schema;
}

const RosSchema& camera_info_schema() {
  static const RosSchema schema{"sensor_msgs/msg/CameraInfo",
                                "std_msgs/Header header\n"
                                "uint32 height\n"
                                "uint32 width\n"
                                "string distortion_model\n"
                                "float64[] d\n"
                                "float64[9] k\n"
                                "float64[9] r\n"
                                "float64[12] p\n"
                                "uint32 binning_x\n"
                                "uint32 binning_y\n"
                                "sensor_msgs/RegionOfInterest roi\n" WS_HEADER_TYPES WS_SEPARATOR
                                "MSG: sensor_msgs/RegionOfInterest\n"
                                "uint32 x_offset\n"
                                "uint32 y_offset\n"
                                "uint32 height\n"
                                "uint32 width\n"
                                "bool do_rectify\n"};
  return schema;
}

const RosSchema& frame_info_schema() {
  static const RosSchema schema{"wagonsight_msgs/msg/FrameInfo",
                                "# What is known of a frame beyond its pixels. The stamp is when\n"
                                "# the light was taken; frame_id is the sensor's name.\n"
                                "std_msgs/Header header\n"
                                "builtin_interfaces/Time arrival  # when the host had the frame\n"
                                "uint64 device_ticks              # the device's own clock\n"
                                "uint32 sequence                  # the device's frame counter\n"
                                "bool damaged                     # packets were "
                                "lost\n" WS_HEADER_TYPES};
  return schema;
}

const RosSchema& vehicle_state_schema() {
  static const RosSchema schema{"wagonsight_msgs/msg/VehicleState",
                                "# What the train said of itself when it last changed.\n"
                                "std_msgs/Header header\n"
                                "bool has_speed\n"
                                "float64 speed        # metres a second\n"
                                "bool has_stop\n"
                                "string stop          # where it stands; empty: between stops\n"
                                "string[] door_names\n"
                                "uint8[] door_states  # 0 unknown, 1 closed, "
                                "2 open\n" WS_HEADER_TYPES};
  return schema;
}

void encode_image_header(const ImageMessage& image, ByteWriter& out) {
  CdrWriter cdr(out);
  append_header(cdr, image.stamp, image.frame_id);
  cdr.number(image.height);
  cdr.number(image.width);
  cdr.text(image.encoding);
  cdr.number(static_cast<std::uint8_t>(image.is_big_endian ? 1 : 0));
  cdr.number(image.step);
  cdr.number(static_cast<std::uint32_t>(image.data.size()));
}

std::optional<ImageMessage> decode_image(std::span<const std::byte> message) {
  CdrReader cdr(message);
  ImageMessage image;
  image.stamp = read_time(cdr);
  image.frame_id = cdr.text();
  image.height = cdr.number<std::uint32_t>();
  image.width = cdr.number<std::uint32_t>();
  image.encoding = cdr.text();
  image.is_big_endian = cdr.number<std::uint8_t>() != 0;
  image.step = cdr.number<std::uint32_t>();
  image.data = cdr.raw(cdr.number<std::uint32_t>());
  if (!cdr.ok()) return std::nullopt;
  if (image.data.size() < std::uint64_t{image.step} * image.height) return std::nullopt;
  return image;
}

void encode_camera_info(const CameraInfoMessage& info, ByteWriter& out) {
  const Camera& c = info.camera;
  CdrWriter cdr(out);
  append_header(cdr, info.stamp, info.frame_id);
  cdr.number(static_cast<std::uint32_t>(c.height));
  cdr.number(static_cast<std::uint32_t>(c.width));
  cdr.text(kPlumbBob);
  cdr.number(static_cast<std::uint32_t>(c.distortion.size()));
  for (const double d : c.distortion) cdr.number(d);
  for (const double k : {c.fx, 0.0, c.cx, 0.0, c.fy, c.cy, 0.0, 0.0, 1.0}) cdr.number(k);
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 3; ++column) cdr.number(info.R(row, column));
  const Camera& r = info.rectified.width > 0 ? info.rectified : c;
  for (const double p :
       {r.fx, 0.0, r.cx, -r.fx * info.baseline, 0.0, r.fy, r.cy, 0.0, 0.0, 0.0, 1.0, 0.0})
    cdr.number(p);
  cdr.number(std::uint32_t{0});                              // binning_x
  cdr.number(std::uint32_t{0});                              // binning_y
  for (int i = 0; i < 4; ++i) cdr.number(std::uint32_t{0});  // roi: the whole image
  cdr.number(std::uint8_t{0});                               // roi.do_rectify
}

std::optional<CameraInfoMessage> decode_camera_info(std::span<const std::byte> message) {
  CdrReader cdr(message);
  CameraInfoMessage info;
  info.stamp = read_time(cdr);
  info.frame_id = cdr.text();
  info.camera.height = static_cast<int>(cdr.number<std::uint32_t>());
  info.camera.width = static_cast<int>(cdr.number<std::uint32_t>());
  cdr.text();  // the model: told by its coefficients below
  const auto count = cdr.number<std::uint32_t>();
  if (!cdr.ok() || count > kCoefficientsMax) return std::nullopt;
  for (std::size_t i = 0; i < count; ++i) {
    const double d = cdr.number<double>();
    if (i < info.camera.distortion.size())
      info.camera.distortion[i] = d;
    else if (d != 0.0)
      return std::nullopt;
  }
  std::array<double, 9> k{};
  std::array<double, 9> r{};
  std::array<double, 12> p{};
  for (double& value : k) value = cdr.number<double>();
  for (double& value : r) value = cdr.number<double>();
  for (double& value : p) value = cdr.number<double>();
  constexpr int kBinningAndRoi = 6;
  for (int i = 0; i < kBinningAndRoi; ++i) cdr.number<std::uint32_t>();
  cdr.number<std::uint8_t>();  // roi.do_rectify
  if (!cdr.ok()) return std::nullopt;
  info.camera.fx = k[0];
  info.camera.cx = k[2];
  info.camera.fy = k[4];
  info.camera.cy = k[5];
  info.baseline = p[0] > 0 ? -p[3] / p[0] : 0;
  for (int i = 0; i < 9; ++i) info.R(i / 3, i % 3) = r[static_cast<std::size_t>(i)];
  info.rectified = {info.camera.width, info.camera.height, p[0], p[5], p[2], p[6], {}};
  return info;
}

void encode_frame_info(const FrameInfoMessage& info, ByteWriter& out) {
  CdrWriter cdr(out);
  append_header(cdr, info.instant, info.sensor);
  append_time(cdr, info.arrival);
  cdr.number(info.device_ticks);
  cdr.number(info.sequence);
  cdr.number(static_cast<std::uint8_t>(info.damaged ? 1 : 0));
}

std::optional<FrameInfoMessage> decode_frame_info(std::span<const std::byte> message) {
  CdrReader cdr(message);
  FrameInfoMessage info;
  info.instant = read_time(cdr);
  info.sensor = cdr.text();
  info.arrival = read_time(cdr);
  info.device_ticks = cdr.number<std::uint64_t>();
  info.sequence = cdr.number<std::uint32_t>();
  info.damaged = cdr.number<std::uint8_t>() != 0;
  if (!cdr.ok()) return std::nullopt;
  return info;
}

void encode_vehicle_state(const VehicleStateMessage& state, ByteWriter& out) {
  CdrWriter cdr(out);
  append_header(cdr, state.stamp, "vehicle");
  cdr.number(static_cast<std::uint8_t>(state.has_speed ? 1 : 0));
  cdr.number(state.speed);
  cdr.number(static_cast<std::uint8_t>(state.has_stop ? 1 : 0));
  cdr.text(state.stop);
  cdr.number(static_cast<std::uint32_t>(state.doors.size()));
  for (const auto& door : state.doors) cdr.text(door.name);
  cdr.number(static_cast<std::uint32_t>(state.doors.size()));
  for (const auto& door : state.doors) cdr.number(door.state);
}

std::optional<VehicleStateMessage> decode_vehicle_state(std::span<const std::byte> message) {
  CdrReader cdr(message);
  VehicleStateMessage state;
  state.stamp = read_time(cdr);
  cdr.text();
  state.has_speed = cdr.number<std::uint8_t>() != 0;
  state.speed = cdr.number<double>();
  state.has_stop = cdr.number<std::uint8_t>() != 0;
  state.stop = cdr.text();
  const auto names = cdr.number<std::uint32_t>();
  if (!cdr.ok() || names > kVehicleDoorsMax) return std::nullopt;
  state.doors.resize(names);
  for (auto& door : state.doors) door.name = cdr.text();
  if (cdr.number<std::uint32_t>() != names) return std::nullopt;
  for (auto& door : state.doors) door.state = cdr.number<std::uint8_t>();
  if (!cdr.ok()) return std::nullopt;
  return state;
}

}  // namespace wagonsight

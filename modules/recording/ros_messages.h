#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/time.h"
#include "geometry/camera.h"
#include "recording/little_endian.h"

// The ROS 2 messages a recording is made of, in CDR (OMG DDS-RTPS 2.5, section 10: little-endian,
// a 4-byte encapsulation header, primitives aligned to their size counted from behind it).
// Encoders append one whole message to `out`; decoders give views into the bytes, or nothing where
// the bytes are not such a message.
namespace wagonsight {

struct RosSchema {
  std::string_view name;  // package/msg/Type
  std::string_view text;  // ros2msg: the definition and those of all types it uses
};

const RosSchema& image_schema();
const RosSchema& camera_info_schema();
const RosSchema& frame_info_schema();
const RosSchema& vehicle_state_schema();

// sensor_msgs/msg/Image. `data` is encoded apart: it follows the encoded header directly.
struct ImageMessage {
  HostTime stamp{};  // when the light was taken
  std::string_view frame_id{};
  std::uint32_t width = 0, height = 0;
  std::string_view encoding{};  // 16UC1, mono8, mono16, rgb8
  bool is_big_endian = false;
  std::uint32_t step = 0;  // bytes a row
  std::span<const std::byte> data{};
};

// All of the message but the pixels themselves.
void encode_image_header(const ImageMessage& image, ByteWriter& out);
std::optional<ImageMessage> decode_image(std::span<const std::byte> message);

// sensor_msgs/msg/CameraInfo with the model plumb_bob. K and D are of the image as it is, R turns
// it onto the rectified plane, P is the camera there: `rectified`, or `camera` itself where that
// has no width. For the right imager of a pair `baseline` (metres) is positive and P[3] = -fx *
// baseline.
struct CameraInfoMessage {
  HostTime stamp{};
  std::string_view frame_id{};
  Camera camera{};
  double baseline = 0;
  Camera rectified{};
  Eigen::Matrix3d R = Eigen::Matrix3d::Identity();
};

void encode_camera_info(const CameraInfoMessage& info, ByteWriter& out);
// Models with more than five coefficients whose further ones are not zero are nothing.
std::optional<CameraInfoMessage> decode_camera_info(std::span<const std::byte> message);

// wagonsight_msgs/msg/FrameInfo: what a FrameSlot knows beyond its pixels.
struct FrameInfoMessage {
  HostTime instant{};
  std::string_view sensor{};
  HostTime arrival{};
  std::uint64_t device_ticks = 0;
  std::uint32_t sequence = 0;
  bool damaged = false;
};

// wagonsight_msgs/msg/VehicleState: what the train said of itself.
struct VehicleStateMessage {
  static constexpr std::uint8_t kUnknown = 0, kClosed = 1, kOpen = 2;
  struct Door {
    std::string name;
    std::uint8_t state = kUnknown;
  };
  HostTime stamp{};
  bool has_speed = false;
  double speed = 0;  // m/s
  bool has_stop = false;
  std::string stop;  // where it stands; empty: between stops
  std::vector<Door> doors;
};

void encode_vehicle_state(const VehicleStateMessage& state, ByteWriter& out);
std::optional<VehicleStateMessage> decode_vehicle_state(std::span<const std::byte> message);

void encode_frame_info(const FrameInfoMessage& info, ByteWriter& out);
std::optional<FrameInfoMessage> decode_frame_info(std::span<const std::byte> message);

}  // namespace wagonsight

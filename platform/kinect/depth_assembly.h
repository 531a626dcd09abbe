#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

namespace wagonsight {

inline constexpr int kKinectWidth = 640, kKinectHeight = 480;
inline constexpr std::size_t kKinectPixels = std::size_t{kKinectWidth} * kKinectHeight;

// What a Kinect says of its own optics (its zero plane), in its own units.
struct KinectOptics {
  double emitter_distance_cm = 0;    // from the depth camera to the projector
  double reference_distance_cm = 0;  // of the plane that its pattern was learned from
  double reference_pixel_cm = 0;     // a pixel's size on the sensor, seen at that plane
  double shift = 0;                  // its constant offset, pixels
};

// Millimetres for each of the 2048 raw disparities, 0 where there is none: no reading (2047),
// behind the sensor, or beyond 10 m, where one step is decimetres.
//
//     p = (raw - 4 shift) / 4 - 3/8  pixels,   s = p pixel,   Z = s d / (e - s) + d
//
// (Khoshelham and Elberink, Sensors 12, 2012, eq. 4, with reference distance d and emitter distance
// e.) Rounded down, as libfreenect does.
using DepthTable = std::array<std::uint16_t, 2048>;
// False when no Kinect has such optics (the reply was damaged); the table is then all 0.
bool make_depth_table(const KinectOptics& optics, DepthTable& table);

// Puts the packets of a depth frame together and knows whether it is whole: libfreenect hands out a
// frame with holes as if it were a good one. One thread; allocates when made.
class DepthAssembly {
 public:
  static constexpr int kPacketBytes = 1748;
  static constexpr std::size_t kFrameBytes = kKinectPixels * 11 / 8;
  static constexpr int kPackets =
      static_cast<int>((kFrameBytes + kPacketBytes - 1) / kPacketBytes);  // 242

  DepthAssembly() : packed_(std::make_unique<std::byte[]>(kFrameBytes)) {}

  // Packet `number` of its frame. A number that does not grow begins the next frame.
  void add(int number, std::span<const std::byte> payload);

  // libfreenect says that a frame is complete: after its last packet, or, when that was lost, after
  // the next frame's first. True when every packet of it came, and in full length.
  bool finish();

  // The frame that finish() called whole, in millimetres. `out` has kKinectPixels.
  void convert(const DepthTable& table, std::span<std::uint16_t> out) const;

 private:
  std::unique_ptr<std::byte[]> packed_;
  int last_number_ = kPackets;
  int good_ = 0;
};

}  // namespace wagonsight

#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "usb_device.h"

namespace wagonsight::device {

// What can be wrong with a Kinect or its cable; changed by scripts while it runs. Shares are of its
// depth packets, chosen by the number of the microframe, so that every run has the same.
struct KinectFaults {
  double lost = 0;       // never on the wire
  double truncated = 0;  // cut short
  double garbage = 0;    // bytes that mean nothing where the header should be
  double corrupted = 0;  // full length, wrong bytes; the controller reports the checksum
  bool silent = false;   // answers, but sends no packet, until it is reset
  bool wedged = false;   // answers nothing and sends no packet, until it is reset
  bool wedge_outlives_reset = false;  // until its power is cut
  int stalled_requests = 0;           // so many of the next are refused
  bool empty_replies = false;         // of no bytes, for ever
  bool foreign_replies = false;       // to another request than the one that was made
  bool wrong_configuration = false;   // its descriptors say that it has no camera endpoints
};

// A Kinect for Xbox 360 (1414), camera part, as seen from the wire.
class KinectUnit final : public UsbDevice {
 public:
  static constexpr int kWidth = 640, kHeight = 480, kPixels = kWidth * kHeight;
  static constexpr std::uint16_t kNoReading = 2047;

  // Raw disparities, 11 bits each, of the unit's frame `number`, whose light was taken at `light`.
  using DepthFeed =
      std::function<void(std::uint32_t number, Nanoseconds light, std::span<std::uint16_t> raw)>;
  // What the camera says of its optics; the real ones differ a little from each other.
  struct Optics {
    float emitter_distance_cm = 7.5F, color_distance_cm = 2.3F;
    float reference_distance_cm = 120.0F, reference_pixel_cm = 0.1042F;
    std::uint16_t shift = 200;
  };
  struct Options {
    std::string serial;
    DepthFeed feed;
    // The feed repeats itself after so many frames, and each picture is asked for once; 0: never.
    std::uint32_t repeats_after = 0;
    double drift_ppm = 0;    // of its quartz: positive runs fast
    Nanoseconds phase = 0;   // of its frames against those of a unit without
    Nanoseconds jitter = 0;  // at most so much later is the host told
    std::uint32_t first_ticks = 0;
    std::uint16_t version = 0x010b;
    int speed_mbit = 480;
    Optics optics;
  };
  explicit KinectUnit(Options options);

  KinectFaults faults;
  // The clock that its timestamps tell jumps by so many seconds.
  void jump_clock(double seconds) { jumped_s_ += seconds; }

  // When the light of a frame was taken: as its first packet leaves.
  Nanoseconds light_of(std::uint32_t number) const;
  // The frame whose last packet has this timestamp, unwrapped or not, when the clock never jumped
  // and the frame is less than a minute old.
  std::uint32_t frame_of_ticks(std::uint64_t ticks, Nanoseconds now) const;
  // Millimetres of a raw disparity by the camera's own formula; 0: no reading.
  std::uint16_t millimetres(std::uint16_t raw) const;

  struct Sent {
    std::uint32_t number = 0;
    bool whole = false;  // every packet was fetched as it was meant
  };
  // Of each frame that began on the wire, in order. With VirtualTime's mutex, or when all is still.
  const std::vector<Sent>& sent() const { return sent_; }
  bool streams() const { return running_; }

  Identity identity() const override;
  std::vector<std::uint8_t> descriptors() const override;
  int control(const Setup& setup, std::span<std::uint8_t> data) override;
  IsoPacket isochronous(std::uint8_t endpoint, std::int64_t microframe,
                        std::span<std::uint8_t> out) override;
  Nanoseconds lateness(std::int64_t microframe) override;
  void reset() override;
  void power_cycle() override;

 private:
  std::int64_t first_microframe(std::uint32_t number) const;
  std::uint32_t frame_at(std::int64_t microframe) const;
  std::uint32_t ticks_at(std::int64_t microframe) const;
  int take_command(std::span<const std::uint8_t> message);
  int give_reply(std::span<std::uint8_t> out);
  int string_descriptor(int index, std::span<std::uint8_t> out) const;
  void write_register(unsigned number, unsigned value);
  const std::vector<std::uint8_t>& packed(std::uint32_t number);
  IsoPacket damage(std::int64_t microframe, IsoPacket packet, std::span<std::uint8_t> out);

  Options options_;
  std::array<std::uint16_t, 0x400> registers_{};
  std::vector<std::uint8_t> reply_;
  bool running_ = false;
  bool in_frame_ = false;  // begins with a frame's first packet
  double jumped_s_ = 0;
  std::vector<std::uint16_t> raw_;
  struct Picture {
    std::int64_t number = -1;  // of the frame that it was packed for
    std::vector<std::uint8_t> packed;
  };
  std::vector<Picture> pictures_;
  std::vector<Sent> sent_;
  int good_packets_ = 0;
};

// A picture in which every pixel differs between frames and units, so that nothing wrong can look
// right. The first pixels tell the frame and the unit.
void paint_test_pattern(unsigned unit, std::uint32_t number, std::span<std::uint16_t> raw);

}  // namespace wagonsight::device

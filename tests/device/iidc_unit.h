#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <span>
#include <vector>

#include "fire_bus.h"

namespace wagonsight::device {

// What can be wrong with a camera or its cable; changed by scripts while it runs. Shares are of
// its packets, chosen by the number of the cycle, so that every run has the same.
struct IidcFaults {
  double lost = 0;                 // never at the host
  double truncated = 0;            // cut short
  double garbage = 0;              // bytes, length and mark of begin that mean nothing
  bool silent = false;             // answers, but sends no packet, until it is initialised
  bool wedged = false;             // answers nothing and sends nothing, until a bus reset
  int busy_requests = 0;           // so many of the next are answered "busy"
  int refused_requests = 0;        // so many of the next are answered "address error"
  bool endless_handshake = false;  // Format7 settings are never taken
  bool wrong_packet_size = false;  // sends packets of another size than was set
};

// An IIDC camera with two imagers whose images it stacks, left above right: Format7, 16 bits a
// pixel, most significant byte first, of which 12 are used; as seen from the wire. IIDC 1.31.
class IidcUnit final : public FireDevice {
 public:
  static constexpr int kWidth = 769, kHeight = 448;  // of one imager
  static constexpr std::size_t kPixels = std::size_t{kWidth} * kHeight * 2;
  static constexpr std::size_t kBytes = kPixels * 2;

  // How an image is taken.
  struct Taken {
    std::uint32_t number = 0;
    Nanoseconds light = 0;  // the middle of the exposure
    Nanoseconds exposure = 0;
    double gain_db = 0;
  };
  // Its gray values of 12 bits, left image, then right one.
  using Feed = std::function<void(const Taken& taken, std::span<std::uint16_t> gray)>;
  enum class Rom { kRight, kNoCamera, kEmptyLeaf, kBeyondItsEnd };
  struct Options {
    std::uint64_t guid = 0;
    Feed feed;
    double rate_hz = 14;              // at most, when it runs freely
    double drift_ppm = 0;             // of that rate against the host's clock
    Nanoseconds phase = 0;            // of its frames
    Nanoseconds readout = 1'000'000;  // from the exposure's end to the first packet
    int packet_bytes_max = 4096;
    bool has_counter = true;   // in the first four bytes of an image, when asked for
    bool has_absolute = true;  // shutter and gain in seconds and decibels
    Rom rom = Rom::kRight;
  };
  explicit IidcUnit(Options options);

  IidcFaults faults;
  // A pulse at its trigger input, now. With VirtualTime's mutex.
  void pulse();
  void power_cycle();

  struct Sent {
    std::uint32_t number = 0;
    std::int64_t first_cycle = 0;
    Nanoseconds light = 0;  // the middle of the exposure
    Nanoseconds exposure = 0;
    bool whole = false;  // every packet reached the host as it was meant
    int good_packets = 0;
  };
  // Of each frame that began on the wire, in order. With VirtualTime's mutex, or when all is still.
  const std::vector<Sent>& sent() const { return sent_; }
  // The frame whose first packet came at these ticks of the bus (24.576 MHz); nullptr: none.
  const Sent* frame_of_ticks(std::uint64_t ticks) const;
  bool counts_frames() const;
  std::uint64_t triggers_missed() const { return triggers_missed_; }
  double shutter_s() const { return shutter_s_; }
  double gain_db() const { return gain_db_; }
  int packet_bytes() const { return packet_bytes_; }

  std::vector<std::uint32_t> config_rom() const override;
  int read(std::uint64_t offset, std::uint32_t& quadlet) override;
  int write(std::uint64_t offset, std::uint32_t quadlet) override;
  std::int64_t next_packet(std::int64_t cycle) override;
  Packet isochronous(std::int64_t cycle, std::span<std::uint8_t> out) override;
  void bus_was_reset() override;

 private:
  struct Planned {
    Taken taken;
    std::int64_t first_cycle = 0;
  };
  void initialise();
  bool sends() const;
  bool is_triggered() const;
  int packets() const;
  void plan_free_frames(std::int64_t cycle);
  void plan(std::int64_t first_cycle, Nanoseconds exposure_begin);
  void write_format7(std::uint64_t offset, std::uint32_t value);
  void write_register(std::uint64_t offset, std::uint32_t value);
  void render(const Planned& frame);
  Packet damage(std::int64_t cycle, Packet packet, std::span<std::uint8_t> out);

  Options options_;
  std::array<std::uint32_t, 0x500> registers_{};  // 0x000 to 0x13ff
  std::array<std::uint32_t, 0x40> format7_{};
  double shutter_s_ = 0.002, gain_db_ = 0;
  int packet_bytes_ = 4096;
  std::deque<Planned> planned_;
  std::int64_t last_first_cycle_ = 0;
  std::uint32_t next_number_ = 0;
  std::uint64_t triggers_missed_ = 0;
  std::vector<Sent> sent_;
  std::int64_t rendered_ = -1;
  std::vector<std::uint16_t> gray_;
  std::vector<std::uint8_t> wire_;
};

// A picture in which every pixel differs between frames and units.
void paint_stereo_pattern(unsigned unit, std::uint32_t number, std::span<std::uint16_t> gray);

}  // namespace wagonsight::device

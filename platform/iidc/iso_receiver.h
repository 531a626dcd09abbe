#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>

#include "base/time.h"
#include "iidc/pair_assembly.h"

namespace wagonsight {

class IsoListener {
 public:
  virtual ~IsoListener() = default;
  // From within IsoReceiver::wait() and flush(); the payload is valid during the call.
  virtual void packet(const IsoPacket& packet) = 0;
};

// Receives the packets of one isochronous channel from /dev/fw*, each with its header: libdc1394's
// own capture throws these away and cannot tell a damaged image. Reserves channel and bandwidth;
// the kernel renews both after a bus reset and gives them back when this is stopped.
//
// Packets go round a ring of an eighth of a second. One thread; start() allocates.
class IsoReceiver {
 public:
  IsoReceiver() = default;
  ~IsoReceiver() { stop(); }
  IsoReceiver(const IsoReceiver&) = delete;
  IsoReceiver& operator=(const IsoReceiver&) = delete;

  // What is wrong in a sentence that lives for ever, or nothing.
  using Trouble = const char*;

  // Opens the node's file and begins to receive; channel() is then what the camera is to send on.
  Trouble start(const std::string& path, int packet_bytes, int bandwidth_units);
  void stop();
  int channel() const { return channel_; }

  // Hands on what came; waits for it at most so long. Why the stream ended, or nothing.
  Trouble wait(Duration timeout, IsoListener& listener);
  // Hands on also what came since the controller last told, which it does every 8 ms of packets.
  Trouble flush(IsoListener& listener);

  struct Clocks {
    bool are_known = false;
    std::uint32_t timer = 0;  // of the bus
    HostTime host{};
  };
  // Both clocks at one instant.
  Clocks read_clocks() const;

 private:
  static constexpr std::size_t kPacketsOfEntry = 8, kEntries = 128, kEntriesOfInterrupt = 8;
  static constexpr std::size_t kPackets = kPacketsOfEntry * kEntries;

  Trouble reserve(int bandwidth_units);
  Trouble begin();
  bool queue(std::size_t first_entry, std::size_t count);
  Trouble read_event(IsoListener& listener);
  bool take_headers(const std::byte* headers, std::size_t bytes, IsoListener& listener);

  int fd_ = -1;
  int channel_ = -1;
  std::size_t packet_bytes_ = 0;
  std::byte* memory_ = nullptr;
  std::size_t memory_bytes_ = 0;
  std::size_t next_packet_ = 0;                     // in the ring
  alignas(8) std::array<std::byte, 8192> event_{};  // the kernel's are 4 KB at most
};

}  // namespace wagonsight

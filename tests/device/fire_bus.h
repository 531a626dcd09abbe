#pragma once

#include <cstdint>
#include <limits>
#include <map>
#include <memory>
#include <span>
#include <vector>

#include "kernel_seam.h"

// IEEE 1394 as the kernel shows it: /dev/fw0, /dev/fw1 ... with the ioctls of
// linux/firewire-cdev.h that libdc1394 and the driver use. Each bus has its controller (a node of
// its own, as in life), a clock of cycles of 125 us that drifts against the host's, and bandwidth
// that runs out. A packet for which no buffer is queued is lost, as with the real controllers.
namespace wagonsight::device {

constexpr Nanoseconds kCycle = 125'000;
constexpr std::int64_t kNoCycle = std::numeric_limits<std::int64_t>::max();

// The clock of a bus against the host's.
struct FireClock {
  double drift_ppm = 0;          // positive runs fast
  Nanoseconds at_host_zero = 0;  // what it showed then

  std::int64_t cycle_at(Nanoseconds host) const;
  Nanoseconds time_at(Nanoseconds host) const;          // of the bus, since its zero
  Nanoseconds host_at_cycle(std::int64_t cycle) const;  // when that cycle has begun
};

// A device's end of the cable. Called with VirtualTime's mutex held.
class FireDevice {
 public:
  virtual ~FireDevice() = default;
  virtual std::vector<std::uint32_t> config_rom() const = 0;
  // An rcode of linux/firewire-constants.h, or kNoAnswer: the kernel gives up after two seconds.
  static constexpr int kNoAnswer = -1;
  // `offset` is from the begin of the registers, 0xfffff0000000.
  virtual int read(std::uint64_t offset, std::uint32_t& quadlet) = 0;
  virtual int write(std::uint64_t offset, std::uint32_t quadlet) = 0;
  // The first cycle from `cycle` on in which it sends; kNoCycle: none is foreseen.
  virtual std::int64_t next_packet(std::int64_t cycle) = 0;
  struct Packet {
    int channel = -1;  // -1: it got lost
    int length = 0;    // as its header says
    unsigned sy = 0;
  };
  // What it sends in that cycle, into `out`; an empty `out` is a host without a buffer for it.
  virtual Packet isochronous(std::int64_t cycle, std::span<std::uint8_t> out) = 0;
  virtual void bus_was_reset() {}
  void connect(const FireClock* clock) { clock_ = clock; }

 protected:
  const FireClock& clock() const { return *clock_; }

 private:
  const FireClock* clock_ = nullptr;
};

class FireFile;

class FireBuses {
 public:
  static FireBuses& instance();

  // The clock of a bus; before its first device is plugged in.
  void set_clock(int bus, const FireClock& clock);
  // The device appears under a new name. Both make a bus reset, which costs two cycles of
  // everybody's packets on that bus.
  void plug(std::shared_ptr<FireDevice> device, int bus);
  void unplug(const FireDevice& device);
  void plug_locked(std::shared_ptr<FireDevice> device, int bus);
  void unplug_locked(const FireDevice& device);
  void unplug_everything();
  // Until then the host hears nothing of what the controller of this bus has done.
  void hold_interrupts(int bus, Nanoseconds until) { buses_[bus].interrupts_held_until = until; }
  // How late the host is told at most.
  void set_jitter(int bus, Nanoseconds jitter) { buses_[bus].jitter = jitter; }

  // ---- for the files
  struct Bus {
    FireClock clock;
    std::uint32_t generation = 1;
    int bandwidth_left = 4915;  // units, of an otherwise empty bus
    std::uint64_t channels_used = 0;
    std::int64_t quiet_until = 0;  // cycle
    Nanoseconds interrupts_held_until = 0, jitter = 0;
    std::uint64_t resets = 0;
  };
  struct Node {
    std::shared_ptr<FireDevice> device;  // none: the controller itself
    int bus = 0, number = 0;             // /dev/fw<number>
    bool present = true;
    std::uint32_t node_id = 0;
  };
  Bus& bus(int number) { return buses_[number]; }
  const std::vector<std::shared_ptr<Node>>& nodes() const { return nodes_; }
  void reset_bus(int number);
  void add_file(FireFile* file) { files_.push_back(file); }
  void remove_file(FireFile* file) { std::erase(files_, file); }
  // Everything up to now has happened, before something changes.
  void catch_up(int bus);

 private:
  FireBuses();
  Opened open_node(const std::string& path);
  std::shared_ptr<Node> add_node(std::shared_ptr<FireDevice> device, int bus);

  std::map<int, Bus> buses_;
  std::vector<std::shared_ptr<Node>> nodes_;
  std::vector<FireFile*> files_;
  int next_number_ = 0;
};

}  // namespace wagonsight::device

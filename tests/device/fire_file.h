#pragma once

#include <deque>
#include <memory>
#include <vector>

#include "fire_bus.h"

struct fw_cdev_allocate_iso_resource;
struct fw_cdev_get_info;
struct fw_cdev_queue_iso;
struct fw_cdev_send_request;

namespace wagonsight::device {

// An open /dev/fw*: transactions, bus resets and one context of isochronous reception. What the
// controller does by itself is caught up with whenever somebody looks.
class FireFile final : public EmulatedFile {
 public:
  explicit FireFile(std::shared_ptr<FireBuses::Node> node);
  ~FireFile() override;
  FireFile(const FireFile&) = delete;
  FireFile& operator=(const FireFile&) = delete;

  int ioctl(unsigned long request, void* argument) override;
  short events() override;
  Nanoseconds next_change() override;
  ssize_t read(void* buffer, std::size_t bytes) override;
  void* map(std::size_t bytes) override;

  const FireBuses::Node& node() const { return *node_; }
  void tell_bus_reset();
  // Receives the packets of all cycles that have passed.
  void receive_until_now();

 private:
  struct Event {
    Nanoseconds when = 0;
    std::vector<std::uint8_t> bytes;
  };
  struct Buffer {  // for one packet
    std::uint8_t* data = nullptr;
    int length = 0;
    bool interrupts = false;
  };
  struct Resource {
    std::uint32_t handle = 0;
    int channel = -1;
    int bandwidth = 0;
    std::uint64_t closure = 0;
  };
  FireBuses::Bus& bus() const { return FireBuses::instance().bus(node_->bus); }

  template <class T>
  void tell(const T& event, Nanoseconds when, std::span<const std::uint32_t> rest = {});
  int get_info(fw_cdev_get_info& info);
  int send_request(const fw_cdev_send_request& request);
  int send_broadcast(const fw_cdev_send_request& request);
  void respond(std::uint64_t closure, int rcode, std::span<const std::uint32_t> data);
  int allocate(fw_cdev_allocate_iso_resource& wanted);
  int deallocate(std::uint32_t handle);
  int queue(fw_cdev_queue_iso& wanted);
  int get_cycle_timer(bool is_second, void* argument);
  void receive(std::int64_t cycle);
  void tell_received(std::int64_t cycle, Nanoseconds when);

  std::shared_ptr<FireBuses::Node> node_;
  std::deque<Event> events_;
  std::vector<Resource> resources_;
  std::uint64_t reset_closure_ = 0;

  bool has_context_ = false, runs_ = false;
  int channel_ = -1;
  std::uint32_t header_bytes_ = 0;
  std::uint64_t context_closure_ = 0;
  std::deque<Buffer> buffers_;
  std::vector<std::uint32_t> headers_;  // of the packets that nobody was told of
  std::int64_t next_cycle_ = 0;
  Nanoseconds last_told_ = 0;
};

}  // namespace wagonsight::device

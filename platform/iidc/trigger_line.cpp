#include "iidc/trigger_line.h"

#include <dc1394/dc1394.h>

#include <algorithm>
#include <thread>

#include "iidc/fire_nodes.h"
#include "linux/clocks.h"
#include "linux/sealed_heap.h"

namespace wagonsight {
namespace {

constexpr Duration kLookEvery = std::chrono::seconds(1);

}  // namespace

// One camera by which a bus is reached.
class TriggerLine::Bus {
 public:
  Bus(std::uint32_t card, std::uint64_t guid) : card_(card), library_(dc1394_new()) {
    camera_ = library_ == nullptr ? nullptr : dc1394_camera_new(library_, guid);
    is_open_ = camera_ != nullptr && dc1394_camera_set_broadcast(camera_, DC1394_TRUE) == 0;
  }
  ~Bus() {
    if (camera_ != nullptr) dc1394_camera_free(camera_);
    if (library_ != nullptr) dc1394_free(library_);
  }
  Bus(const Bus&) = delete;
  Bus& operator=(const Bus&) = delete;

  std::uint32_t card() const { return card_; }
  bool is_open() const { return is_open_; }
  bool fire() {
    is_open_ = is_open_ && dc1394_software_trigger_set_power(camera_, DC1394_ON) == 0;
    return is_open_;
  }

 private:
  std::uint32_t card_;
  dc1394_t* library_;
  dc1394camera_t* camera_ = nullptr;
  bool is_open_ = false;
};

TriggerLine::TriggerLine(TriggerLineOptions options)
    : options_(std::move(options)), plan_(options_.plan) {}
TriggerLine::~TriggerLine() = default;

void TriggerLine::poll(Duration timeout) {
  const HostTime now = host_now();
  if (now >= next_look_) {
    const HeapExemption exempt;
    open_missing(now);
  }
  if (const std::int64_t tick = tick_.load(); tick != tick_seen_) {
    tick_seen_ = tick;
    plan_.observe(HostTime(Duration(tick)));
  }
  const HostTime pulse = plan_.next(host_now());
  const Duration left = pulse - host_now();
  if (left > timeout) {
    std::this_thread::sleep_for(timeout);
    return;
  }
  if (left > Duration::zero()) std::this_thread::sleep_for(left);
  fire();
  plan_.fired(pulse);
}

void TriggerLine::fire() {
  for (const auto& bus : buses_) {
    if (!bus->is_open()) continue;
    if (bus->fire()) {
      ++counters_.pulses;
    } else {
      ++counters_.failed;
      next_look_ = {};
    }
  }
}

void TriggerLine::open_missing(HostTime now) {
  next_look_ = now + kLookEvery;
  std::erase_if(buses_, [](const auto& bus) { return !bus->is_open(); });
  const FireNodes nodes = find_fire_nodes();
  if (nodes.some_malformed) return;  // libdc1394 must not look at them
  for (const std::uint64_t guid : options_.guids) {
    const FireNode* const node = nodes.find(guid);
    const bool is_reached =
        node != nullptr && std::any_of(buses_.begin(), buses_.end(),
                                       [&](const auto& bus) { return bus->card() == node->card; });
    if (node == nullptr || is_reached) continue;
    auto bus = std::make_unique<Bus>(node->card, guid);
    if (!bus->is_open()) continue;
    ++counters_.opened;
    buses_.push_back(std::move(bus));
  }
}

}  // namespace wagonsight

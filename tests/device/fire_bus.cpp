#include "fire_bus.h"

#include <algorithm>
#include <cerrno>
#include <cmath>

#include "fire_file.h"

namespace wagonsight::device {
namespace {

constexpr int kCyclesOfReset = 2;

}  // namespace

// ---- time

Nanoseconds FireClock::time_at(Nanoseconds host) const {
  return at_host_zero + host + std::llround(static_cast<double>(host) * drift_ppm * 1e-6);
}

std::int64_t FireClock::cycle_at(Nanoseconds host) const {
  return time_at(host) / kCycle;
}

Nanoseconds FireClock::host_at_cycle(std::int64_t cycle) const {
  const double since = static_cast<double>(cycle * kCycle - at_host_zero);
  auto host = static_cast<Nanoseconds>(since / (1.0 + drift_ppm * 1e-6)) - 1;
  while (cycle_at(host) < cycle) ++host;
  return host;
}

// ---- the buses

FireBuses& FireBuses::instance() {
  static auto* buses = new FireBuses;
  return *buses;
}

FireBuses::FireBuses() {
  serve_paths("/dev/fw", [this](const std::string& path) { return open_node(path); });
  serve_folder("/dev", [this] {
    std::vector<std::string> names;
    for (const auto& node : nodes_) names.push_back("fw" + std::to_string(node->number));
    return names;
  });
}

void FireBuses::set_clock(int bus, const FireClock& clock) {
  const std::lock_guard hold(VirtualTime::instance().mutex());
  buses_[bus].clock = clock;
}

void FireBuses::plug(std::shared_ptr<FireDevice> device, int bus) {
  const std::lock_guard hold(VirtualTime::instance().mutex());
  plug_locked(std::move(device), bus);
}
void FireBuses::unplug(const FireDevice& device) {
  const std::lock_guard hold(VirtualTime::instance().mutex());
  unplug_locked(device);
}

std::shared_ptr<FireBuses::Node> FireBuses::add_node(std::shared_ptr<FireDevice> device, int bus) {
  auto node = std::make_shared<Node>();
  node->device = std::move(device);
  node->bus = bus;
  node->number = next_number_++;
  node->node_id = 0xffc0U | static_cast<std::uint32_t>(node->number % 63);
  nodes_.push_back(node);
  return node;
}

void FireBuses::plug_locked(std::shared_ptr<FireDevice> device, int bus) {
  const bool is_new = std::none_of(nodes_.begin(), nodes_.end(),
                                   [&](const auto& node) { return node->bus == bus; });
  if (is_new) add_node(nullptr, bus);
  device->connect(&buses_[bus].clock);
  add_node(std::move(device), bus);
  reset_bus(bus);
}

void FireBuses::unplug_locked(const FireDevice& device) {
  const auto found = std::find_if(nodes_.begin(), nodes_.end(),
                                  [&](const auto& node) { return node->device.get() == &device; });
  if (found == nodes_.end()) return;
  const int bus = (*found)->bus;
  catch_up(bus);
  (*found)->present = false;
  nodes_.erase(found);
  reset_bus(bus);
}

void FireBuses::unplug_everything() {
  const std::lock_guard hold(VirtualTime::instance().mutex());
  for (const auto& node : nodes_) node->present = false;
  nodes_.clear();
  buses_.clear();
  VirtualTime::instance().something_changed();
}

void FireBuses::catch_up(int bus) {
  for (FireFile* file : files_)
    if (file->node().bus == bus) file->receive_until_now();
}

void FireBuses::reset_bus(int number) {
  catch_up(number);
  Bus& bus = buses_[number];
  ++bus.generation;
  ++bus.resets;
  bus.quiet_until = bus.clock.cycle_at(VirtualTime::instance().now()) + 1 + kCyclesOfReset;
  for (const auto& node : nodes_)
    if (node->bus == number && node->device) node->device->bus_was_reset();
  for (FireFile* file : files_)
    if (file->node().bus == number) file->tell_bus_reset();
  VirtualTime::instance().something_changed();
}

Opened FireBuses::open_node(const std::string& path) {
  for (const auto& node : nodes_)
    if (path == "/dev/fw" + std::to_string(node->number))
      return {std::make_shared<FireFile>(node), nullptr, 0};
  return {nullptr, nullptr, -ENOENT};
}

}  // namespace wagonsight::device

#include "iidc_bench.h"

#include <algorithm>
#include <array>
#include <cstdio>

namespace wagonsight::device {
namespace {

constexpr std::uint64_t kFirstGuid = 0x00b09d0100a00000;

std::string guid_text(std::uint64_t guid) {
  std::array<char, 20> text{};
  std::snprintf(text.data(), text.size(), "0x%016llx", static_cast<unsigned long long>(guid));
  return text.data();
}

}  // namespace

IidcBench::IidcBench(std::size_t count, const Change& change)
    : DeviceBench(4 * count + 4, IidcUnit::kBytes), gray_(IidcUnit::kPixels) {
  std::vector<IidcOptions> wanted;
  for (std::size_t i = 0; i < count; ++i) {
    IidcUnit::Options options;
    options.guid = kFirstGuid + i;
    options.feed = [i](const IidcUnit::Taken& taken, std::span<std::uint16_t> gray) {
      paint_stereo_pattern(static_cast<unsigned>(i), taken.number, gray);
    };
    options.drift_ppm = 20.0 * static_cast<double>(i) - 50.0;
    options.phase = static_cast<Nanoseconds>(i) * 9'100'000;
    IidcOptions sensor;
    sensor.name = "s" + std::to_string(i);
    sensor.device = guid_text(options.guid);
    sensor.sensor_index = static_cast<std::uint8_t>(i);
    sensor.readout = std::chrono::nanoseconds(options.readout);
    if (change) change(i, options, sensor);
    units_.push_back(std::make_shared<IidcUnit>(options));
    // No two buses tell the same time, and the first one's timer is about to wrap.
    if (i % 2 == 0)
      FireBuses::instance().set_clock(
          bus_of(i), {30.0 - 30.0 * static_cast<double>(bus_of(i)),
                      22'000'000'000 + 13'100'000'000 * static_cast<Nanoseconds>(bus_of(i))});
    FireBuses::instance().plug(units_[i], bus_of(i));
    wanted.push_back(sensor);
  }
  for (const IidcOptions& options : wanted) {
    sensors_.push_back(std::make_unique<IidcSensor>(options));
    drive(*sensors_.back());
  }
}

IidcBench::~IidcBench() {
  stop();
  sensors_.clear();
  FireBuses::instance().unplug_everything();
}

void IidcBench::check(std::size_t unit, const FrameSlot& slot, Log& log) {
  const std::lock_guard hold(VirtualTime::instance().mutex());  // the unit goes on sending
  const IidcUnit::Sent* const sent = units_[unit]->frame_of_ticks(slot.device_ticks);
  if (sent == nullptr) {
    ++log.unknown;
    return;
  }
  log.good.push_back({sent->number, slot.instant, slot.arrival});
  paint_stereo_pattern(static_cast<unsigned>(unit), sent->number, gray_);
  // The camera's counter takes the place of the first two pixels.
  if (units_[unit]->counts_frames()) gray_[0] = gray_[1] = gray_[2];
  const auto* const pixels = reinterpret_cast<const std::uint16_t*>(slot.bytes.data());
  for (std::size_t i = 0; i < gray_.size(); ++i)
    log.wrong_pixels += pixels[i] != gray_[i] ? 1U : 0U;
  const bool is_shaped = slot.format == PixelFormat::kGray16 && slot.width == IidcUnit::kWidth &&
                         slot.height == IidcUnit::kHeight;
  log.wrong_pixels += is_shaped ? 0U : gray_.size();
}

std::vector<DeviceBench::SentFrame> IidcBench::sent_frames(std::size_t unit) const {
  std::vector<SentFrame> sent;
  for (const IidcUnit::Sent& frame : units_[unit]->sent())
    sent.push_back({frame.number, frame.whole});
  return sent;
}

Nanoseconds IidcBench::light_of(std::size_t unit, std::uint32_t number) const {
  const std::lock_guard hold(VirtualTime::instance().mutex());
  const auto& sent = units_[unit]->sent();
  const auto found = std::find_if(sent.rbegin(), sent.rend(), [&](const IidcUnit::Sent& frame) {
    return frame.number == number;
  });
  return found == sent.rend() ? 0 : found->light;
}

}  // namespace wagonsight::device

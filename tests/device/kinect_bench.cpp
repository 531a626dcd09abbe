#include "kinect_bench.h"

namespace wagonsight::device {
namespace {

std::string serial_of(std::size_t unit) {
  return "A0033333333" + std::to_string(unit) + "A";
}

}  // namespace

KinectBench::KinectBench(std::size_t count, const Change& change, Picture picture)
    : DeviceBench(4 * count + 4, static_cast<std::size_t>(KinectUnit::kPixels) * 2),
      picture_(std::move(picture)),
      raw_(KinectUnit::kPixels),
      tables_(count, std::vector<std::uint16_t>(2048)) {
  if (!picture_)
    picture_ = [](std::size_t unit, std::uint32_t number, std::span<std::uint16_t> raw) {
      paint_test_pattern(static_cast<unsigned>(unit), number, raw);
    };
  for (std::size_t i = 0; i < count; ++i) {
    KinectUnit::Options options;
    options.serial = serial_of(i);
    options.feed = [this, i](std::uint32_t number, Nanoseconds /*light*/,
                             std::span<std::uint16_t> raw) { picture_(i, number, raw); };
    options.drift_ppm = 20.0 * static_cast<double>(i) - 30.0;
    options.phase = static_cast<Nanoseconds>(i) * 7'300'000;
    options.first_ticks = 0xF0000000U + static_cast<std::uint32_t>(i) * 0x01234567U;
    options.optics.shift = static_cast<std::uint16_t>(198 + i);  // no two are the same
    options.optics.reference_pixel_cm += 0.0003F * static_cast<float>(i);
    if (change) change(i, options);
    units_.push_back(std::make_shared<KinectUnit>(options));
    for (std::uint16_t raw = 0; raw < 2048; ++raw) tables_[i][raw] = units_[i]->millimetres(raw);
    UsbBuses::instance().plug(units_[i], bus_of(i), 1);
  }
  for (std::size_t i = 0; i < count; ++i) {
    sensors_.push_back(std::make_unique<KinectSensor>(
        KinectOptions{"k" + std::to_string(i), serial_of(i), static_cast<std::uint8_t>(i), {}}));
    drive(*sensors_[i]);
  }
}

KinectBench::~KinectBench() {
  stop();
  sensors_.clear();
  UsbBuses::instance().unplug_everything();
}

std::uint32_t KinectBench::frame_number(std::size_t unit, const FrameSlot& slot) const {
  return units_[unit]->frame_of_ticks(slot.device_ticks, VirtualTime::instance().now());
}

void KinectBench::check(std::size_t unit, const FrameSlot& slot, Log& log) {
  const std::uint32_t number = frame_number(unit, slot);
  log.good.push_back({number, slot.instant, slot.arrival});
  {
    const std::lock_guard hold(VirtualTime::instance().mutex());  // as when the unit asks
    picture_(unit, number, raw_);
  }
  const DepthImage depth = slot.depth();
  const auto& table = tables_[unit];
  for (std::size_t i = 0; i < raw_.size(); ++i)
    log.wrong_pixels += depth.pixels[i] == table[raw_[i]] ? 0U : 1U;
}

std::vector<DeviceBench::SentFrame> KinectBench::sent_frames(std::size_t unit) const {
  std::vector<SentFrame> sent;
  for (const KinectUnit::Sent& frame : units_[unit]->sent())
    sent.push_back({frame.number, frame.whole});
  return sent;
}

}  // namespace wagonsight::device

#include "kinect/depth_assembly.h"

#include <algorithm>
#include <cmath>

#include "base/check.h"

namespace wagonsight {
namespace {

constexpr double kStepsPerPixel = 4.0;
constexpr double kOffset_px = 0.375;
constexpr double kDepthMax_mm = 10'000;
constexpr std::size_t kNoReading = 2047;

std::size_t payload_bytes(int number) {
  const auto at = static_cast<std::size_t>(number) * DepthAssembly::kPacketBytes;
  return std::min<std::size_t>(DepthAssembly::kPacketBytes, DepthAssembly::kFrameBytes - at);
}

}  // namespace

bool make_depth_table(const KinectOptics& optics, DepthTable& table) {
  table.fill(0);
  // Every Kinect of the kind is near 7.5, 120, 0.1042 and 200.
  const auto near = [](double value, double low, double high) {
    return std::isfinite(value) && value > low && value < high;
  };
  if (!near(optics.emitter_distance_cm, 5, 10) || !near(optics.reference_distance_cm, 60, 240) ||
      !near(optics.reference_pixel_cm, 0.05, 0.2) || !near(optics.shift, 50, 400))
    return false;
  for (std::size_t raw = 0; raw < kNoReading; ++raw) {
    const double pixels =
        (static_cast<double>(raw) - kStepsPerPixel * optics.shift) / kStepsPerPixel - kOffset_px;
    const double shift_cm = pixels * optics.reference_pixel_cm;
    if (shift_cm >= optics.emitter_distance_cm) break;
    const double depth_mm =
        10.0 * (shift_cm * optics.reference_distance_cm / (optics.emitter_distance_cm - shift_cm) +
                optics.reference_distance_cm);
    if (depth_mm > 0 && depth_mm < kDepthMax_mm) table[raw] = static_cast<std::uint16_t>(depth_mm);
  }
  return true;
}

void DepthAssembly::add(int number, std::span<const std::byte> payload) {
  if (number < 0 || number >= kPackets) return;
  if (number <= last_number_) good_ = 0;
  last_number_ = number;
  const std::size_t expected = payload_bytes(number);
  const std::size_t count = std::min(payload.size(), expected);
  std::copy_n(payload.begin(), count,
              packed_.get() + static_cast<std::size_t>(number) * kPacketBytes);
  if (payload.size() == expected) ++good_;
}

bool DepthAssembly::finish() {
  if (last_number_ != kPackets - 1) return false;
  last_number_ = kPackets;
  return good_ == kPackets;
}

void DepthAssembly::convert(const DepthTable& table, std::span<std::uint16_t> out) const {
  WS_CHECK(out.size() == kKinectPixels, "%zu pixels", out.size());
  // Eight pixels are eleven bytes, most significant bit first.
  const std::byte* in = packed_.get();
  for (std::size_t i = 0; i < kKinectPixels; i += 8, in += 11) {
    std::uint64_t high = 0;  // the first 64 of the 88 bits
    for (std::size_t b = 0; b < 8; ++b) high = high << 8U | std::to_integer<std::uint64_t>(in[b]);
    std::uint64_t low = high & 0x1FFU;  // the last 9 of them and the other 24
    for (std::size_t b = 8; b < 11; ++b) low = low << 8U | std::to_integer<std::uint64_t>(in[b]);
    for (unsigned p = 0; p < 5; ++p) out[i + p] = table[high >> (53U - 11U * p) & 0x7FFU];
    for (unsigned p = 0; p < 3; ++p) out[i + 5 + p] = table[low >> (22U - 11U * p) & 0x7FFU];
  }
}

}  // namespace wagonsight

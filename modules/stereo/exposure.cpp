#include "stereo/exposure.h"

#include <algorithm>
#include <cmath>

namespace wagonsight {
namespace {

constexpr int kStep = 4;
constexpr double kDark = 0.02, kBright = 0.97;
// Beyond these shares the image says too little to match.
constexpr double kUnusableBright = 0.4, kUnusableDark = 0.8;
// Steps for images without information, and the most one image may change.
constexpr double kStepDown = 0.2, kStepUp = 6.0;

double exposure_of(const ExposureSettings& settings) {
  return settings.shutter_us * std::pow(10.0, settings.gain_db / 20.0);
}

// Shutter first, gain for what is left.
ExposureSettings split(double exposure, const ExposureLimits& limits) {
  const double least_gain = std::pow(10.0, limits.gain_db_min / 20.0);
  ExposureSettings settings;
  settings.shutter_us =
      std::clamp(exposure / least_gain, limits.shutter_us_min, limits.shutter_us_max);
  settings.gain_db = std::clamp(20.0 * std::log10(exposure / settings.shutter_us),
                                limits.gain_db_min, limits.gain_db_max);
  return settings;
}

// By how much the exposure is to change.
double wanted_ratio(const ExposureStatistics& seen, const ExposureTarget& target) {
  if (seen.bright_share > kUnusableBright) return kStepDown;
  if (seen.dark_share > kUnusableDark) return kStepUp;
  double ratio = target.mean / std::max(seen.mean, 0.001);
  // Saturated pixels were cut off, so the mean understates the light: each share of them above
  // the allowed one asks for as much less again.
  if (seen.bright_share > target.bright_share_max)
    ratio = std::min(ratio, 1.0) * (1.0 - seen.bright_share + target.bright_share_max);
  if (std::abs(ratio - 1.0) <= target.tolerance) return 1.0;
  return std::clamp(ratio, kStepDown, kStepUp);
}

}  // namespace

ExposureStatistics measure_exposure(const GrayImage& image, std::span<const std::uint64_t> mask,
                                    int full_scale, RectifyTable table) {
  ExposureStatistics statistics;
  const int dark_below = static_cast<int>(kDark * full_scale);
  const int bright_from = static_cast<int>(kBright * full_scale);
  std::uint64_t sum = 0;
  std::uint32_t dark = 0, bright = 0;
  for (int y = 0; y < image.height; y += kStep)
    for (int x = 0; x < image.width; x += kStep) {
      const std::size_t at = static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width) +
                             static_cast<std::size_t>(x);
      if (!mask.empty() && (mask[at / 64] >> (at % 64) & 1) == 0) continue;
      if (!table.empty() && table[at] == kOutsideSource) continue;
      const std::size_t pixel = table.empty() ? at : table[at] >> 10;
      const int gray = image.format == PixelFormat::kGray8
                           ? static_cast<const std::uint8_t*>(image.pixels)[pixel]
                           : static_cast<const std::uint16_t*>(image.pixels)[pixel];
      sum += static_cast<std::uint64_t>(std::min(gray, full_scale));
      dark += gray < dark_below;
      bright += gray >= bright_from;
      ++statistics.pixels;
    }
  if (statistics.pixels == 0) return statistics;
  const double count = statistics.pixels;
  statistics.mean = static_cast<double>(sum) / (count * full_scale);
  statistics.dark_share = dark / count;
  statistics.bright_share = bright / count;
  return statistics;
}

ExposureDecision next_exposure(const ExposureStatistics& seen, const ExposureSettings& used,
                               const ExposureLimits& limits, const ExposureTarget& target) {
  if (seen.pixels == 0) return {used, false};  // nothing inside the mask: nothing is known
  ExposureDecision decision;
  decision.usable = seen.bright_share <= kUnusableBright && seen.dark_share <= kUnusableDark;
  const double ratio = wanted_ratio(seen, target);
  decision.next = ratio == 1.0 ? used : split(exposure_of(used) * ratio, limits);
  return decision;
}

}  // namespace wagonsight

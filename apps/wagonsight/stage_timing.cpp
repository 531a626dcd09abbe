#include "stage_timing.h"

#include <fmt/format.h>
#include <time.h>

#include <algorithm>
#include <numeric>
#include <string_view>

namespace wagonsight {
namespace {

constexpr std::array<std::string_view, kStageCount> kStageNames{"to_depth", "extract", "fuse",
                                                                "people", "situation"};

Duration read_clock(clockid_t clock) {
  timespec time{};
  clock_gettime(clock, &time);
  return std::chrono::seconds(time.tv_sec) + std::chrono::nanoseconds(time.tv_nsec);
}

// The smallest value that at least `share` of all do not exceed.
double quantile(std::vector<double> values, double share) {
  if (values.empty()) return 0;
  const auto last = static_cast<double>(values.size() - 1);
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(share * last + 0.5);
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

std::string summary(const std::vector<double>& values) {
  const double sum = std::accumulate(values.begin(), values.end(), 0.0);
  const double mean = values.empty() ? 0 : sum / static_cast<double>(values.size());
  const double max = values.empty() ? 0 : *std::max_element(values.begin(), values.end());
  return fmt::format(R"({{"mean_ms":{:.4f},"p50_ms":{:.4f},"p99_ms":{:.4f},"max_ms":{:.4f}}})",
                     mean, quantile(values, 0.50), quantile(values, 0.99), max);
}

}  // namespace

Duration StageTimings::now() {
  return read_clock(CLOCK_MONOTONIC);
}

Duration StageTimings::thread_time() {
  return read_clock(CLOCK_THREAD_CPUTIME_ID);
}

void StageTimings::add(const std::array<Duration, kStageCount>& stages, Duration processor) {
  for (std::size_t i = 0; i < kStageCount; ++i) stages_ms_[i].push_back(to_milliseconds(stages[i]));
  processor_ms_.push_back(to_milliseconds(processor));
}

std::string StageTimings::to_json(Duration recorded) const {
  const double processor_s =
      1e-3 * std::accumulate(processor_ms_.begin(), processor_ms_.end(), 0.0);
  const double recorded_s = to_seconds(recorded);
  std::string text = fmt::format(
      R"({{"framesets":{},"recorded_s":{:.3f},"processor_s":{:.4f},"core_share":{:.4f},)",
      processor_ms_.size(), recorded_s, processor_s,
      recorded_s > 0 ? processor_s / recorded_s : 0.0);
  text += fmt::format(R"("frameset_processor":{},"stages":{{)", summary(processor_ms_));
  for (std::size_t i = 0; i < kStageCount; ++i)
    text += fmt::format(R"({}"{}":{})", i == 0 ? "" : ",", kStageNames[i], summary(stages_ms_[i]));
  text += "}";
  if (!latency_ms_.empty()) {
    constexpr double kBacklogMax_ms = 300;  // the daemon skips what is older
    const auto late = std::count_if(latency_ms_.begin(), latency_ms_.end(),
                                    [](double ms) { return ms > kBacklogMax_ms; });
    text += fmt::format(R"(,"latency":{},"late":{},"learning":{{"framesets":{},"latency":{}}})",
                        summary(latency_ms_), late, learning_latency_ms_.size(),
                        summary(learning_latency_ms_));
  }
  if (!matched_share_.empty()) {
    const double sum = std::accumulate(matched_share_.begin(), matched_share_.end(), 0.0);
    text += fmt::format(R"(,"stereo_images":{},"stereo_matched_share":{:.4f})",
                        matched_share_.size(), sum / static_cast<double>(matched_share_.size()));
  }
  return text + "}\n";
}

}  // namespace wagonsight

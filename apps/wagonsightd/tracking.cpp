#include "tracking.h"

#include <algorithm>

#include "common/grouping_options.h"
#include "linux/clocks.h"
#include "linux/resources.h"
#include "linux/sealed_heap.h"
#include "linux/threads.h"

namespace wagonsight {
namespace {

// Instants that are older are skipped, so that what is told stays of now: the grouping itself waits
// up to a tenth of a second, with stereo cameras a fifth, for late frames.
constexpr Duration kBacklogMax = std::chrono::milliseconds(300);
constexpr double kSkewGain = 0.1;  // a mean of about the last ten frames
constexpr Duration kWait = std::chrono::milliseconds(4);

std::array<double, kSensorsMax> rates_of(const Rig& rig) {
  std::array<double, kSensorsMax> rates{};
  for (std::size_t i = 0; i < rig.sensors.size(); ++i) rates[i] = rig.sensors[i].rate_hz;
  return rates;
}

// A pair of stereo images is on its bus for a fourteenth of a second before it is complete.
constexpr Duration kStereoLatencyMax = std::chrono::milliseconds(120);

FrameSetOptions live_options(const Rig& rig, const CaptureSettings& capture) {
  FrameSetOptions options = grouping_options(capture, rig);
  options.tick_when_silent = true;
  const bool has_stereo =
      std::any_of(rig.sensors.begin(), rig.sensors.end(),
                  [](const RigSensor& sensor) { return sensor.kind == SensorKind::kStereo; });
  if (has_stereo) options.latency_max = kStereoLatencyMax;
  return options;
}

}  // namespace

Tracking::Tracking(std::unique_ptr<Pipeline> pipeline, std::unique_ptr<Workers> workers,
                   const Rig& rig, const CaptureSettings& capture, FramePool& pool, FrameBell& bell,
                   HostTime daemon_start)
    : workers_(std::move(workers)),
      pipeline_(std::move(pipeline)),
      sensor_count_(rig.sensors.size()),
      stamp_delays_(stamp_delays(rig)),
      grouping_(make_frame_grouping(pool, rates_of(rig), live_options(rig, capture))),
      bell_(bell),
      daemon_start_(daemon_start),
      now_(std::make_unique<TrackingReport>()),
      shared_(std::make_unique<Seqlock<TrackingReport>>()) {
  pipeline_->set_ticker(host_ticks);
  for (std::size_t i = 0; i < rig.sensors.size(); ++i)
    is_kinect_[i] = rig.sensors[i].kind == SensorKind::kKinect;
}

Tracking::~Tracking() {
  stop();
}

void Tracking::start(std::vector<SourceThread*> sources, DriftWatch* drift) {
  drift_ = drift;
  sources_ = std::move(sources);
  workers_->start();
  thread_ = std::thread([this] { run(); });
}

void Tracking::stop() {
  stop_.store(true, std::memory_order_release);
  if (thread_.joinable()) thread_.join();
  workers_->stop();
}

void Tracking::run() {
  name_this_thread("tracking");
  hold_this_stack();
  const HeapSeal seal;
  FrameSet set;
  while (!stop_.load(std::memory_order_acquire)) {
    bell_.wait(kWait);
    take_frames();
    // A computer that does not keep up always has a next instant; it must stop nevertheless.
    while (!stop_.load(std::memory_order_acquire) && grouping_->next(host_now(), set)) {
      note_tick(set);
      if (host_now() - set.instant > kBacklogMax) {
        ++now_->framesets_dropped;
      } else if (is_spared(set)) {
        ++now_->framesets_spared;
      } else {
        process(set);
      }
      take_frames();
    }
  }
}

// The cameras that are triggered follow the ticks that others make.
void Tracking::note_tick(const FrameSet& set) {
  for (std::size_t i = 0; i < sensor_count_; ++i) {
    if (!is_kinect_[i] || set.sensors[i].state != FrameState::kPresent) continue;
    last_tick_.store(set.instant.time_since_epoch().count(), std::memory_order_relaxed);
    return;
  }
}

// Half an instant of patience, so that half the rate is every second instant and not every third.
bool Tracking::is_spared(const FrameSet& set) const {
  const double limit_hz = rate_limit_hz_.load(std::memory_order_relaxed);
  if (limit_hz <= 0 || now_->framesets == 0) return false;
  constexpr double kHalfInstantS = 0.5 / 30;
  return to_seconds(set.instant - worked_on_) < 1 / limit_hz - kHalfInstantS;
}

void Tracking::take_frames() {
  turns_.fetch_add(1, std::memory_order_relaxed);
  for (SourceThread* source : sources_) {
    while (FrameSlot* slot = source->take()) {
      TrackedSensor& sensor = now_->sensors[slot->sensor_index];
      // The stamp is late by as much as was measured; the grouping takes that off, too.
      const HostTime light = slot->instant - stamp_delays_[slot->sensor_index];
      sensor.latency_ms = to_milliseconds(slot->arrival - light);
      if (!slot->damaged) sensor.last_good = to_seconds(slot->arrival - daemon_start_);
      grouping_->add(slot);
    }
  }
}

void Tracking::process(const FrameSet& set) {
  if (now_->framesets == 0) frame_offset_s_ = to_seconds(set.instant - daemon_start_);
  worked_on_ = set.instant;
  if (doors_.load(doors_heard_)) pipeline_->hear_doors({doors_heard_.data(), doors_heard_.size()});
  now_->frame = pipeline_->process(set);
  if (drift_ != nullptr) drift_->offer(set, *pipeline_, now_->frame);
  shift_times(now_->frame);
  tell(set);
}

void Tracking::shift_times(PeopleFrame& frame) const {
  frame.time += frame_offset_s_;
  for (Person& person : frame.people) {
    person.since += frame_offset_s_;
    person.last_seen += frame_offset_s_;
  }
  for (Event& event : frame.events) event.since += frame_offset_s_;
}

void Tracking::tell(const FrameSet& set) {
  TrackingReport& now = *now_;
  now.occupancy = pipeline_->occupancy();
  now.learning = pipeline_->learning();
  const auto& times = pipeline_->last_stage_times();
  for (std::size_t i = 0; i < kStageCount; ++i)
    now.stage_ms[i][now.framesets % TrackingReport::kTimings] =
        static_cast<float>(to_milliseconds(times[i]));
  ++now.framesets;
  for (std::size_t i = 0; i < sensor_count_; ++i) {
    const FrameGrouping::Counters& counters = grouping_->counters(i);
    TrackedSensor& sensor = now.sensors[i];
    sensor.received = counters.received;
    sensor.unused = counters.late + counters.overrun + counters.out_of_order +
                    counters.implausible + counters.duplicates;
    sensor.damaged = counters.damaged;
    sensor.background_share = pipeline_->background_share(i);
    tell_stereo(i, set);
    if (set.sensors[i].state == FrameState::kPresent)
      sensor.skew_ms += kSkewGain * (to_milliseconds(set.sensors[i].skew) - sensor.skew_ms);
  }
  now.latency_ms = to_milliseconds(host_now() - set.instant);
  now.cpu_s = to_seconds(thread_cpu_time() + workers_->helpers_cpu_time());
  // The first instant touches what is not memory of the data path: the stack, code, the clock.
  if (now.framesets == 1) faults_at_start_ = page_faults();
  now.page_faults = page_faults() - faults_at_start_;
  shared_->store(now);
}

void Tracking::tell_stereo(std::size_t sensor_index, const FrameSet& set) {
  const StereoReport* report = pipeline_->stereo_report(sensor_index);
  if (report == nullptr) return;
  StereoStatus& told = now_->sensors[sensor_index].stereo;
  told.present = true;
  if (set.sensors[sensor_index].state != FrameState::kPresent) return;
  HostTime& usable_at = usable_at_[sensor_index];
  if (report->usable || usable_at == HostTime{}) usable_at = set.instant;
  told.matched_share = report->matched_share;
  told.unusable = report->unusable;
  told.unusable_s = to_seconds(set.instant - usable_at);
  told.row_offset_px = report->row_offset_px;
  told.misaligned = report->misaligned;
  told.shutter_us = static_cast<double>(report->next.shutter_us);
  told.gain_db = static_cast<double>(report->next.gain_db);
  if (report->next.shutter_us > 0) set_exposure(sensor_index, report->next);
}

// The driver applies what the law asks for.
void Tracking::set_exposure(std::size_t sensor_index, const Exposure& exposure) {
  for (SourceThread* source : sources_)
    if (source->is_only_source_of(sensor_index)) source->set_exposure(exposure);
}

}  // namespace wagonsight

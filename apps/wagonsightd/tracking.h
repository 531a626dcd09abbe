#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <thread>
#include <vector>

#include "base/seqlock.h"
#include "capture/frame_grouping.h"
#include "drift_watch.h"
#include "frame_source.h"
#include "linux/held_memory.h"
#include "linux/workers.h"
#include "pipeline/pipeline.h"
#include "settings/settings.h"
#include "snapshot/snapshot.h"

namespace wagonsight {

// What the tracking thread says of one sensor.
struct TrackedSensor {
  std::uint64_t received = 0;
  std::uint64_t unused = 0;  // came too late, out of order, or when the pipeline was behind
  std::uint64_t damaged = 0;
  double skew_ms = 0;     // mean of the last few frames that were used
  double latency_ms = 0;  // from the light to the host having the frame
  double last_good = 0;   // seconds since the daemon's start
  double background_share = 0;
  StereoStatus stereo;
};

// What it says after each instant; flat, because it crosses to the control thread by a sequence
// lock.
struct TrackingReport {
  PeopleFrame frame;  // its times are seconds since the daemon's start
  Occupancy occupancy;
  std::array<TrackedSensor, kSensorsMax> sensors{};
  bool learning = true;
  std::uint64_t framesets = 0, framesets_dropped = 0;
  std::uint64_t framesets_spared = 0;  // by set_rate_limit
  double latency_ms = 0;
  double cpu_s = 0;                             // of the tracking thread and the workers
  std::uint64_t page_faults = 0;                // of them since the first instant
  static constexpr std::size_t kTimings = 256;  // eight seconds
  std::array<std::array<float, kTimings>, kStageCount> stage_ms{};
};

// The thread that turns frames into people: takes slots from the sources, groups them, runs the
// pipeline, and with it the workers. Their heaps are sealed.
class Tracking {
 public:
  // `workers` are the pipeline's, made but not started.
  Tracking(std::unique_ptr<Pipeline> pipeline, std::unique_ptr<Workers> workers, const Rig& rig,
           const CaptureSettings& capture, FramePool& pool, FrameBell& bell, HostTime daemon_start);
  ~Tracking();  // stops
  Tracking(const Tracking&) = delete;
  Tracking& operator=(const Tracking&) = delete;

  // `drift` may be nullptr.
  void start(std::vector<SourceThread*> sources, DriftWatch* drift);
  void stop();

  // One other thread: what the train says of its doors, in the wagon's order, from now on.
  void hear_doors(const DoorStates& doors) { doors_.store(doors); }

  // Any one other thread. False until the first instant.
  bool report(TrackingReport& report) const { return shared_->load(report); }
  std::uint64_t report_count() const { return shared_->version(); }
  // From now on at most so many instants a second are worked on, to spare the computer; 0: all. Any
  // thread.
  void set_rate_limit(double hz) { rate_limit_hz_.store(hz, std::memory_order_relaxed); }
  // The instant of the newest FrameSet to which a Kinect gave a frame; zero before the first.
  HostTime last_tick() const {
    return HostTime(Duration(last_tick_.load(std::memory_order_relaxed)));
  }
  // Rises many times a second while the thread is not stuck, with or without frames.
  std::uint64_t turns() const { return turns_.load(std::memory_order_relaxed); }
  // So do the workers'.
  const Workers& workers() const { return *workers_; }

 private:
  void run();
  void take_frames();
  void note_tick(const FrameSet& set);
  bool is_spared(const FrameSet& set) const;
  void process(const FrameSet& set);
  void tell(const FrameSet& set);
  void tell_stereo(std::size_t sensor_index, const FrameSet& set);
  void set_exposure(std::size_t sensor_index, const Exposure& exposure);
  void shift_times(PeopleFrame& frame) const;
  std::uint64_t page_faults() const {
    return thread_page_faults() + workers_->helpers_page_faults();
  }

  std::unique_ptr<Workers> workers_;
  std::unique_ptr<Pipeline> pipeline_;
  std::size_t sensor_count_;
  std::array<Duration, kSensorsMax> stamp_delays_;
  std::unique_ptr<FrameGrouping> grouping_;
  FrameBell& bell_;
  HostTime daemon_start_;
  std::array<HostTime, kSensorsMax> usable_at_{};  // the last image of a stereo camera that was
  double frame_offset_s_ = 0;                      // the pipeline counts from its first instant
  std::vector<SourceThread*> sources_;
  DriftWatch* drift_ = nullptr;
  Seqlock<DoorStates> doors_;
  DoorStates doors_heard_;
  std::unique_ptr<TrackingReport> now_;
  std::unique_ptr<Seqlock<TrackingReport>> shared_;
  HostTime worked_on_{};  // the instant of the last set
  std::atomic<double> rate_limit_hz_{0};
  std::uint64_t faults_at_start_ = 0;
  std::atomic<bool> stop_{false};
  std::atomic<std::uint64_t> turns_{0};
  std::array<bool, kSensorsMax> is_kinect_{};
  std::atomic<std::int64_t> last_tick_{0};
  std::thread thread_;
};

}  // namespace wagonsight

#pragma once

#include <array>
#include <atomic>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "base/fixed_vector.h"
#include "base/seqlock.h"
#include "drift/drift_monitor.h"
#include "frame/frame.h"
#include "pipeline/pipeline.h"
#include "rig/ray_table.h"
#include "snapshot/snapshot.h"

namespace wagonsight {

struct DriftReport {
  bool alarm = false;
  FixedString<160> text;  // of the moment
  FixedString<160> note;  // for the log, once each `notes`
  std::uint32_t notes = 0;
};

// The drift monitor's thread, polite and apart: the tracking thread leaves a sample of each
// sensor's depth with it twice a second, and never waits for it.
class DriftWatch {
 public:
  // `rays` of every sensor, by its index; they must outlive it. `model_path`: where the static
  // wagon of the day of calibration is kept; empty: nowhere, it is learned anew at each start.
  // `blob_sha256` says which calibration the model must belong to.
  DriftWatch(const Rig& rig, const std::array<RayTable, kSensorsMax>& rays, std::string model_path,
             const std::array<std::uint8_t, 32>& blob_sha256);
  ~DriftWatch();  // stops
  DriftWatch(const DriftWatch&) = delete;
  DriftWatch& operator=(const DriftWatch&) = delete;

  void start();
  void stop();

  // Tracking thread, after an instant was processed. Copies 25 KB a sensor when a sample is due
  // and the last one was taken; allocates nothing. Nothing is taken while the pipeline learns, for
  // people are not known then.
  void offer(const FrameSet& set, const Pipeline& pipeline, const PeopleFrame& people);

  // Control thread. False until there is something to say.
  bool report(DriftReport& report) const { return shared_.load(report); }

 private:
  // Handed over by `full`: false: the tracking thread's, true: the monitor's.
  struct Sample {
    std::vector<std::uint16_t> readings;
    FixedVector<KeepOut, kPeopleMax> people;
    HostTime taken{};
    std::atomic<bool> full{false};
  };
  void run();
  void take(std::size_t sensor);
  void tell();
  void open_model();
  void keep_model();
  void note(std::string_view text);

  Rig rig_;
  std::array<RayTable, kSensorsMax> rays_;
  std::string model_path_;
  std::array<std::uint8_t, 32> blob_sha256_;
  std::array<std::unique_ptr<Sample>, kSensorsMax> samples_;
  std::unique_ptr<DriftMonitor> monitor_;
  bool model_kept_ = false;
  int waits_ = 0;  // samples with somebody in view, while learning
  DriftReport now_;
  Seqlock<DriftReport> shared_;
  std::mutex mutex_;
  std::condition_variable wake_;
  bool stop_ = false;
  std::thread thread_;
};

}  // namespace wagonsight

#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "base/time.h"
#include "frame_source.h"
#include "recording/recording_writer.h"
#include "recording_disk.h"
#include "rig/rig.h"
#include "snapshot/snapshot.h"

namespace wagonsight {

struct DepotOptions {
  std::string folder;  // made when it is not there
  std::string made_by = "wagonsightd";
  bool has_vehicle = false;  // tell_vehicle() will be called
  Duration file_length = std::chrono::minutes(10);
  std::size_t memory_bytes = std::size_t{64} << 20U;       // of frames that wait for the disk
  std::uint64_t free_bytes_min = std::uint64_t{1} << 30U;  // is left on the disk
};

// Writes every frame of all sensors to the disk while it is told to, beside the tracking and never
// in its way: the sensors' threads leave copies in a memory of fixed size, and one thread of low
// priority packs and writes them.
//
//               start()                   its time is over, stop(), or the disk's floor is reached
//     kOff ---------------> kOn ---------------------------------------------------------> kOff
//                           ^  |  a write fails: the file is cut behind its last whole chunk
//        again, a new file  |  v
//                          kNoDisk   tries again every second; ends as above
//
// When the memory is full the oldest frame that is not being written is dropped and counted, so a
// slow disk costs frames of the recording and nothing else. What was written is on the disk within
// half a second, in whole chunks: whatever happens to the process or its power, all but the last
// second of a recording can be read (of one whose disk keeps up: what waits in memory is lost).
class DepotRecorder final : public FrameWitness {
 public:
  // `slot_bytes`: of the largest frame. The disk must outlive this.
  DepotRecorder(const Rig& rig, std::size_t slot_bytes, DepotOptions options,
                RecordingDisk& disk = system_disk());
  ~DepotRecorder() override;  // ends the recording; may wait for the disk
  DepotRecorder(const DepotRecorder&) = delete;
  DepotRecorder& operator=(const DepotRecorder&) = delete;

  // Records from now on and for so long; when it is recording already, that is its new end. The
  // Error: no memory, or the last recording is still being finished. Allocates. Control thread.
  Result<void> start(Duration length);
  // Soon ends the recording. Control thread.
  void stop();
  RecordingStatus status() const;  // any thread

  // What the train says from now on; the newest goes into each file. Control thread.
  void tell_vehicle(const VehicleStateMessage& state);

  // A sensor's frame, its sensor_index that of the rig. Any number of threads; copies it, and
  // waits for no disk. Does nothing while no recording is on.
  void offer(const FrameSlot& frame) override;

 private:
  class Sink;
  void run();
  FrameSlot* take_free();
  FrameSlot* take_oldest();
  void put(FrameSlot* slot);
  FrameSlot* pop_oldest();  // with mutex_
  static constexpr std::size_t kNewsMax = 64;
  bool is_over(HostTime now);
  void write(const FrameSlot& slot);
  void write_rest();
  void write_vehicle();
  Result<void> open_file(const FrameSlot& first);
  Result<std::string> free_path();
  Result<void> close_file();
  void sync_when_due(HostTime now);
  void take_failure(const Error& error);
  void tell_progress();

  const Rig rig_;
  const std::size_t slot_bytes_;
  const DepotOptions options_;
  RecordingDisk& disk_;

  mutable std::mutex mutex_;  // held for a few instructions at a time
  std::unique_ptr<FramePool> memory_;
  std::vector<FrameSlot*> queue_;  // a ring of all the memory's slots
  std::size_t queue_begin_ = 0, queue_size_ = 0;
  int copying_ = 0;
  std::vector<VehicleStateMessage> vehicle_news_;  // at most kNewsMax
  RecordingStatus status_;
  HostTime end_{};

  std::atomic<bool> accepts_{false}, stop_{false}, is_running_{false};
  std::thread thread_;

  // Of the recorder's thread.
  std::unique_ptr<Sink> sink_;
  std::unique_ptr<RecordingWriter> writer_;
  HostTime file_begin_{}, synced_{}, try_again_{};
  std::optional<VehicleStateMessage> vehicle_;
  std::uint64_t frames_in_chunk_ = 0;  // given to the writer, not yet to the file
  std::uint64_t frames_done_ = 0, bytes_done_ = 0;
  std::uint32_t files_ = 0, file_number_ = 0;
};

}  // namespace wagonsight

#pragma once

#include <memory>
#include <string>

#include "capture/sensor.h"
#include "linux/files.h"
#include "recording/recording_reader.h"

namespace wagonsight {

// A recording as a source of frames, at the pace at which it was made: its frames arrive as long
// after the daemon's start as they did after the recording's. One source for all its sensors; the
// slots carry the sensor indices of reader().rig().
class RecordedSensor final : public Sensor {
 public:
  // The Error begins with the path.
  static Result<std::unique_ptr<RecordedSensor>> open(const std::string& path);
  ~RecordedSensor() override;
  RecordedSensor(const RecordedSensor&) = delete;
  RecordedSensor& operator=(const RecordedSensor&) = delete;

  const RecordingReader& reader() const { return *reader_; }
  void drop_blob() { reader_->drop_blob(); }
  // When the recording's first instant is to be; before the first poll().
  void begin_at(HostTime start) { start_ = start; }

  std::string_view name() const override { return "recording"; }
  bool poll(Duration timeout, FramePool& pool, SpscRing<FrameSlot*>& frames) override;
  Counters counters() const override { return counters_; }

 private:
  explicit RecordedSensor(MappedFile file);
  void let_go_of_read_pages();

  MappedFile file_;
  std::unique_ptr<RecordingReader> reader_;
  HostTime start_{};
  FrameSlot* waiting_ = nullptr;  // read, and not due yet
  FramePool* pool_ = nullptr;
  std::size_t segment_ = 0;
  Counters counters_;
};

}  // namespace wagonsight

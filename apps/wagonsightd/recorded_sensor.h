#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>

#include "capture/sensor.h"
#include "linux/files.h"
#include "recording/recording_reader.h"

namespace wagonsight {

// A recording as a source of frames, at the pace at which it was made: its frames arrive as long
// after the daemon's start as they did after the recording's. One source for all its sensors; the
// slots carry the sensor indices of reader().rig(). Looped, it begins anew at its end, and times,
// sequence numbers and device ticks go on as if the sensors had never stopped.
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
  void loop() { is_looped_ = true; }

  std::string_view name() const override { return "recording"; }
  bool poll(Duration timeout, FramePool& pool, SpscRing<FrameSlot*>& frames) override;
  Counters counters() const override { return counters_; }

 private:
  explicit RecordedSensor(MappedFile file);
  // What the first lap tells of a sensor, so that the next ones can follow it.
  struct Stream {
    std::uint64_t frames = 0;
    HostTime first{}, last{};
    std::uint32_t first_sequence = 0, last_sequence = 0;
    std::uint64_t first_ticks = 0, last_ticks = 0;
  };
  bool read_next(FramePool& pool);
  bool begin_next_lap();
  void place_in_time(FrameSlot& slot);
  void let_go_of_read_pages();

  MappedFile file_;
  std::unique_ptr<RecordingReader> reader_;
  HostTime start_{};
  FrameSlot* waiting_ = nullptr;  // read, and not due yet
  FramePool* pool_ = nullptr;
  std::size_t segment_ = 0;
  bool is_looped_ = false;
  std::int64_t laps_ = 0;  // that are over
  Duration lap_length_{};
  std::array<Stream, kSensorsMax> streams_{};
  Counters counters_;
};

}  // namespace wagonsight

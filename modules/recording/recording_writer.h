#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/capacities.h"
#include "base/result.h"
#include "frame/frame.h"
#include "recording/mcap_writer.h"
#include "recording/ros_messages.h"
#include "rig/rig.h"

namespace wagonsight {

// How a recording names what it holds; reader and writer share it.
inline constexpr std::string_view kRigAttachment = "rig.blob";
inline constexpr std::string_view kRecordingMetadata = "wagonsight";
inline constexpr std::string_view kSensorKey = "wagonsight_sensor";
inline constexpr std::string_view kStreamKey = "wagonsight_stream";  // depth, left, right, info

struct RecordingOptions {
  McapWriterOptions mcap;
  // What is stored beside the frames about the recording's origin: program, scene, seed, folder.
  McapPairs provenance;
  // Files that belong to the recording, besides the blob; their bytes are used by create() only.
  std::vector<McapAttachment> attachments;
  // The zero of "seconds since the recording's start".
  HostTime start{};
  bool has_vehicle = false;  // there will be signals of the train
};

// Writes frames of a rig as a ROS 2 recording: per Kinect /NAME/depth/image_raw (16UC1, plain
// millimetres) and /NAME/depth/camera_info, per stereo camera the same for left and right, per
// frame /NAME/frame_info. The calibration blob is the attachment "rig.blob". log_time is the
// frame's arrival, publish_time its instant. One thread; memory as McapWriter.
class RecordingWriter {
 public:
  static Result<std::unique_ptr<RecordingWriter>> create(ByteSink& sink, const Rig& rig,
                                                         const RecordingOptions& options);

  // The slot's sensor_index is one of the rig; its size and format are those of that sensor.
  Result<void> write(const FrameSlot& slot);
  // What the train said, at /vehicle/state; of a recording that was told to expect it.
  Result<void> write(const VehicleStateMessage& state);
  // What was written reaches the sink now; frames that come seldom would wait for the next one.
  Result<void> flush() { return mcap_->flush(); }
  Result<void> finish() { return mcap_->finish(); }

  std::uint64_t frame_count() const { return frame_count_; }
  const McapWriter& mcap() const { return *mcap_; }

 private:
  struct Stream {
    std::uint16_t image = 0, camera_info = 0;  // channels
    CameraInfoMessage camera;                  // of every image but its time and name
  };
  struct SensorChannels {
    std::uint16_t frame_info = 0;
    std::array<Stream, 2> streams{};  // depth, or left and right
  };
  struct SchemaIds {
    std::uint16_t image = 0, camera_info = 0, frame_info = 0;
  };

  RecordingWriter(std::unique_ptr<McapWriter> mcap, const Rig& rig);
  Result<SchemaIds> add_schemas();
  Result<void> add_vehicle();
  Result<void> add_sensor(const RigSensor& sensor, const SchemaIds& schemas);
  Result<Stream> add_stream(const RigSensor& sensor, std::string_view stream,
                            const SchemaIds& schemas);
  void write_image(const FrameSlot& slot, std::size_t image_index, McapMessage message);

  std::unique_ptr<McapWriter> mcap_;
  Rig rig_;
  std::vector<SensorChannels> sensors_;
  std::optional<std::uint16_t> vehicle_;  // channel
  ByteWriter scratch_;
  std::uint64_t frame_count_ = 0;
};

}  // namespace wagonsight

#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/capacities.h"
#include "base/result.h"
#include "frame/frame.h"
#include "recording/mcap_reader.h"
#include "recording/ros_messages.h"
#include "rig/ray_table.h"
#include "rig/rig.h"

namespace wagonsight {

// Reads the frames of a recording back in the order in which they arrived. Understands what
// RecordingWriter wrote and other ROS 2 recordings that hold 16UC1 depth images with their
// CameraInfo (sensors are then named after their topics and have no pose). `file` must outlive the
// reader. One thread; next() allocates only until its buffer has the size of the largest chunk.
class RecordingReader {
 public:
  // The Error: as McapReader::open, a damaged blob, or no depth or stereo images in it.
  static Result<std::unique_ptr<RecordingReader>> open(std::span<const std::byte> file,
                                                       DamagePolicy policy);

  const McapReader& mcap() const { return mcap_; }
  const McapCursor& cursor() const { return cursor_; }

  const Rig& rig() const { return rig_; }
  // Of the blob in the recording, or made from the cameras where it has none.
  const std::array<RayTable, kSensorsMax>& rays() const { return rays_; }
  bool has_blob() const { return !blob_.empty(); }
  std::span<const std::byte> blob() const { return blob_; }

  // From now on this sensor alone is in the rig and its frames are read. The Error names those that
  // there are. Before the first next(), or rewind() afterwards.
  Result<void> take_only(std::string_view sensor);

  // What the train had said by the last frame that next() gave; nullptr: nothing yet. Only after
  // listen_to_vehicle(), for taking it allocates.
  void listen_to_vehicle();
  const VehicleStateMessage* vehicle() const { return vehicle_ ? &*vehicle_ : nullptr; }

  // For whoever has the calibration from elsewhere: frees the blob, and rays() are empty from then.
  void drop_blob();

  // The zero of "seconds since the recording's start".
  HostTime start() const { return start_; }
  // What one slot must hold for any frame of this recording.
  std::size_t slot_bytes() const;

  // Frames of all sensors together by the file's summary; 0 where it does not tell.
  std::uint64_t stated_frame_count() const;

  // Fills `slot` (its bytes are the caller's, at least slot_bytes()). False at the end. An Error
  // names a damaged chunk or a frame that does not fit the rig; the next call goes on behind it.
  Result<bool> next(FrameSlot& slot);
  void rewind();
  // Goes on with the first chunk whose messages reach `time` or later (all, where times are not
  // indexed), so that what was recorded before is not unpacked.
  void seek(HostTime time);

 private:
  enum class Role : std::uint8_t { kNone, kInfo, kFirst, kSecond, kVehicle };
  struct ChannelRole {
    std::uint16_t channel_id = 0;
    Role role = Role::kNone;
    std::uint8_t sensor_index = 0;
  };

  RecordingReader(McapReader mcap, DamagePolicy policy);
  Result<void> take_blob();
  Result<void> take_own_channels();
  Result<void> take_foreign_channels();
  void add_foreign_sensor(const McapChannel& image_channel, const Camera& camera);
  const ChannelRole* find_role(std::uint16_t channel_id) const;
  Result<void> take_image(const McapMessage& message, const ChannelRole& role, FrameSlot& slot);

  McapReader mcap_;
  McapCursor cursor_;
  Rig rig_;
  std::vector<std::byte> blob_;
  std::array<RayTable, kSensorsMax> rays_{};
  std::vector<std::vector<PixelRay>> own_rays_;
  std::vector<ChannelRole> roles_;
  HostTime start_{};
  std::optional<FrameInfoMessage> info_;  // of the frame that is being put together
  std::uint8_t info_sensor_ = 0;
  bool has_first_ = false;
  std::optional<VehicleStateMessage> vehicle_;
};

}  // namespace wagonsight

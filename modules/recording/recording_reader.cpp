#include "recording/recording_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>

#include "recording/recording_writer.h"
#include "rig/blob.h"

namespace wagonsight {
namespace {

std::string_view value_of(const McapPairs& pairs, std::string_view key) {
  for (const auto& [known, value] : pairs)
    if (known == key) return value;
  return {};
}

bool has_schema(const McapReader& mcap, const McapChannel& channel, const RosSchema& schema) {
  const McapSchema* known = mcap.find_schema(channel.schema_id);
  return known != nullptr && known->name == schema.name && channel.message_encoding == "cdr";
}

std::string_view topic_folder(std::string_view topic) {
  return topic.substr(0, topic.rfind('/'));
}

// "/camera/depth/image_raw" is told as "camera_depth".
std::string sensor_name_of(std::string_view topic) {
  std::string name(topic_folder(topic));
  name.erase(0, name.find_first_not_of('/'));
  std::replace(name.begin(), name.end(), '/', '_');
  return name.empty() ? "camera" : name;
}

std::optional<PixelFormat> format_of(std::string_view encoding, SensorKind kind) {
  if (kind == SensorKind::kKinect)
    return encoding == "16UC1" || encoding == "mono16" ? std::optional(PixelFormat::kDepth16)
                                                       : std::nullopt;
  if (encoding == "mono8" || encoding == "8UC1") return PixelFormat::kGray8;
  if (encoding == "mono16" || encoding == "16UC1") return PixelFormat::kGray16;
  return std::nullopt;
}

// Rows without their padding, in this machine's byte order.
void copy_pixels(const ImageMessage& image, std::size_t row_bytes, bool swap,
                 std::span<std::byte> out) {
  for (std::size_t row = 0; row < image.height; ++row)
    std::memcpy(out.data() + row * row_bytes, image.data.data() + row * image.step, row_bytes);
  if (!swap) return;
  for (std::size_t i = 0; i + 1 < row_bytes * image.height; i += 2) std::swap(out[i], out[i + 1]);
}

}  // namespace

RecordingReader::RecordingReader(McapReader mcap, DamagePolicy policy)
    : mcap_(std::move(mcap)), cursor_(mcap_, policy) {}

Result<std::unique_ptr<RecordingReader>> RecordingReader::open(std::span<const std::byte> file,
                                                               DamagePolicy policy) {
  auto mcap = McapReader::open(file);
  if (!mcap) return tl::unexpected(mcap.error());
  std::unique_ptr<RecordingReader> reader(new RecordingReader(std::move(*mcap), policy));
  if (auto done = reader->take_blob(); !done) return tl::unexpected(done.error());
  auto taken = reader->has_blob() ? reader->take_own_channels() : reader->take_foreign_channels();
  if (!taken) return tl::unexpected(taken.error());
  const std::string_view start = reader->mcap_.metadata_value(kRecordingMetadata, "start_ns");
  std::int64_t start_ns = 0;
  if (std::from_chars(start.data(), start.data() + start.size(), start_ns).ec == std::errc{})
    reader->start_ = HostTime{Duration{start_ns}};
  return reader;
}

Result<void> RecordingReader::take_blob() {
  const auto attachment = mcap_.find_attachment(kRigAttachment);
  if (!attachment) return tl::unexpected(attachment.error());
  if (!attachment->has_value()) return {};
  // Where it lies in the file it need not be aligned.
  blob_.assign((*attachment)->data.begin(), (*attachment)->data.end());
  auto opened = open_blob(blob_);
  if (!opened)
    return fail(
        fmt::format("holds a calibration blob that cannot be used: {}", opened.error().message));
  rig_ = opened->rig;
  rays_ = opened->rays;
  return {};
}

void RecordingReader::drop_blob() {
  std::vector<std::byte>().swap(blob_);
  own_rays_.clear();
  rays_ = {};
}

Result<void> RecordingReader::take_own_channels() {
  for (const McapChannel& channel : mcap_.channels()) {
    const int sensor = find_sensor(rig_, value_of(channel.metadata, kSensorKey));
    if (sensor < 0) continue;
    ChannelRole role{.channel_id = channel.id, .sensor_index = static_cast<std::uint8_t>(sensor)};
    if (has_schema(mcap_, channel, frame_info_schema())) role.role = Role::kInfo;
    if (has_schema(mcap_, channel, image_schema()))
      role.role = value_of(channel.metadata, kStreamKey) == "right" ? Role::kSecond : Role::kFirst;
    if (role.role != Role::kNone) roles_.push_back(role);
  }
  return {};
}

void RecordingReader::add_foreign_sensor(const McapChannel& image_channel, const Camera& camera) {
  RigSensor sensor;
  sensor.name = Name(sensor_name_of(image_channel.topic));
  sensor.camera = camera;
  sensor.has_pose = false;
  roles_.push_back({.channel_id = image_channel.id,
                    .role = Role::kFirst,
                    .sensor_index = static_cast<std::uint8_t>(rig_.sensors.size())});
  own_rays_.push_back(make_ray_table(camera));
  rays_[rig_.sensors.size()] = own_rays_.back();
  rig_.sensors.push_back(sensor);
}

// Goes through the messages until every image and camera topic was seen once.
Result<void> RecordingReader::take_foreign_channels() {
  struct Seen {
    const McapChannel* channel = nullptr;
    bool is_camera = false, was_seen = false, is_depth = false;
    Camera camera;
  };
  std::vector<Seen> topics;
  for (const McapChannel& channel : mcap_.channels()) {
    const bool is_camera = has_schema(mcap_, channel, camera_info_schema());
    if (is_camera || has_schema(mcap_, channel, image_schema()))
      topics.push_back({.channel = &channel, .is_camera = is_camera, .camera = {}});
  }
  std::size_t unseen = topics.size();
  McapCursor cursor(mcap_, DamagePolicy::kSkip);
  McapMessage message;
  bool has_start = false;
  while (unseen > 0) {
    const auto more = cursor.next(message);
    if (!more || !*more) break;
    const auto topic = std::find_if(topics.begin(), topics.end(), [&](const Seen& seen) {
      return seen.channel->id == message.channel_id;
    });
    if (topic == topics.end() || topic->was_seen) continue;
    topic->was_seen = true;
    --unseen;
    if (topic->is_camera) {
      if (const auto info = decode_camera_info(message.data)) topic->camera = info->camera;
    } else if (const auto image = decode_image(message.data)) {
      topic->is_depth = image->encoding == "16UC1";
      if (!topic->is_depth) continue;
      start_ = has_start ? std::min(start_, image->stamp) : image->stamp;
      has_start = true;
    }
  }
  for (const Seen& image : topics) {
    if (!image.is_depth) continue;
    const auto camera = std::find_if(topics.begin(), topics.end(), [&](const Seen& other) {
      return other.is_camera && other.camera.fx > 0 &&
             topic_folder(other.channel->topic) == topic_folder(image.channel->topic);
    });
    const bool is_usable = camera != topics.end() && camera->camera.width > 0 &&
                           camera->camera.height > 0 &&
                           static_cast<std::size_t>(camera->camera.width) <=
                               kImagePixelsMax / static_cast<std::size_t>(camera->camera.height);
    if (is_usable && !rig_.sensors.full()) add_foreign_sensor(*image.channel, camera->camera);
  }
  if (rig_.sensors.empty())
    return fail(
        "holds no depth images with a camera (sensor_msgs/Image 16UC1 and CameraInfo in the same "
        "folder of topics); record these topics too");
  return {};
}

Result<void> RecordingReader::take_only(std::string_view sensor) {
  const int index = find_sensor(rig_, sensor);
  if (index < 0) {
    std::string names;
    for (const RigSensor& known : rig_.sensors)
      names += fmt::format("{}{}", names.empty() ? "" : ", ", known.name.view());
    return fail(fmt::format("has no sensor {}; it has {}", sensor, names));
  }
  const RigSensor chosen = rig_.sensors[static_cast<std::size_t>(index)];
  rig_.sensors.clear();
  rig_.sensors.push_back(chosen);
  rays_[0] = rays_[static_cast<std::size_t>(index)];
  std::erase_if(roles_, [&](const ChannelRole& role) {
    return role.role != Role::kVehicle && role.sensor_index != index;
  });
  for (ChannelRole& role : roles_) role.sensor_index = 0;
  return {};
}

const RecordingReader::ChannelRole* RecordingReader::find_role(std::uint16_t channel_id) const {
  for (const ChannelRole& role : roles_)
    if (role.channel_id == channel_id) return &role;
  return nullptr;
}

std::size_t RecordingReader::slot_bytes() const {
  std::size_t bytes = 0;
  for (const RigSensor& sensor : rig_.sensors) {
    const std::size_t pixels = static_cast<std::size_t>(sensor.camera.width) *
                               static_cast<std::size_t>(sensor.camera.height);
    const std::size_t images = sensor.kind == SensorKind::kStereo ? 2 : 1;
    bytes = std::max(bytes, pixels * images * sizeof(std::uint16_t));
  }
  return bytes;
}

std::uint64_t RecordingReader::stated_frame_count() const {
  std::uint64_t frames = 0;
  for (const ChannelRole& role : roles_)
    if (role.role == Role::kFirst) frames += mcap_.stated_message_count(role.channel_id);
  return frames;
}

void RecordingReader::rewind() {
  cursor_.rewind();
  info_.reset();
  has_first_ = false;
  vehicle_.reset();
}

void RecordingReader::seek(HostTime time) {
  rewind();
  const auto ns =
      static_cast<std::uint64_t>(std::max<std::int64_t>(0, time.time_since_epoch().count()));
  for (std::size_t i = 0; i < mcap_.segments().size(); ++i) {
    const McapSegment& segment = mcap_.segments()[i];
    if (segment.is_chunk && segment.end_time < ns) continue;
    cursor_.seek(i);
    return;
  }
  cursor_.seek(mcap_.segments().size());
}

void RecordingReader::listen_to_vehicle() {
  for (const McapChannel& channel : mcap_.channels())
    if (has_schema(mcap_, channel, vehicle_state_schema()))
      roles_.push_back({.channel_id = channel.id, .role = Role::kVehicle});
}

Result<void> RecordingReader::take_image(const McapMessage& message, const ChannelRole& role,
                                         FrameSlot& slot) {
  const RigSensor& sensor = rig_.sensors[role.sensor_index];
  const auto image = decode_image(message.data);
  if (!image)
    return fail(fmt::format("has a frame of sensor {} that is not a sensor_msgs/Image",
                            sensor.name.view()));
  const auto format = format_of(image->encoding, sensor.kind);
  if (!format)
    return fail(
        fmt::format("has a frame of sensor {} in the encoding \"{}\"; known are 16UC1 for "
                    "depth, mono8 and mono16 for stereo",
                    sensor.name.view(), image->encoding));
  const Camera& camera = sensor.camera;
  const std::size_t row_bytes = std::size_t{image->width} * bytes_per_pixel(*format);
  if (image->width != static_cast<std::uint32_t>(camera.width) ||
      image->height != static_cast<std::uint32_t>(camera.height) || image->step < row_bytes)
    return fail(
        fmt::format("has a frame of sensor {} of {} x {} pixels where its camera has {} x "
                    "{}",
                    sensor.name.view(), image->width, image->height, camera.width, camera.height));
  const std::size_t image_bytes = row_bytes * image->height;
  const std::size_t at = role.role == Role::kSecond ? image_bytes : 0;
  if (at + image_bytes > slot.bytes.size())
    return fail(fmt::format("has a frame of {} bytes and the slot holds {}", at + image_bytes,
                            slot.bytes.size()));
  const bool swap = image->is_big_endian && bytes_per_pixel(*format) == 2;
  copy_pixels(*image, row_bytes, swap, slot.bytes.subspan(at, image_bytes));

  const bool has_info = info_ && info_sensor_ == role.sensor_index;
  const auto logged = HostTime{Duration{static_cast<std::int64_t>(message.log_time)}};
  slot.sensor_index = role.sensor_index;
  slot.sequence = message.sequence;
  slot.arrival = has_info ? info_->arrival : logged;
  slot.instant = image->stamp;
  slot.device_ticks = has_info ? info_->device_ticks : 0;
  slot.damaged = has_info && info_->damaged;
  slot.format = *format;
  slot.width = camera.width;
  slot.height = camera.height;
  return {};
}

Result<bool> RecordingReader::next(FrameSlot& slot) {
  McapMessage message;
  while (true) {
    const auto more = cursor_.next(message);
    if (!more) {
      info_.reset();
      has_first_ = false;
      return tl::unexpected(more.error());
    }
    if (!*more) return false;
    const ChannelRole* role = find_role(message.channel_id);
    if (role == nullptr) continue;
    if (role->role == Role::kVehicle) {
      if (auto heard = decode_vehicle_state(message.data)) vehicle_ = std::move(heard);
      continue;
    }
    if (role->role == Role::kInfo) {
      info_ = decode_frame_info(message.data);
      info_sensor_ = role->sensor_index;
      has_first_ = false;
      continue;
    }
    const bool is_stereo = rig_.sensors[role->sensor_index].kind == SensorKind::kStereo;
    const bool completes = !is_stereo || role->role == Role::kSecond;
    // Half a stereo pair whose other half was in a damaged chunk is no frame.
    if (role->role == Role::kSecond && (!has_first_ || slot.sensor_index != role->sensor_index))
      continue;
    if (auto taken = take_image(message, *role, slot); !taken) return tl::unexpected(taken.error());
    has_first_ = !completes;
    if (!completes) continue;
    info_.reset();
    return true;
  }
}

}  // namespace wagonsight

#include "recording/recording_writer.h"

#include <fmt/format.h>

#include <algorithm>

#include "base/check.h"
#include "recording/ros_messages.h"
#include "rig/blob.h"
#include "rig/stereo_pair.h"

namespace wagonsight {
namespace {

// ROS 2 allows letters, digits and underscores between the slashes of a topic.
std::string topic_part(std::string_view name) {
  std::string part(name);
  std::replace_if(
      part.begin(), part.end(),
      [](unsigned char c) { return c >= 0x80 || (std::isalnum(c) == 0 && c != '_'); }, '_');
  return part;
}

std::string_view encoding_of(PixelFormat format) {
  switch (format) {
    case PixelFormat::kDepth16:
      return "16UC1";
    case PixelFormat::kGray8:
      return "mono8";
    case PixelFormat::kGray16:
      return "mono16";
    case PixelFormat::kRgb8:
      return "rgb8";
  }
  return "";
}

// MCAP's times are unsigned; a simulation's first frames may be dated before its zero. The exact
// times are in the messages.
std::uint64_t unsigned_ns(HostTime time) {
  return static_cast<std::uint64_t>(std::max<std::int64_t>(0, time.time_since_epoch().count()));
}

std::size_t image_count(const RigSensor& sensor) {
  return sensor.kind == SensorKind::kStereo ? 2 : 1;
}

// Image 1 is the right one of a pair. What is recorded of a pair with lenses are its images as they
// come, before rectification.
CameraInfoMessage camera_info_of(const RigSensor& sensor, std::size_t image_index) {
  CameraInfoMessage info;
  info.camera = sensor.camera;
  info.baseline = image_index == 1 ? sensor.stereo.baseline : 0;
  if (!sensor.stereo.has_lenses()) return info;
  const StereoGeometry& stereo = sensor.stereo;
  const auto pair = rectified_pair(stereo.left, stereo.right, stereo.X_LR);
  if (!pair) return info;
  info.rectified = pair->camera;
  info.camera = image_index == 1 ? stereo.right : stereo.left;
  const Rigid& X_IS = image_index == 1 ? pair->X_RS : pair->X_LS;
  info.R = X_IS.rotation.toRotationMatrix().transpose();
  return info;
}

}  // namespace

RecordingWriter::RecordingWriter(std::unique_ptr<McapWriter> mcap, const Rig& rig)
    : mcap_(std::move(mcap)), rig_(rig) {
  scratch_.reserve_bytes(1024);
}

Result<std::unique_ptr<RecordingWriter>> RecordingWriter::create(ByteSink& sink, const Rig& rig,
                                                                 const RecordingOptions& options) {
  auto mcap = McapWriter::create(sink, options.mcap);
  if (!mcap) return tl::unexpected(mcap.error());
  std::unique_ptr<RecordingWriter> writer(new RecordingWriter(std::move(*mcap), rig));

  McapMetadata about{std::string(kRecordingMetadata), options.provenance};
  about.values.emplace_back("start_ns", std::to_string(options.start.time_since_epoch().count()));
  if (auto done = writer->mcap_->add_metadata(about); !done) return tl::unexpected(done.error());
  const std::vector<std::byte> blob = pack_blob(rig);
  const McapAttachment attachment{.name = std::string(kRigAttachment),
                                  .media_type = "application/x-wagonsight-rig",
                                  .log_time = unsigned_ns(options.start),
                                  .create_time = 0,
                                  .data = blob};
  if (auto done = writer->mcap_->add_attachment(attachment); !done)
    return tl::unexpected(done.error());
  for (const McapAttachment& other : options.attachments)
    if (auto done = writer->mcap_->add_attachment(other); !done)
      return tl::unexpected(done.error());

  const auto schemas = writer->add_schemas();
  if (!schemas) return tl::unexpected(schemas.error());
  for (const RigSensor& sensor : rig.sensors)
    if (auto done = writer->add_sensor(sensor, *schemas); !done)
      return tl::unexpected(done.error());
  if (options.has_vehicle)
    if (auto done = writer->add_vehicle(); !done) return tl::unexpected(done.error());
  return writer;
}

Result<void> RecordingWriter::add_vehicle() {
  const RosSchema& schema = vehicle_state_schema();
  const auto id = mcap_->add_schema(schema.name, "ros2msg", schema.text);
  if (!id) return tl::unexpected(id.error());
  const auto channel =
      mcap_->add_channel(*id, "/vehicle/state", "cdr", {{"offered_qos_profiles", ""}});
  if (!channel) return tl::unexpected(channel.error());
  vehicle_ = *channel;
  return {};
}

Result<RecordingWriter::SchemaIds> RecordingWriter::add_schemas() {
  SchemaIds ids;
  const auto add = [&](const RosSchema& schema, std::uint16_t& id) -> Result<void> {
    const auto added = mcap_->add_schema(schema.name, "ros2msg", schema.text);
    if (!added) return tl::unexpected(added.error());
    id = *added;
    return {};
  };
  if (auto done = add(image_schema(), ids.image); !done) return tl::unexpected(done.error());
  if (auto done = add(camera_info_schema(), ids.camera_info); !done)
    return tl::unexpected(done.error());
  if (auto done = add(frame_info_schema(), ids.frame_info); !done)
    return tl::unexpected(done.error());
  return ids;
}

Result<RecordingWriter::Stream> RecordingWriter::add_stream(const RigSensor& sensor,
                                                            std::string_view stream,
                                                            const SchemaIds& schemas) {
  const std::string name(sensor.name.view());
  const std::string base = fmt::format("/{}/{}", topic_part(name), stream);
  const McapPairs metadata{{"offered_qos_profiles", ""},
                           {std::string(kSensorKey), name},
                           {std::string(kStreamKey), std::string(stream)}};
  const auto image = mcap_->add_channel(schemas.image, base + "/image_raw", "cdr", metadata);
  if (!image) return tl::unexpected(image.error());
  const auto info = mcap_->add_channel(schemas.camera_info, base + "/camera_info", "cdr", metadata);
  if (!info) return tl::unexpected(info.error());
  return Stream{*image, *info, camera_info_of(sensor, stream == "right" ? 1 : 0)};
}

Result<void> RecordingWriter::add_sensor(const RigSensor& sensor, const SchemaIds& schemas) {
  const std::string name(sensor.name.view());
  SensorChannels channels;
  const auto info =
      mcap_->add_channel(schemas.frame_info, "/" + topic_part(name) + "/frame_info", "cdr",
                         {{"offered_qos_profiles", ""},
                          {std::string(kSensorKey), name},
                          {std::string(kStreamKey), "info"}});
  if (!info) return tl::unexpected(info.error());
  channels.frame_info = *info;
  const bool is_stereo = sensor.kind == SensorKind::kStereo;
  const auto first = add_stream(sensor, is_stereo ? "left" : "depth", schemas);
  if (!first) return tl::unexpected(first.error());
  channels.streams[0] = *first;
  if (is_stereo) {
    const auto second = add_stream(sensor, "right", schemas);
    if (!second) return tl::unexpected(second.error());
    channels.streams[1] = *second;
  }
  sensors_.push_back(channels);
  return {};
}

void RecordingWriter::write_image(const FrameSlot& slot, std::size_t image_index,
                                  McapMessage message) {
  const RigSensor& sensor = rig_.sensors[slot.sensor_index];
  const Stream& stream = sensors_[slot.sensor_index].streams[image_index];
  ImageMessage image{
      .stamp = slot.instant,
      .frame_id = sensor.name.view(),
      .width = static_cast<std::uint32_t>(slot.width),
      .height = static_cast<std::uint32_t>(slot.height),
      .encoding = encoding_of(slot.format),
      .data = slot.bytes.subspan(image_index * slot.image_bytes(), slot.image_bytes())};
  image.step = static_cast<std::uint32_t>(static_cast<std::size_t>(slot.width) *
                                          bytes_per_pixel(slot.format));
  scratch_.clear();
  encode_image_header(image, scratch_);
  message.channel_id = stream.image;
  mcap_->add_message(message, {scratch_.bytes(), image.data});

  scratch_.clear();
  CameraInfoMessage info = stream.camera;
  info.stamp = slot.instant;
  info.frame_id = sensor.name.view();
  encode_camera_info(info, scratch_);
  message.channel_id = stream.camera_info;
  mcap_->add_message(message, {scratch_.bytes()});
}

Result<void> RecordingWriter::write(const VehicleStateMessage& state) {
  WS_CHECK(vehicle_.has_value(), "no channel for the vehicle among %zu sensors", sensors_.size());
  scratch_.clear();
  encode_vehicle_state(state, scratch_);
  mcap_->add_message({.channel_id = *vehicle_,
                      .log_time = unsigned_ns(state.stamp),
                      .publish_time = unsigned_ns(state.stamp),
                      .data = {}},
                     {scratch_.bytes()});
  return mcap_->end_group();
}

Result<void> RecordingWriter::write(const FrameSlot& slot) {
  WS_CHECK(slot.sensor_index < sensors_.size(), "sensor %d of %zu", slot.sensor_index,
           sensors_.size());
  const RigSensor& sensor = rig_.sensors[slot.sensor_index];
  WS_CHECK(slot.image_bytes() * image_count(sensor) <= slot.bytes.size(), "%dx%d in %zu bytes",
           slot.width, slot.height, slot.bytes.size());
  McapMessage message{.channel_id = sensors_[slot.sensor_index].frame_info,
                      .sequence = slot.sequence,
                      .log_time = unsigned_ns(slot.arrival),
                      .publish_time = unsigned_ns(slot.instant),
                      .data = {}};
  scratch_.clear();
  encode_frame_info({.instant = slot.instant,
                     .sensor = sensor.name.view(),
                     .arrival = slot.arrival,
                     .device_ticks = slot.device_ticks,
                     .sequence = slot.sequence,
                     .damaged = slot.damaged},
                    scratch_);
  mcap_->add_message(message, {scratch_.bytes()});
  for (std::size_t i = 0; i < image_count(sensor); ++i) write_image(slot, i, message);
  ++frame_count_;
  return mcap_->end_group();
}

}  // namespace wagonsight

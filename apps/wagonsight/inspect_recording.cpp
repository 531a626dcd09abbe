#include <fmt/format.h>

#include <algorithm>

#include "inspect.h"
#include "progress.h"
#include "recording_file.h"

namespace wagonsight {
namespace {

struct Seen {
  std::uint64_t frames = 0, damaged = 0;
  HostTime first{}, last{};
  Duration longest_gap{};
  std::uint64_t missing = 0;  // by the device's own counter
  std::uint32_t sequence = 0;
};

void see(const FrameSlot& slot, Seen& seen) {
  if (seen.frames > 0) {
    seen.longest_gap = std::max(seen.longest_gap, Duration(slot.instant - seen.last));
    if (slot.sequence > seen.sequence) seen.missing += slot.sequence - seen.sequence - 1;
  } else {
    seen.first = slot.instant;
  }
  seen.last = slot.instant;
  seen.sequence = slot.sequence;
  seen.damaged += slot.damaged ? 1 : 0;
  ++seen.frames;
}

Report report_sensor(const RigSensor& sensor, const Seen& seen) {
  const double span_s = to_seconds(seen.last - seen.first);
  Report report;
  report["name"] = std::string(sensor.name.view());
  report["kind"] = sensor.kind == SensorKind::kStereo ? "stereo" : "kinect";
  report["width"] = sensor.camera.width;
  report["height"] = sensor.camera.height;
  report["frames"] = seen.frames;
  report["rate_hz"] = seen.frames > 1 ? static_cast<double>(seen.frames - 1) / span_s : 0.0;
  report["damaged"] = seen.damaged;
  report["missing"] = seen.missing;
  report["longest_gap_s"] = to_seconds(seen.longest_gap);
  report["has_pose"] = sensor.has_pose;
  return report;
}

}  // namespace

Result<Report> inspect_recording(const std::string& path) {
  auto recording = open_recording(path, DamagePolicy::kSkip);
  if (!recording) return tl::unexpected(recording.error());
  RecordingReader& reader = *recording->reader;
  std::vector<Seen> seen(reader.rig().sensors.size());
  std::vector<std::byte> memory(reader.slot_bytes());
  FrameSlot slot;
  slot.bytes = memory;
  std::uint64_t frames = 0;
  {
    Progress progress("frames", reader.stated_frame_count());
    while (true) {
      const auto more = reader.next(slot);
      if (!more) return fail(fmt::format("{} {}", path, more.error().message));
      if (!*more) break;
      see(slot, seen[slot.sensor_index]);
      progress.update(++frames);
    }
  }
  const McapReader& mcap = reader.mcap();
  std::uint64_t unpacked = 0;
  for (const McapSegment& segment : mcap.segments())
    unpacked += segment.is_chunk ? segment.uncompressed_size : segment.length;
  HostTime end = reader.start();
  for (const Seen& sensor : seen)
    if (sensor.frames > 0) end = std::max(end, sensor.last);

  Report report;
  report["file"] = path;
  report["kind"] = "recording";
  report["whole"] = mcap.complete() && reader.cursor().damaged_chunks() == 0;
  report["trouble"] = recording_trouble(*recording);
  report["bytes"] = recording->file->bytes().size();
  report["unpacked_bytes"] = unpacked;
  report["chunks"] = mcap.segments().size();
  report["frames"] = frames;
  report["seconds"] = to_seconds(end - reader.start());
  report["library"] = mcap.library();
  for (const McapMetadata& metadata : mcap.metadata())
    for (const auto& [key, value] : metadata.values) report["origin"][key] = value;
  for (std::size_t i = 0; i < seen.size(); ++i)
    report["sensors"].push_back(report_sensor(reader.rig().sensors[i], seen[i]));
  for (const McapChannel& channel : mcap.channels()) report["topics"].push_back(channel.topic);
  report["attachments"] = mcap.attachment_names();
  return report;
}

}  // namespace wagonsight

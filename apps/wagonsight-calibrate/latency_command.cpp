// How late each sensor stamps its frames, from a recording in which a ball is waved.
#include <fmt/format.h>

#include <array>
#include <cmath>

#include "calibrate/stamp_delays.h"
#include "calibrate/waved_ball.h"
#include "commands.h"
#include "linux/files.h"
#include "recording/recording_reader.h"
#include "recording/sample_images.h"
#include "rig/blob.h"
#include "stereo/rectify_sensor.h"
#include "stereo/stereo_to_depth.h"

namespace wagonsight {
namespace {

// Follows the ball before one sensor of the recording.
class Follower {
 public:
  static Result<std::unique_ptr<Follower>> create(const RigSensor& sensor, RayTable rays,
                                                  double ball_radius) {
    std::unique_ptr<Follower> follower(new Follower(sensor));
    if (sensor.kind == SensorKind::kStereo) {
      auto rectification = rectification_of(sensor);
      if (!rectification) return tl::unexpected(rectification.error());
      const Camera camera = rectification->camera;
      follower->stereo_ = std::make_unique<StereoToDepth>(std::move(*rectification));
      auto workspace = StereoWorkspace::create(camera.width, camera.height, {});
      if (!workspace)
        return fail(fmt::format("sensor {}: {}", sensor.name.view(), workspace.error().message));
      follower->workspace_ = std::move(*workspace);
    }
    if (rays.empty()) {
      follower->own_rays_ = make_ray_table(sensor.camera);
      rays = follower->own_rays_;
    }
    follower->ball_ = std::make_unique<WavedBall>(sensor, rays, ball_radius);
    follower->track_.name = std::string(sensor.name.view());
    return follower;
  }

  void learn(const FrameSlot& slot) {
    if (const auto image = depth_of(slot)) ball_->learn(*image);
  }
  void finish_learning() { ball_->finish_learning(); }
  void follow(const FrameSlot& slot) {
    const auto image = depth_of(slot);
    if (!image) return;
    if (const auto seen = ball_->find(*image))
      track_.samples.push_back(
          {to_seconds(slot.instant.time_since_epoch()), sensor_.X_WS * seen->p_S});
  }
  const TargetTrack& track() const { return track_; }

 private:
  explicit Follower(const RigSensor& sensor) : sensor_(sensor) {}

  // The whole of a stereo pair is matched each time: a few minutes in the depot are cheap.
  std::optional<DepthImage> depth_of(const FrameSlot& slot) {
    const DepthImage image =
        stereo_ == nullptr ? slot.depth() : stereo_->convert(slot, true, {}, *workspace_);
    const bool fits = image.width == sensor_.camera.width && image.height == sensor_.camera.height;
    return fits && !slot.damaged ? std::optional(image) : std::nullopt;
  }

  RigSensor sensor_;
  std::vector<PixelRay> own_rays_;
  std::unique_ptr<StereoToDepth> stereo_;
  std::unique_ptr<StereoWorkspace> workspace_;
  std::unique_ptr<WavedBall> ball_;
  TargetTrack track_;
};

// By the recording's sensors, which must be of the blob.
Result<std::vector<std::unique_ptr<Follower>>> followers_of(const Rig& recorded,
                                                            const RigBlob& blob,
                                                            const LatencyArguments& arguments) {
  std::vector<std::unique_ptr<Follower>> followers;
  for (const RigSensor& sensor : recorded.sensors) {
    const int index = find_sensor(blob.rig, sensor.name.view());
    if (index < 0)
      return fail(
          fmt::format("{} has no sensor {}, which the recording has; give the blob of the "
                      "wagon that was recorded",
                      arguments.rig, sensor.name.view()));
    const auto known = static_cast<std::size_t>(index);
    if (!blob.rig.sensors[known].has_pose)
      return fail(fmt::format("{}: sensor {} has no pose; calibrate the rig first", arguments.rig,
                              sensor.name.view()));
    auto follower =
        Follower::create(blob.rig.sensors[known], blob.rays[known], arguments.ball_radius);
    if (!follower) return tl::unexpected(follower.error());
    followers.push_back(std::move(*follower));
  }
  return followers;
}

// Calls `visit` with every frame of the recording, from its beginning.
template <class Visit>
Result<void> for_each_frame(RecordingReader& reader, const Visit& visit) {
  std::vector<std::uint64_t> memory((reader.slot_bytes() + 7) / 8);
  FrameSlot slot;
  slot.bytes = std::as_writable_bytes(std::span(memory));
  reader.rewind();
  while (true) {
    const auto more = reader.next(slot);
    if (!more) return tl::unexpected(more.error());
    if (!*more) return {};
    visit(slot);
  }
}

Result<std::vector<TargetTrack>> follow_ball(RecordingReader& reader,
                                             std::vector<std::unique_ptr<Follower>>& followers) {
  const auto frames = count_frames(reader);
  if (!frames) return tl::unexpected(frames.error());
  // A dozen or two of each sensor, spread over the recording.
  constexpr std::uint64_t kImagesLearned = 20;
  const std::uint64_t every =
      std::max<std::uint64_t>(1, *frames / followers.size() / kImagesLearned);
  std::array<std::uint64_t, kSensorsMax> count{};
  auto read = for_each_frame(reader, [&](const FrameSlot& slot) {
    if (count[slot.sensor_index]++ % every == 0) followers[slot.sensor_index]->learn(slot);
  });
  if (!read) return tl::unexpected(read.error());
  for (auto& follower : followers) follower->finish_learning();
  read = for_each_frame(reader,
                        [&](const FrameSlot& slot) { followers[slot.sensor_index]->follow(slot); });
  if (!read) return tl::unexpected(read.error());
  std::vector<TargetTrack> tracks;
  for (const auto& follower : followers) tracks.push_back(follower->track());
  return tracks;
}

void print_kind(const Rig& rig, std::span<const TargetTrack> tracks,
                std::span<const SensorDelay> delays, SensorKind kind, const char* name) {
  double sum = 0, squares = 0;
  int count = 0;
  for (std::size_t i = 0; i < tracks.size(); ++i) {
    const auto index = static_cast<std::size_t>(find_sensor(rig, tracks[i].name));
    if (rig.sensors[index].kind != kind) continue;
    sum += delays[i].delay_s;
    squares += delays[i].delay_s * delays[i].delay_s;
    ++count;
  }
  if (count == 0) return;
  const double mean = sum / count;
  fmt::print("{}: {:.1f} ms, {:.1f} ms among {} of them\n", name, mean * 1e3,
             1e3 * std::sqrt(std::max(0.0, squares / count - mean * mean)), count);
}

void print_delays(const Rig& rig, std::span<const TargetTrack> tracks,
                  std::span<const SensorDelay> delays) {
  fmt::print("{:<12} {:>10} {:>10} {:>10} {:>12} {:>10}\n", "sensor", "late ms", "sigma ms",
             "sightings", "left over mm", "offset mm");
  for (std::size_t i = 0; i < tracks.size(); ++i)
    fmt::print("{:<12} {:>10.2f} {:>10.2f} {:>10} {:>12.1f} {:>10.1f}\n", tracks[i].name,
               delays[i].delay_s * 1e3, delays[i].sigma_s * 1e3, delays[i].samples,
               delays[i].rms_m * 1e3, delays[i].offset_W.norm() * 1e3);
  print_kind(rig, tracks, delays, SensorKind::kKinect, "Kinects");
  print_kind(rig, tracks, delays, SensorKind::kStereo, "stereo cameras");
}

}  // namespace

Result<void> run_latency(const LatencyArguments& arguments) {
  const auto file = MappedFile::open(arguments.rig);
  if (!file) return tl::unexpected(file.error());
  auto blob = open_blob(file->bytes());
  if (!blob) return fail(fmt::format("{}: {}", arguments.rig, blob.error().message));
  const auto recorded = MappedFile::open(arguments.recording, MappedFile::Pages::kOnDemand);
  if (!recorded) return tl::unexpected(recorded.error());
  auto reader = RecordingReader::open(recorded->bytes(), DamagePolicy::kSkip);
  const auto in_recording = [&](const Error& error) {
    return fail(fmt::format("{}: {}", arguments.recording, error.message));
  };
  if (!reader) return in_recording(reader.error());
  auto followers = followers_of((*reader)->rig(), *blob, arguments);
  if (!followers) return tl::unexpected(followers.error());
  const auto tracks = follow_ball(**reader, *followers);
  if (!tracks) return in_recording(tracks.error());
  const auto delays = estimate_stamp_delays(*tracks);
  if (!delays) return in_recording(delays.error());
  print_delays(blob->rig, *tracks, *delays);
  for (RigSensor& sensor : blob->rig.sensors) sensor.stamp_delay = {};
  for (std::size_t i = 0; i < tracks->size(); ++i) {
    const auto index = static_cast<std::size_t>(find_sensor(blob->rig, (*tracks)[i].name));
    blob->rig.sensors[index].stamp_delay = {(*delays)[i].delay_s, (*delays)[i].sigma_s};
  }
  // The rays lie in the file that may be the one to be replaced: they are made anew.
  return replace_file_keeping_previous(arguments.out, pack_blob(blob->rig));
}

}  // namespace wagonsight

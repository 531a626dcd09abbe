#include <fmt/format.h>

#include <algorithm>

#include "pipeline/state.h"
#include "pipeline/stereo_lane.h"

// The stereo cameras' part of the pipeline: from pairs to depth images.
namespace wagonsight {

StereoWorkspace* WorkerSpace::stereo_of(const Camera& camera) const {
  for (const auto& space : stereo)
    if (space->fits(camera.width, camera.height)) return space.get();
  return nullptr;
}

Result<void> Pipeline::State::add_stereo(std::size_t sensor_index, RayTable rays,
                                         const Wagon& wagon) {
  const RigSensor& sensor = rig.sensors[sensor_index];
  auto rectification = rectification_of(sensor);
  if (!rectification) return tl::unexpected(rectification.error());
  const Camera& camera = rectification->camera;
  for (WorkerSpace& space : spaces) {
    if (space.stereo_of(camera) != nullptr) continue;
    auto made = StereoWorkspace::create(camera.width, camera.height, options.stereo.matcher);
    if (!made) return fail(fmt::format("sensor {}: {}", sensor.name.view(), made.error().message));
    space.stereo.push_back(std::move(*made));
  }
  StereoToDepthOptions own = options.stereo;
  own.far_m = std::min(own.far_m, sensor.trim_far + 1.0);
  // One whole image at a time: the cameras take turns.
  own.whole_phase_s = own.whole_every_s * static_cast<double>(sensor_index) /
                      static_cast<double>(rig.sensors.size());
  lanes[sensor_index].stereo = std::make_unique<StereoToDepth>(std::move(*rectification), own);
  lanes[sensor_index].stereo->set_exposure_mask(exposure_mask(sensor, rays, wagon));
  return {};
}

SensorFrame Pipeline::State::matched(std::size_t sensor_index, const SensorFrame& pair, bool whole,
                                     WorkerSpace& space) {
  if (pair.state != FrameState::kPresent || pair.slot == nullptr) return pair;
  SensorLane& lane = lanes[sensor_index];
  gather_regions(sensor_index, space.regions);
  const DepthImage image = lane.stereo->convert(*pair.slot, whole, space.regions.span(),
                                                *space.stereo_of(lane.stereo->camera()));
  if (image.pixels == nullptr) return {FrameState::kUnusable, nullptr, pair.skew};
  lane.depth_slot = *pair.slot;
  lane.depth_slot.format = PixelFormat::kDepth16;
  lane.depth_slot.bytes = lane.stereo->depth_bytes();
  return {FrameState::kPresent, &lane.depth_slot, pair.skew};
}

// The background takes one vote a quarter of a second, so that no more whole images are needed.
bool Pipeline::State::learns_from(std::size_t sensor_index, const SensorFrame& pair) {
  constexpr double kVote_s = 0.2;
  SensorLane& lane = lanes[sensor_index];
  if (pair.slot == nullptr || !lane.extractor->learning()) return false;
  if (to_seconds(pair.slot->instant - lane.learned_at) < kVote_s) return false;
  lane.learned_at = pair.slot->instant;
  return true;
}

// Feedback is the last FrameSet's data and nothing else.
void Pipeline::State::gather_regions(std::size_t sensor_index,
                                     BoundedVector<PixelRect>& regions) const {
  regions.clear();
  const SensorLane& lane = lanes[sensor_index];
  for (const Blob& blob : lane.foreground->blobs)
    (void)regions.try_push_back({blob.u_min, blob.v_min, blob.u_max + 1, blob.v_max + 1});
  const SensorView& view = lane.extractor->view();
  for (const Track& track : tracker.tracks()) {
    if (!track.told) continue;
    const Box& box = track.person.box;
    PixelRect rect{view.width(), view.height(), 0, 0};
    bool behind = false;
    for (int corner = 0; corner < 8; ++corner) {
      const auto side = [&](int axis) { return (corner >> axis & 1) != 0 ? 0.5 : -0.5; };
      const double reach = std::max(box.size[0], box.size[1]);  // whichever way it is turned
      const Eigen::Vector3f p_W(static_cast<float>(box.center[0] + side(0) * reach),
                                static_cast<float>(box.center[1] + side(1) * reach),
                                static_cast<float>(box.center[2] + side(2) * box.size[2]));
      const auto at = view.project_anywhere(p_W);
      behind = behind || !at;
      if (!at) continue;
      const auto u = static_cast<int>(std::clamp(at->u, -1.0F, static_cast<float>(view.width())));
      const auto v = static_cast<int>(std::clamp(at->v, -1.0F, static_cast<float>(view.height())));
      rect = {std::min(rect.x0, u), std::min(rect.y0, v), std::max(rect.x1, u + 1),
              std::max(rect.y1, v + 1)};
    }
    rect = {std::max(rect.x0, 0), std::max(rect.y0, 0), std::min(rect.x1, view.width()),
            std::min(rect.y1, view.height())};
    if (!behind && !rect.empty()) (void)regions.try_push_back(rect);
  }
}

}  // namespace wagonsight

#include "pipeline/pipeline.h"

#include <fmt/format.h>

#include <algorithm>

#include "pipeline/seen_share.h"
#include "pipeline/state.h"

namespace wagonsight {

Result<std::unique_ptr<Pipeline>> Pipeline::create(const Rig& rig,
                                                   std::array<RayTable, kSensorsMax> rays,
                                                   const Wagon& wagon,
                                                   const PipelineOptions& options) {
  if (rig.sensors.empty())
    return fail("the rig has no sensor, so there is nothing to watch with; add one to it");
  auto state = std::make_unique<State>(rig, wagon, options);
  const ForegroundOptions foreground{options.leaf_m,
                                     options.voxel_m,
                                     options.noise_sigmas,
                                     options.blob_area_min_m2,
                                     options.learning_s,
                                     options.first_background_s,
                                     options.without_background,
                                     options.evidence_nodes};
  for (std::size_t i = 0; i < rig.sensors.size(); ++i) {
    const RigSensor& sensor = rig.sensors[i];
    if (rays[i].empty()) {
      state->own_rays.push_back(make_ray_table(sensor.camera));
      rays[i] = state->own_rays.back();
    }
    if (sensor.kind == SensorKind::kStereo)
      if (auto added = state->add_stereo(i, rays[i], wagon); !added)
        return tl::unexpected(added.error());
    auto extractor =
        ForegroundExtractor::create(sensor, rays[i], wagon, foreground, state->spaces[0].blobs);
    if (!extractor)
      return fail(fmt::format("sensor {}: {}", sensor.name.view(), extractor.error().message));
    state->lanes[i].extractor = std::move(*extractor);
    state->lanes[i].foreground = std::make_unique<Foreground>(
        static_cast<std::size_t>(sensor.camera.width * sensor.camera.height));
    state->lanes[i].foreground->sensor_index = static_cast<std::uint8_t>(i);
  }
  state->all_rays = rays;
  state->order_parts();
  return std::unique_ptr<Pipeline>(new Pipeline(std::move(state)));
}

Result<std::unique_ptr<Pipeline>> Pipeline::create_fitting(const Rig& rig,
                                                           std::array<RayTable, kSensorsMax> rays,
                                                           const Wagon& wagon,
                                                           PipelineOptions& options) {
  constexpr double kLeafMax_m = 0.10;
  constexpr double kLeafStep_m = 0.005;
  while (true) {
    auto pipeline = create(rig, rays, wagon, options);
    if (pipeline || options.leaf_m + kLeafStep_m > kLeafMax_m) return pipeline;
    options.leaf_m += kLeafStep_m;
  }
}

Pipeline::Pipeline(std::unique_ptr<State> state) : state_(std::move(state)) {}
Pipeline::~Pipeline() = default;

namespace {

// Where everything is a shape at hand, one look must do.
TrackOptions track_options(const PipelineOptions& options) {
  TrackOptions tracking;
  if (options.without_background) tracking.confirm_hits = 1;
  return tracking;
}

}  // namespace

Pipeline::State::State(const Rig& the_rig, const Wagon& wagon, const PipelineOptions& the_options)
    : rig(the_rig),
      options(the_options),
      fusion(the_rig, the_options.voxel_m),
      visibility(the_rig, wagon.inside),
      detector(wagon.inside),
      tracker(wagon, track_options(the_options)),
      situation(wagon) {
  if (the_options.without_background)
    upright_shapes = std::make_unique<UprightShapes>(wagon.inside);
  const std::size_t workers = options.runner == nullptr ? 1 : options.runner->workers();
  for (std::size_t i = 0; i < workers; ++i) spaces.emplace_back(options.voxel_m);
}

WorkerSpace::WorkerSpace(double voxel_m)
    : blobs(std::make_shared<BlobWorkspace>(voxel_m)), regions(kTracksMax + kBlobsMax) {}

// Whoever is free takes the next part: a long one last would leave the others waiting.
void Pipeline::State::order_parts() {
  for (const bool is_stereo : {true, false})
    for (std::size_t i = 0; i < rig.sensors.size(); ++i)
      if ((lanes[i].stereo != nullptr) == is_stereo) parts.push_back(i);
}

// Algorithm 1 of the paper, and from its fused cloud to who is where.
const PeopleFrame& Pipeline::process(const FrameSet& frames) {
  State& now = *state_;
  now.begin(frames);
  now.watch(frames);        // each sensor for itself: to depth, and lines 4 to 14
  now.fuse(now.depth);      // line 18: all foregrounds of the instant in one cloud
  now.find_people(frames);  // detect, describe, track
  now.judge_situation();    // zones, seats, doors, events
  return now.frame;
}

void Pipeline::State::begin(const FrameSet& frames) {
  if (!started) start = frames.instant;
  started = true;
  frame.time = to_seconds(frames.instant - start);
  frame.skews.clear();
  for (std::size_t i = 0; i < rig.sensors.size(); ++i)
    if (frames.sensors[i].state == FrameState::kPresent)
      frame.skews.push_back({rig.sensors[i].name, to_milliseconds(frames.sensors[i].skew)});
  stage_begin = ticks();
}

void Pipeline::State::watch(const FrameSet& frames) {
  depth = frames;
  run_parts(options.runner, parts.size(), [&](std::size_t part, std::size_t worker) {
    const std::size_t sensor_index = parts[part];
    const Duration begin = ticks();
    to_depth(sensor_index, frames.sensors[sensor_index], spaces[worker]);
    const Duration middle = ticks();
    extract(sensor_index, spaces[worker]);
    lanes[sensor_index].took = {middle - begin, ticks() - middle};
  });
  Duration to_depth_time{}, extract_time{};
  for (std::size_t i = 0; i < rig.sensors.size(); ++i) {
    to_depth_time += lanes[i].took[0];
    extract_time += lanes[i].took[1];
  }
  stage_times[static_cast<std::size_t>(Stage::kToDepth)] = to_depth_time;
  stage_times[static_cast<std::size_t>(Stage::kExtract)] = extract_time;
  stage_begin = ticks();
}

// Stereo: rectify, match. From here on every sensor is a depth image.
void Pipeline::State::to_depth(std::size_t sensor_index, const SensorFrame& taken,
                               WorkerSpace& space) {
  if (lanes[sensor_index].stereo != nullptr)
    depth.sensors[sensor_index] =
        matched(sensor_index, taken, learns_from(sensor_index, taken), space);
}

// Trim, change, blobs, downsample, to the world. A sensor that has no frame at this instant
// contributes nothing, and nothing waits for it.
void Pipeline::State::extract(std::size_t sensor_index, WorkerSpace& space) {
  views[sensor_index] = {};
  const SensorFrame& image = depth.sensors[sensor_index];
  const FrameSlot* slot = depth_slot(image);
  if (slot == nullptr) return;
  SensorLane& lane = lanes[sensor_index];
  lane.extractor->use(space.blobs);
  const auto noise =
      lane.stereo != nullptr ? lane.stereo->noise() : std::span<const std::uint8_t>{};
  lane.extractor->extract(slot->depth(), slot->instant, *lane.foreground, noise);
  views[sensor_index] = {lane.foreground.get(), options.compensate_skew ? image.skew : Duration{}};
}

void Pipeline::State::fuse(const FrameSet& frames) {
  gather_motion_hints();
  cloud = &fusion.fuse({views.data(), rig.sensors.size()}, {hints.data(), hints.size()});
  if (upright_shapes) cloud = &upright_shapes->select(*cloud);
  visibility.update(frames);
  finish_stage(Stage::kFuse);
}

void Pipeline::State::find_people(const FrameSet& frames) {
  const auto expected = tracker.predict(to_seconds(frames.instant - start));
  const auto detections = detector.detect(*cloud, expected);
  const auto shapes = describer.describe(*cloud, detector.labels(), detections);
  tracker.update(detections, shapes, visibility);
  tell_people();
  finish_stage(Stage::kPeople);
}

void Pipeline::State::judge_situation() {
  situation.update(frame, visibility, {doors.data(), doors.size()});
  finish_stage(Stage::kSituation);
}

// Feedback is the last FrameSet's data and nothing else.
void Pipeline::State::gather_motion_hints() {
  constexpr float kReach = 0.5F;  // metres: arms and legs move with the body
  hints.clear();
  for (const Track& track : tracker.tracks())
    if (track.told)
      hints.push_back({static_cast<float>(track.person.position[0]),
                       static_cast<float>(track.person.position[1]), kReach,
                       static_cast<float>(track.person.velocity[0]),
                       static_cast<float>(track.person.velocity[1])});
}

void Pipeline::State::tell_people() {
  frame.people.clear();
  for (const Track& track : tracker.tracks())
    if (track.told && !frame.people.try_push_back(track.person)) break;
  std::sort(frame.people.begin(), frame.people.end(),
            [](const Person& a, const Person& b) { return a.id < b.id; });
  for (Person& person : frame.people)
    for (ViewAttributes& view : person.views)
      view.visible_share = seen_share(person.box, rig.sensors[view.sensor_index], view.image_box);
}

void Pipeline::State::finish_stage(Stage stage) {
  if (ticker == nullptr) return;
  const Duration now = ticker();
  stage_times[static_cast<std::size_t>(stage)] = now - stage_begin;
  stage_begin = now;
}

void Pipeline::learn(const FrameSet& frames) {
  for (std::size_t i = 0; i < state_->rig.sensors.size(); ++i) {
    const bool is_stereo = state_->lanes[i].stereo != nullptr;
    const SensorFrame frame = is_stereo
                                  ? state_->matched(i, frames.sensors[i], true, state_->spaces[0])
                                  : frames.sensors[i];
    if (const FrameSlot* slot = depth_slot(frame))
      state_->lanes[i].extractor->learn(slot->depth(), slot->instant);
  }
}

void Pipeline::finish_learning() {
  for (std::size_t i = 0; i < state_->rig.sensors.size(); ++i)
    state_->lanes[i].extractor->finish_learning();
}

void Pipeline::hear_doors(std::span<const DoorState> doors) {
  state_->doors.clear();
  for (const DoorState door : doors)
    if (!state_->doors.try_push_back(door)) return;
}

void Pipeline::set_start(HostTime start) {
  state_->start = start;
  state_->started = true;
}

std::span<const FusedPoint> Pipeline::fused_points() const {
  if (state_->cloud == nullptr) return {};
  return state_->cloud->points.span();
}

const Occupancy& Pipeline::occupancy() const {
  return state_->situation.occupancy();
}

double Pipeline::background_share(std::size_t sensor_index) const {
  if (sensor_index >= state_->rig.sensors.size()) return 0;
  return state_->lanes[sensor_index].extractor->background_share();
}

bool Pipeline::learning() const {
  for (std::size_t i = 0; i < state_->rig.sensors.size(); ++i)
    if (state_->lanes[i].extractor->learning()) return true;
  return false;
}

DepthImage Pipeline::depth_image(std::size_t sensor_index) const {
  if (sensor_index >= state_->rig.sensors.size()) return {};
  const FrameSlot* slot = depth_slot(state_->depth.sensors[sensor_index]);
  return slot == nullptr ? DepthImage{} : slot->depth();
}

RayTable Pipeline::rays(std::size_t sensor_index) const {
  return sensor_index < kSensorsMax ? state_->all_rays[sensor_index] : RayTable{};
}

const StereoReport* Pipeline::stereo_report(std::size_t sensor_index) const {
  if (sensor_index >= state_->rig.sensors.size()) return nullptr;
  const StereoToDepth* stereo = state_->lanes[sensor_index].stereo.get();
  return stereo == nullptr ? nullptr : &stereo->report();
}

void Pipeline::set_ticker(Ticker ticker) {
  state_->ticker = ticker;
}

const std::array<Duration, kStageCount>& Pipeline::last_stage_times() const {
  return state_->stage_times;
}

}  // namespace wagonsight

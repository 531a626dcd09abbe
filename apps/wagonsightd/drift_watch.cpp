#include "drift_watch.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "linux/files.h"
#include "linux/threads.h"

namespace wagonsight {
namespace {

constexpr Duration kSamplePeriod = std::chrono::milliseconds(500);
constexpr Duration kPoll = std::chrono::milliseconds(200);
constexpr int kNice = 19;
constexpr float kMargin = 0.15F;  // metres about a person's box: coats, bags and what was missed
// After ten minutes in which somebody was always in view the wagon is learned around the people.
constexpr int kWaitsMax = 1200;
constexpr std::size_t kModelBytesMax = std::size_t{16} << 20;

// The upright box that holds a person, down to the floor.
KeepOut keep_out(const Box& box) {
  const double c = std::abs(std::cos(box.yaw)), s = std::abs(std::sin(box.yaw));
  const auto x = static_cast<float>(c * box.size[0] + s * box.size[1]) / 2 + kMargin;
  const auto y = static_cast<float>(s * box.size[0] + c * box.size[1]) / 2 + kMargin;
  const auto at = [&](std::size_t k) { return static_cast<float>(box.center[k]); };
  const float top = at(2) + static_cast<float>(box.size[2]) / 2 + kMargin;
  return {{at(0) - x, at(1) - y, 0.0F}, {at(0) + x, at(1) + y, top}};
}

}  // namespace

DriftWatch::DriftWatch(const Rig& rig, const std::array<RayTable, kSensorsMax>& rays,
                       std::string model_path, const std::array<std::uint8_t, 32>& blob_sha256)
    : rig_(rig), rays_(rays), model_path_(std::move(model_path)), blob_sha256_(blob_sha256) {
  for (std::size_t i = 0; i < rig_.sensors.size(); ++i) {
    samples_[i] = std::make_unique<Sample>();
    const Camera& camera = rig_.sensors[i].camera;
    samples_[i]->readings.resize(DepthGrid{camera.width, camera.height}.size());
  }
}

DriftWatch::~DriftWatch() {
  stop();
}

void DriftWatch::start() {
  thread_ = std::thread([this] { run(); });
}

void DriftWatch::stop() {
  {
    const std::scoped_lock lock(mutex_);
    stop_ = true;
  }
  wake_.notify_all();
  if (thread_.joinable()) thread_.join();
}

void DriftWatch::offer(const FrameSet& set, const Pipeline& pipeline, const PeopleFrame& people) {
  if (pipeline.learning()) return;
  for (std::size_t i = 0; i < rig_.sensors.size(); ++i) {
    Sample* sample = samples_[i].get();
    if (set.instant - sample->taken < kSamplePeriod || sample->full.load(std::memory_order_acquire))
      continue;
    const DepthImage depth = pipeline.depth_image(i);
    const DepthGrid grid{depth.width, depth.height};
    if (depth.pixels == nullptr || grid.size() != sample->readings.size()) continue;
    wagonsight::sample(grid, depth, sample->readings);
    sample->people.clear();
    for (const Person& person : people.people) sample->people.push_back(keep_out(person.box));
    sample->taken = set.instant;
    sample->full.store(true, std::memory_order_release);
  }
}

void DriftWatch::run() {
  name_this_thread("drift");
  (void)make_this_thread_nice(kNice);
  open_model();
  tell();
  std::unique_lock lock(mutex_);
  while (!stop_) {
    lock.unlock();
    for (std::size_t i = 0; i < rig_.sensors.size(); ++i) take(i);
    lock.lock();
    wake_.wait_for(lock, kPoll, [this] { return stop_; });
  }
}

void DriftWatch::take(std::size_t sensor) {
  Sample* sample = samples_[sensor].get();
  if (!sample->full.load(std::memory_order_acquire)) return;
  const bool learns = monitor_->sensor(sensor).state() == SensorDrift::State::kLearning;
  // The wagon is best learned while nobody is in it.
  const bool waits = learns && !sample->people.empty() && waits_ < kWaitsMax;
  waits_ += waits ? 1 : 0;
  const bool told = !waits && monitor_->add(sensor, sample->readings,
                                            {sample->people.begin(), sample->people.end()});
  sample->full.store(false, std::memory_order_release);
  if (!told) return;
  keep_model();
  tell();
}

void DriftWatch::tell() {
  now_.alarm = monitor_->alarm();
  now_.text = std::string_view(monitor_->text());
  shared_.store(now_);
}

void DriftWatch::note(std::string_view text) {
  now_.note = text;
  ++now_.notes;
}

void DriftWatch::open_model() {
  StaticModel model;
  if (!model_path_.empty()) {
    const auto text = read_file(model_path_, kModelBytesMax);
    auto read = text ? parse_static_model(std::as_bytes(std::span(*text)))
                     : Result<StaticModel>(tl::unexpected(text.error()));
    if (read && read->blob_sha256 == blob_sha256_) {
      model = std::move(*read);
      model_kept_ = std::none_of(model.views.begin(), model.views.end(),
                                 [](const auto& view) { return view.depth_m.empty(); });
    } else if (read) {
      note("The calibration is new; the static wagon is learned for it.");
    } else {
      note(fmt::format("The static wagon of this calibration is learned now and kept as {}.",
                       model_path_));
    }
  }
  model.blob_sha256 = blob_sha256_;
  monitor_ = std::make_unique<DriftMonitor>(rig_, rays_, model);
}

// Once, when all views that can be learned are.
void DriftWatch::keep_model() {
  if (model_kept_ || model_path_.empty()) return;
  for (std::size_t i = 0; i < rig_.sensors.size(); ++i)
    if (monitor_->sensor(i).state() == SensorDrift::State::kLearning) return;
  model_kept_ = true;
  const auto written = write_file_durably(model_path_, format_static_model(monitor_->model()));
  note(written ? fmt::format("The static wagon was learned and kept as {}.", model_path_)
               : "The static wagon is kept in memory only: " + written.error().message);
}

}  // namespace wagonsight

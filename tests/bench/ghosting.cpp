#include <fmt/format.h>

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <memory>
#include <optional>
#include <vector>

#include "bench/capture_bench.h"
#include "capture/frame_set_builder.h"
#include "pipeline/pipeline.h"
#include "rig/ray_table.h"
#include "simulate/body.h"
#include "simulate/room.h"
#include "simulate/simulation.h"
#include "support/scene_text.h"

namespace wagonsight::bench {
namespace {

using Eigen::Vector3d;

// ---- the true surface

struct Nearest {
  double distance = 1e9;  // metres, positive outside
  Vector3d normal = Vector3d::Zero();
};

// To first order: f / |grad f|. Frustums have no ends.
std::optional<Nearest> nearest_on(const Part& part, const Vector3d& p_W) {
  const Vector3d local = part.axes.transpose() * (p_W - part.centre);
  const Vector3d x = local.cwiseQuotient(part.half);
  double f = 0;
  Vector3d gradient;
  if (part.shape == Part::Shape::kEllipsoid) {
    const double r = x.norm();
    if (r < 1e-6) return std::nullopt;
    f = r - 1;
    gradient = x.cwiseQuotient(part.half) / r;
  } else if (part.shape == Part::Shape::kCone) {
    const double r = x.head<2>().norm();
    if (std::abs(x.z()) > 1 || r < 1e-6) return std::nullopt;
    f = r - (1 + part.taper * x.z());
    gradient = {x.x() / part.half.x() / r, x.y() / part.half.y() / r, -part.taper / part.half.z()};
  } else {
    return std::nullopt;
  }
  const double steep = gradient.norm();
  return Nearest{f / steep, part.axes * gradient / steep};
}

// A union's distance is the least of its parts'.
Nearest nearest_on(const Parts& parts, const Vector3d& p_W) {
  Nearest best;
  for (const Part& part : parts)
    if (const auto one = nearest_on(part, p_W); one && one->distance < best.distance) best = *one;
  return best;
}

// ---- how far along the way one sensor's points lie beside it

// Least squares of the one shift along the way that brings points onto the surface.
struct Shift {
  double weighted = 0, weight = 0;
  int points = 0;

  void add(const Nearest& nearest, const Vector3d& way) {
    const double across = nearest.normal.dot(way);
    weighted += across * nearest.distance;
    weight += across * across;
    ++points;
  }
  bool is_known() const { return points >= 150 && weight >= 40; }
  double metres() const { return weighted / weight; }
};

struct Figures {
  std::vector<double> apart_m;  // of the two surfaces that lie farthest apart, an instant each
  double off_sum = 0;           // |distance| of all points to the true surface
  std::size_t off_count = 0;
};

// What one person's points of one instant say. Points farther off are of something else.
void measure(std::span<const FusedPoint> cloud, const Parts& parts, const Vector3d& way,
             std::size_t sensor_count, Figures& figures) {
  constexpr double kReach = 0.12;
  std::array<Shift, kSensorsMax> shifts{};
  for (const FusedPoint& point : cloud) {
    const Vector3d p_W(static_cast<double>(point.x), static_cast<double>(point.y),
                       static_cast<double>(point.z));
    const Nearest nearest = nearest_on(parts, p_W);
    if (std::abs(nearest.distance) > kReach) continue;
    figures.off_sum += std::abs(nearest.distance);
    ++figures.off_count;
    for (std::size_t i = 0; i < sensor_count; ++i)
      if ((point.sensors >> i & 1U) != 0) shifts[i].add(nearest, way);
  }
  double low = 1e9, high = -1e9;
  int known = 0;
  for (std::size_t i = 0; i < sensor_count; ++i) {
    if (!shifts[i].is_known()) continue;
    ++known;
    low = std::min(low, shifts[i].metres());
    high = std::max(high, shifts[i].metres());
  }
  if (known >= 2) figures.apart_m.push_back(high - low);
}

// ---- the scene

// Two people who walk to and fro along the wagon, each on a side of the aisle, and four Kinects as
// the paper mounts them, `apart_s` between the phases of one and the next.
std::string scene_text(double speed, double apart_s) {
  using namespace wagonsight::testing;
  std::string text = wagon_text(6.0) + door_text("north", 2.35, 3.65);
  constexpr std::array<const char*, 4> kPlaces{"0.08, 0.08, 2.3", "5.92, 0.08, 2.3",
                                               "5.92, 2.62, 2.3", "0.08, 2.62, 2.3"};
  constexpr std::array<const char*, 4> kLooks{"3.3, 1.9, 0.3", "2.7, 1.9, 0.3", "2.7, 0.8, 0.3",
                                              "3.3, 0.8, 0.3"};
  for (std::size_t i = 0; i < 4; ++i)
    text += sensor_text(fmt::format("k{}", i), "kinect", kPlaces[i], kLooks[i],
                        fmt::format("phase_ms = {}", 1e3 * apart_s * static_cast<double>(i)));
  constexpr int kWays = 12;
  for (int who = 0; who < 2; ++who) {
    text += passenger_text(who == 0 ? "A" : "B", "") +
            act_text(2 + 0.8 * who, "enter", "door = 'north'");
    for (int way = 0; way < kWays; ++way)
      text += act_text(3.5 + way * 3.4 / speed, "walk",
                       fmt::format("to = [{}, {}]\nspeed = {}", (way + who) % 2 == 0 ? 1.1 : 4.9,
                                   who == 0 ? 0.9 : 1.8, speed));
  }
  return text;
}

struct Run {
  Figures with, without;
  double speed_sum = 0;
  std::size_t speed_count = 0;
  double spread_ms = 0;  // of the skews, the mean of the instants
  std::size_t sets = 0;
};

class Ghosting {
 public:
  static Result<Run> run(double speed, double apart_s, const GhostingOptions& options) {
    const auto scene = parse_scene(scene_text(speed, apart_s), "ghosting");
    if (!scene) return tl::unexpected(scene.error());
    Ghosting ghosting(*scene, options);
    for (const bool compensates : {true, false}) {
      PipelineOptions pipeline;
      pipeline.compensate_skew = compensates;
      auto made = Pipeline::create(ghosting.rig_, ghosting.rays_, wagon_of(*scene), pipeline);
      if (!made) return tl::unexpected(made.error());
      ghosting.pipelines_[compensates ? 0 : 1] = std::move(*made);
    }
    ghosting.play(speed);
    return ghosting.run_;
  }

 private:
  Ghosting(const Scene& scene, const GhostingOptions& options)
      : rig_(rig_of(scene)),
        simulation_(scene, options.seed),
        world_(scene, options.seed),
        end_(from_seconds(options.seconds)),
        pool_(kSlots, simulation_.device(0).slot_bytes()) {
    std::array<double, kSensorsMax> rates{};
    for (std::size_t i = 0; i < rig_.sensors.size(); ++i) {
      rates[i] = rig_.sensors[i].rate_hz;
      own_rays_.push_back(make_ray_table(rig_.sensors[i].camera));
      rays_[i] = own_rays_.back();
    }
    builder_ =
        std::make_unique<FrameSetBuilder>(pool_, std::span(rates).first(rig_.sensors.size()));
  }

  void play(double speed) {
    FrameSet set;
    std::size_t sensor = 0;
    while (simulation_.upcoming(sensor).arrival < end_) {
      FrameSlot* slot = pool_.acquire();
      simulation_.next(*slot);
      const HostTime now = slot->arrival;
      while (builder_->next(now, set)) judge(set, speed);
      builder_->add(slot);
      while (builder_->next(now, set)) judge(set, speed);
    }
  }

  void judge(const FrameSet& set, double speed) {
    for (auto& pipeline : pipelines_) (void)pipeline->process(set);
    constexpr double kBegin_s = 6;  // by then everybody is inside and followed
    if (to_seconds(set.instant.time_since_epoch()) < kBegin_s) return;
    world_.truth_at(set.instant, truth_);
    Duration earliest = Duration::max(), latest = Duration::min();
    for (std::size_t i = 0; i < rig_.sensors.size(); ++i) {
      if (set.sensors[i].state != FrameState::kPresent) continue;
      earliest = std::min(earliest, set.sensors[i].skew);
      latest = std::max(latest, set.sensors[i].skew);
    }
    run_.spread_ms += to_milliseconds(latest - earliest);
    ++run_.sets;
    for (const Person& person : truth_.people) {
      const Vector3d v(person.velocity[0], person.velocity[1], 0);
      // Where somebody turns there is nothing to compensate, and no way to measure along.
      if (v.norm() < 0.9 * speed) continue;
      const std::size_t who = person.id - 1;
      Parts parts;
      clad(world_.figure(who), world_.pose_at(who, set.instant), 0, parts);
      run_.speed_sum += v.norm();
      ++run_.speed_count;
      const std::size_t n = rig_.sensors.size();
      measure(pipelines_[0]->fused_points(), parts, v.normalized(), n, run_.with);
      measure(pipelines_[1]->fused_points(), parts, v.normalized(), n, run_.without);
    }
  }

  static constexpr std::size_t kSlots = 41;  // as a replay of four sensors
  Rig rig_;
  std::vector<std::vector<PixelRay>> own_rays_;
  std::array<RayTable, kSensorsMax> rays_{};
  Simulation simulation_;
  World world_;
  HostTime end_;
  FramePool pool_;
  std::unique_ptr<FrameSetBuilder> builder_;
  std::array<std::unique_ptr<Pipeline>, 2> pipelines_;  // with compensation, without
  PeopleFrame truth_;
  Run run_;
};

std::string told(Figures& figures) {
  auto& apart = figures.apart_m;
  if (apart.empty() || figures.off_count == 0) return "nothing measured";
  double sum = 0;
  for (const double one : apart) sum += one;
  std::sort(apart.begin(), apart.end());
  return fmt::format("{:.1f} (p95 {:.1f}), points {:.1f} off",
                     1e3 * sum / static_cast<double>(apart.size()),
                     1e3 * apart[apart.size() * 95 / 100],
                     1e3 * figures.off_sum / static_cast<double>(figures.off_count));
}

}  // namespace

Result<void> run_ghosting(const GhostingOptions& options) {
  fmt::print(
      "Four Kinects; millimetres between the surfaces that lie farthest apart along the way\n");
  fmt::print("| walking at | skews spread | without compensation | with |\n|---|---|---|---|\n");
  // A quarter of a period between the phases is the widest that four sensors can be apart.
  constexpr double kQuarter_s = 1.0 / 120;
  for (const double apart_s : {0.0, kQuarter_s})
    for (const double speed : {1.2, 1.5}) {
      auto run = Ghosting::run(speed, apart_s, options);
      if (!run) return tl::unexpected(run.error());
      if (run->speed_count == 0) return fail("nobody walked; give it more seconds");
      fmt::print("| {:.2f} m/s | {:.1f} ms | {} | {} |\n",
                 run->speed_sum / static_cast<double>(run->speed_count),
                 run->spread_ms / static_cast<double>(run->sets), told(run->without),
                 told(run->with));
      std::fflush(stdout);
    }
  return {};
}

}  // namespace wagonsight::bench

#include "foreground/extractor.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>

#include "base/check.h"

namespace wagonsight {
namespace {

// Background is also kept this far outside of the inside, so that a wall or floor at its border is
// known with its noise.
constexpr double kMargin_m = 0.3;
constexpr double kGatherPeriod_s = 0.1;
// A blob below this is as likely flicker as a hand; persons are larger.
constexpr float kSmallBlob_m2 = 0.1F;
// Whatever stands is higher above the floor.
constexpr float kFloor_m = 0.10F;
// Rows above and below, and a word of 64 pixels to each side, in which a fragment is near.
constexpr int kNearRows = 16;
// Of the first background, in pixels looked at: a pixel's own reading, and those of its leaf's
// neighbours.
constexpr double kWorkPerPixel = 12;
// Learning counts at least so many rounds, however fast the clock runs.
constexpr std::uint32_t kRoundsMin = 5;

}  // namespace

Result<std::unique_ptr<ForegroundExtractor>> ForegroundExtractor::create(
    const RigSensor& sensor, RayTable rays, const Wagon& wagon, const ForegroundOptions& options,
    std::shared_ptr<BlobWorkspace> workspace) {
  const std::string name(sensor.name.view());
  if (sensor.camera.width <= 0 || sensor.camera.height <= 0 ||
      rays.size() != static_cast<std::size_t>(sensor.camera.width) *
                         static_cast<std::size_t>(sensor.camera.height)) {
    return fail(
        fmt::format("sensor {}: {} rays for an image of {} x {}: pack the calibration again", name,
                    rays.size(), sensor.camera.width, sensor.camera.height));
  }
  if (!(sensor.trim_near > 0 && sensor.trim_far > sensor.trim_near && sensor.trim_far < 30)) {
    return fail(fmt::format("sensor {}: trim_m = [{}, {}]: give two distances, 0 < near < far < 30",
                            name, sensor.trim_near, sensor.trim_far));
  }
  if (!(options.voxel_m >= 0.005 && options.voxel_m <= 0.5 && options.noise_sigmas > 0 &&
        options.noise_sigmas <= 10 && options.blob_area_min_m2 >= 0)) {
    return fail(
        "foreground: voxel_m must be 0.005 to 0.5, noise_sigmas 0 to 10, "
        "blob_area_min_m2 not negative");
  }
  const Eigen::Vector3d margin = Eigen::Vector3d::Constant(kMargin_m);
  auto grid = LeafGrid::cover(wagon.inside.min - margin, wagon.inside.max + margin, options.leaf_m);
  if (!grid) return fail(grid.error().message);
  if (workspace == nullptr) workspace = std::make_shared<BlobWorkspace>(options.voxel_m);
  return std::unique_ptr<ForegroundExtractor>(
      new ForegroundExtractor(sensor, rays, wagon, *grid, options, std::move(workspace)));
}

ForegroundExtractor::ForegroundExtractor(const RigSensor& sensor, RayTable rays, const Wagon& wagon,
                                         const LeafGrid& grid, const ForegroundOptions& options,
                                         std::shared_ptr<BlobWorkspace> workspace)
    : options_(options),
      view_(sensor, rays, wagon, grid, options.noise_sigmas),
      background_(view_, options.evidence_nodes),
      memory_(view_),
      blobs_(view_, options.blob_area_min_m2, kSmallBlob_m2, options.voxel_m, std::move(workspace)),
      foreground_((rays.size() + 63) / 64),
      unknown_(foreground_.capacity()),
      restless_(foreground_.capacity()),
      small_(foreground_.capacity()),
      rejected_(foreground_.capacity()),
      scratch_(foreground_.capacity()) {
  for (auto* bits : {&foreground_, &unknown_, &restless_, &small_, &rejected_, &scratch_}) {
    bits->resize(bits->capacity());
    std::fill(bits->begin(), bits->end(), std::uint64_t{0});
  }
}

void ForegroundExtractor::learn(DepthImage image, HostTime instant) {
  if (gathered_any_ && std::abs(to_seconds(instant - last_gathered_)) < kGatherPeriod_s) return;
  gathered_any_ = true;
  last_gathered_ = instant;
  background_.gather(view_, image);
}

void ForegroundExtractor::finish_learning() {
  if (!gathered_any_) return;
  background_.decide(view_);
  gathered_any_ = false;
  has_background_ = true;
  learning_ = false;
}

void ForegroundExtractor::extract(DepthImage image, HostTime instant, Foreground& out,
                                  std::span<const std::uint8_t> noise) {
  WS_CHECK(noise.empty() || noise.size() == image.pixel_count(), "noise of %zu pixels",
           noise.size());
  WS_CHECK(image.width == view_.width() && image.height == view_.height(), "image of %d x %d",
           image.width, image.height);
  if (options_.without_background) return extract_everything(image, out);
  const float frame_s =
      extracted_any_ ? static_cast<float>(to_seconds(instant - last_extracted_)) : 0.0F;
  extracted_any_ = true;
  last_extracted_ = instant;
  const float round_share = background_.advance(instant);
  out.background_known = has_background_;
  first_background_work_ = 0;
  if (!has_background_ && options_.first_background_s > 0) {
    return draw_first_background(image, frame_s, out);
  }
  if (!has_background_) {
    background_.assume(view_, image);
    memory_.distrust_edges(view_, image, 0, image.height);
    has_background_ = true;
  }
  background_.thresholds().classify(view_, background_.leaves(), image, foreground_.span(),
                                    unknown_.span());
  if (!noise.empty())
    background_.thresholds().forgive(view_, background_.leaves(), image, noise, foreground_.span(),
                                     unknown_.span());
  drop_masked(image);
  memory_.promote_moving(view_, image, frame_s, foreground_.span(), unknown_.span());
  drop_lonely();
  // Restless pixels belong to a body when sure ones do, but make none by themselves.
  memory_.set_aside(foreground_.span(), restless_.span());
  for (std::size_t word = 0; word < unknown_.size(); ++word) unknown_[word] |= restless_[word];
  blobs_.find(view_, image, foreground_.span(), unknown_.span(), rejected_.span(), out);
  remember(round_share);

  // Only what is no part of anybody is evidence for background.
  for (std::size_t word = 0; word < unknown_.size(); ++word) {
    unknown_[word] &= ~(out.mask[word] | restless_[word]);
    rejected_[word] |= restless_[word] & ~out.mask[word];
    if (rejected_[word] != 0 && near_somebody(word)) rejected_[word] = 0;
  }
  background_.observe_new(view_, image, unknown_.span(), rejected_.span());
  background_.observe_free(view_, image, round_share);
  const auto rounds_needed =
      std::clamp(static_cast<int>(options_.learning_s / 0.25), static_cast<int>(kRoundsMin), 200);
  background_.observe_empty(view_, image, round_share, rounds_needed);
  if (background_.rounds() >= static_cast<std::uint32_t>(rounds_needed)) learning_ = false;
}

std::size_t ForegroundExtractor::first_background_work_max(const SensorView& view, double frame_s,
                                                           double first_background_s) {
  // The first frame has none before it, and after a gap there is no hurry.
  const double share = std::clamp(frame_s / first_background_s, 0.01, 0.5);
  return static_cast<std::size_t>(share * kWorkPerPixel * static_cast<double>(view.pixel_count()));
}

void ForegroundExtractor::draw_first_background(DepthImage image, float frame_s, Foreground& out) {
  const auto work_max =
      first_background_work_max(view_, static_cast<double>(frame_s), options_.first_background_s);
  const int first_row = background_.assumed_rows();
  first_background_work_ = background_.assume_rows(view_, image, work_max);
  memory_.distrust_edges(view_, image, first_row, background_.assumed_rows());
  has_background_ = background_.assumed_rows() == image.height;
  out.clear();
}

// What rises above the floor's noise inside the wagon. Connected regions that are larger than any
// group of people are walls.
void ForegroundExtractor::extract_everything(DepthImage image, Foreground& out) {
  for (std::size_t word = 0; word < foreground_.size(); ++word)
    foreground_[word] = unknown_[word] = rejected_[word] = 0;
  for (std::size_t pixel = 0; pixel < image.pixel_count(); ++pixel) {
    const std::uint16_t raw = image.pixels[pixel];
    const RawInterval inside = view_.inside(pixel);
    if (raw < inside.first || raw > inside.last) continue;
    const Eigen::Vector3f p_W = view_.point_W(pixel, view_.depth().z(raw));
    if (p_W.z() < kFloor_m + view_.depth().sigma(raw)) continue;
    foreground_[pixel / 64] |= std::uint64_t{1} << (pixel % 64);
  }
  drop_masked(image);
  drop_lonely();
  blobs_.find(view_, image, foreground_.span(), unknown_.span(), rejected_.span(), out);
  out.background_known = true;
  learning_ = false;
}

std::size_t ForegroundExtractor::changed_pixels() const {
  std::size_t pixels = 0;
  for (const std::uint64_t word : foreground_) {
    pixels += static_cast<std::size_t>(std::popcount(word));
  }
  return pixels;
}

void ForegroundExtractor::remember(float round_share) {
  for (std::size_t word = 0; word < foreground_.size(); ++word) {
    scratch_[word] = foreground_[word] | restless_[word];
    small_[word] = scratch_[word] & ~blobs_.large_mask()[word];
    if (small_[word] != 0 && near_somebody(word)) small_[word] = 0;
  }
  memory_.observe(small_.span(), scratch_.span(), round_share);
}

// Fragments beside a large blob are parts of who is there; they tell nothing of the background.
bool ForegroundExtractor::near_somebody(std::size_t word) const {
  const auto large = blobs_.large_mask();
  const auto words = static_cast<std::ptrdiff_t>(large.size());
  for (int rows = -kNearRows; rows <= kNearRows; rows += kNearRows / 2) {
    const std::ptrdiff_t middle =
        static_cast<std::ptrdiff_t>(word) + rows * std::ptrdiff_t{view_.width()} / 64;
    for (std::ptrdiff_t i = middle - 1; i <= middle + 1; ++i) {
      if (i >= 0 && i < words && large[static_cast<std::size_t>(i)] != 0) return true;
    }
  }
  return false;
}

void ForegroundExtractor::drop_masked(DepthImage image) {
  if (!view_.has_masks()) return;
  for (std::size_t word = 0; word < foreground_.size(); ++word) {
    std::uint64_t rest = (foreground_[word] | unknown_[word]) & view_.maskable(word);
    for (; rest != 0; rest &= rest - 1) {
      const auto place = static_cast<std::size_t>(std::countr_zero(rest));
      const std::size_t pixel = word * 64 + place;
      if (!view_.masked(view_.point_W(pixel, view_.depth().z(image.pixels[pixel])))) continue;
      foreground_[word] &= ~(std::uint64_t{1} << place);
      unknown_[word] &= ~(std::uint64_t{1} << place);
    }
  }
}

// A pixel without a neighbour to its left or right, or none above or below, is a flying pixel.
void ForegroundExtractor::drop_lonely() {
  const auto width = static_cast<std::size_t>(view_.width());
  const std::size_t words = foreground_.size();
  const auto shifted = [&](std::size_t word, std::ptrdiff_t by) -> std::uint64_t {
    // The 64 pixels that begin `by` pixels after the word's own.
    const auto first = static_cast<std::ptrdiff_t>(word * 64) + by;
    const auto base = first >= 0 ? first / 64 : -((-first + 63) / 64);
    const auto offset = static_cast<unsigned>(first - base * 64);
    const auto at = [&](std::ptrdiff_t index) {
      return index < 0 || index >= static_cast<std::ptrdiff_t>(words)
                 ? std::uint64_t{0}
                 : foreground_[static_cast<std::size_t>(index)] |
                       unknown_[static_cast<std::size_t>(index)];
    };
    const std::uint64_t low = at(base) >> offset;
    return offset == 0 ? low : low | (at(base + 1) << (64 - offset));
  };
  const auto row = static_cast<std::ptrdiff_t>(width);
  for (std::size_t word = 0; word < words; ++word) {
    scratch_[word] = 0;
    if (foreground_[word] == 0) continue;
    const std::uint64_t across = shifted(word, -1) | shifted(word, 1);
    const std::uint64_t along = shifted(word, -row) | shifted(word, row);
    scratch_[word] = foreground_[word] & across & along;
  }
  std::swap(foreground_, scratch_);
}

}  // namespace wagonsight

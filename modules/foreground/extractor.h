#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "base/result.h"
#include "base/time.h"
#include "foreground/background.h"
#include "foreground/blob_finder.h"
#include "foreground/foreground.h"
#include "foreground/pixel_memory.h"
#include "foreground/sensor_view.h"
#include "frame/image.h"
#include "rig/ray_table.h"
#include "rig/rig.h"
#include "wagon/wagon.h"

namespace wagonsight {

// The user's choices; PipelineOptions has the same names.
struct ForegroundOptions {
  double leaf_m = 0.02;            // of the background octree, 0.01 to 0.10
  double voxel_m = 0.02;           // of the foreground's voxel grid
  double noise_sigmas = 3.0;       // a change must exceed this many sigmas
  double blob_area_min_m2 = 0.01;  // smaller blobs are noise
  double learning_s = 2.0;         // until a ray on which nothing comes back counts as empty
  // The first background is drawn up in about so many seconds, a few rows of each frame, so that no
  // frame costs more than a normal one; until then nothing is told. 0: from the first frame at
  // once.
  double first_background_s = 0;
  // Nothing is learned: all that stands in the wagon is foreground, but for the floor.
  bool without_background = false;
  std::size_t evidence_nodes = kEvidenceNodesMax;  // fewer where memory is scarce
};

// Lines 4 to 12 of the paper's Algorithm 1 for one sensor: from its depth image to what moved in
// it, against a background that it learns.
//
//   learn()* finish_learning()  or  load_background()       extract()*
//          evidence is weighed, nothing is told   ------->  foreground is told; the background
//          follows
//
// extract() may also be called first: the first frame is then taken for background until it is seen
// through, so that whoever was there appears as soon as he moves. One thread at a time; allocates
// in create(), save and load only.
class ForegroundExtractor {
 public:
  // `rays` must outlive the extractor (one a pixel, X_WS known). Extractors of one thread can share
  // a `workspace` (made for options.voxel_m); without one it makes its own. The Error says what
  // does not fit.
  static Result<std::unique_ptr<ForegroundExtractor>> create(
      const RigSensor& sensor, RayTable rays, const Wagon& wagon, const ForegroundOptions& options,
      std::shared_ptr<BlobWorkspace> workspace = nullptr);

  // Evidence only. Frames closer than a tenth of a second to the last one are skipped.
  void learn(DepthImage image, HostTime instant);
  // Makes what was gathered the background; rays on which nothing was are then known to be empty.
  void finish_learning();

  // The foreground of one frame. `image` has the sensor's size; `out` was made for its pixels.
  // Nothing is foreground in the very first frame when no background was learned, or while the
  // first background is drawn up. `noise` has a byte a pixel where readings are not all as
  // uncertain as their depth makes them: the standard deviation of each in 16ths of the sensor's
  // noise.
  void extract(DepthImage image, HostTime instant, Foreground& out,
               std::span<const std::uint8_t> noise = {});

  // True until learning_s of frames were extracted, or a background was learned or loaded.
  bool learning() const { return learning_; }
  // Share of the pixels whose background is known, 0..1. Looks at every pixel.
  double background_share() const { return background_.known_share(view_); }

  // The background as bytes, little-endian. Loading says what does not fit: another leaf size, box
  // or image size, or damage. Both allocate.
  std::vector<std::byte> save_background() const;
  Result<void> load_background(std::span<const std::byte> bytes);

  // Of the last frame: what drawing up the first background cost, in pixels that were looked at.
  std::size_t first_background_work() const { return first_background_work_; }
  // The most that it may be, but for the row with which it is reached.
  static std::size_t first_background_work_max(const SensorView& view, double frame_s,
                                               double first_background_s);
  // Of the last frame: pixels that differ from the background, before blobs.
  std::size_t changed_pixels() const;

  // From the next frame on; of the same voxel_m. Two threads must not be in one at a time.
  void use(const std::shared_ptr<BlobWorkspace>& workspace) { blobs_.use(workspace); }

  const Background& background() const { return background_; }
  const SensorView& view() const { return view_; }
  std::shared_ptr<BlobWorkspace> workspace() const { return blobs_.workspace(); }

 private:
  ForegroundExtractor(const RigSensor& sensor, RayTable rays, const Wagon& wagon,
                      const LeafGrid& grid, const ForegroundOptions& options,
                      std::shared_ptr<BlobWorkspace> workspace);
  void draw_first_background(DepthImage image, float frame_s, Foreground& out);
  void remember(float round_share);
  bool near_somebody(std::size_t word) const;
  void extract_everything(DepthImage image, Foreground& out);
  void drop_masked(DepthImage image);
  void drop_lonely();

  ForegroundOptions options_;
  SensorView view_;
  Background background_;
  PixelMemory memory_;
  BlobFinder blobs_;
  // A bit a pixel each; members, so that a frame allocates nothing.
  BoundedVector<std::uint64_t> foreground_, unknown_, restless_, small_, rejected_, scratch_;
  bool learning_ = true;
  bool has_background_ = false;
  bool gathered_any_ = false;
  std::size_t first_background_work_ = 0;
  HostTime last_gathered_{}, last_extracted_{};
  bool extracted_any_ = false;
};

}  // namespace wagonsight

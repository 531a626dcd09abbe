#pragma once

#include <cstdint>
#include <string>

#include "base/result.h"

// wagonsight-capture-bench: what the time of the frames costs and what it is worth.
namespace wagonsight::bench {

struct GhostingOptions {
  double seconds = 16;  // of each row of the table; the first 6 s are the way in and learning
  std::uint64_t seed = 1;
};
// Prints how far apart the surfaces lie that several Kinects give of a walking person, with and
// without the motion compensation. The Error: a scene that gives nothing to measure.
Result<void> run_ghosting(const GhostingOptions& options);

struct RecordOptions {
  double seconds = 15;
  std::string folder;      // for the recordings; they are left there
  std::string scene, rig;  // files; the rig's sensors are put behind the scene's
  std::uint64_t memory_mb = 64;
};
// Feeds frames that were drawn beforehand through the DepotRecorder in real time.
Result<void> run_record(const RecordOptions& options);

struct CompressOptions {
  std::string scene, rig;
};
// The processor time of packing alone, by zstd's level, without a disk.
Result<void> run_compress(const CompressOptions& options);

struct SkewOptions {
  int trials = 200;     // of each row of the table, at random phases
  double seconds = 60;  // of each trial, after half a minute in which the clock fits settle
  double drift_ppm = 50;
  double jitter_ms = 5;
  int readings = 15;  // of a Kinect's clock in a frame, as its driver takes them
  std::uint64_t seed = 1;
};
// Prints how alike in time the frames of a set are, and how well that is known: the paper's timer
// and barrier against hardware-timed grouping, in virtual time.
Result<void> run_skew(const SkewOptions& options);

}  // namespace wagonsight::bench

#include "bench/capture_bench.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdio>

int main(int argc, char** argv) {
  namespace bench = wagonsight::bench;
  CLI::App app{
      "wagonsight-capture-bench: what the time of frames is worth, and what recording costs"};
  app.require_subcommand(1);

  bench::GhostingOptions ghosting;
  auto* ghosting_command =
      app.add_subcommand("ghosting", "double surfaces of walking people in the fused cloud");
  ghosting_command->add_option("--seconds", ghosting.seconds, "of each row")->capture_default_str();
  ghosting_command->add_option("--seed", ghosting.seed)->capture_default_str();

  bench::RecordOptions record;
  record.scene = WAGONSIGHT_SOURCE_DIR "/config/scenes/walk.toml";
  record.rig = WAGONSIGHT_SOURCE_DIR "/config/rigs/six_stereo.toml";
  auto* record_command =
      app.add_subcommand("record", "ten sensors at full rate through the unit's recorder");
  record_command->add_option("--folder", record.folder, "where the recordings go")->required();
  record_command->add_option("--seconds", record.seconds)->capture_default_str();
  record_command->add_option("--memory-mb", record.memory_mb, "of frames that wait")
      ->capture_default_str();

  auto* compress_command = app.add_subcommand("compress", "processor time of packing, by level");

  bench::SkewOptions skew;
  auto* skew_command = app.add_subcommand(
      "skew", "timer and barrier, as the paper has it, against hardware-timed grouping");
  skew_command->add_option("--trials", skew.trials, "of each row")->capture_default_str();
  skew_command->add_option("--seconds", skew.seconds, "of each trial")->capture_default_str();
  skew_command->add_option("--drift-ppm", skew.drift_ppm, "at most")->capture_default_str();
  skew_command->add_option("--jitter-ms", skew.jitter_ms, "of arrivals")->capture_default_str();
  skew_command->add_option("--readings", skew.readings, "of a Kinect's clock in a frame")
      ->capture_default_str();
  skew_command->add_option("--seed", skew.seed)->capture_default_str();

  CLI11_PARSE(app, argc, argv);
  const auto done = *ghosting_command ? bench::run_ghosting(ghosting)
                    : *skew_command   ? bench::run_skew(skew)
                    : *record_command ? bench::run_record(record)
                                      : bench::run_compress({record.scene, record.rig});
  (void)compress_command;
  if (done) return 0;
  fmt::print(stderr, "{}\n", done.error().message);
  return 1;
}

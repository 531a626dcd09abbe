// wagonsight-calibrate: the commissioning tool.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <functional>

#include "commands.h"
#include "version.h"

namespace wagonsight {
namespace {

int run(int argc, char** argv) {
  CLI::App app{
      "wagonsight-calibrate finds where every camera of a wagon stands, and how well that is "
      "known."};
  app.set_version_flag("--version", fmt::format("wagonsight-calibrate {}", kVersionText));
  app.require_subcommand(1);

  DetectArguments detect;
  auto* detect_command =
      app.add_subcommand("detect", "find the chessboard's corners in images, one folder a sensor");
  detect_command->add_option("--images", detect.images, "folder that holds one folder per sensor")
      ->required();
  detect_command
      ->add_option("--board", detect.board, "BOARD.toml: rows, columns (inner corners), square_m")
      ->required();
  detect_command->add_option("--out", detect.out, "OBS.json")->required();

  ClickArguments click;
  auto* click_command = app.add_subcommand(
      "click", "a page in the browser where corners and targets are clicked by hand");
  click_command->add_option("--images", click.images, "folder that holds one folder per sensor")
      ->required();
  click_command->add_option("--board", click.board, "BOARD.toml")->required();
  click_command
      ->add_option("--observations", click.observations, "OBS.json; made when it is not there")
      ->required();
  click_command->add_option("--targets", click.targets,
                            "TARGETS.json; without it targets.json beside the observations");
  click_command->add_option("--sensors", click.sensors,
                            "SENSORS.toml: known intrinsics make the predicted corners exact");
  click_command->add_option("--solution", click.solution,
                            "SOLUTION.json, after a first solve: its intrinsics instead");
  click_command->add_option("--port", click.port, "of the page; 0 takes a free one")
      ->capture_default_str();

  SolveArguments solve;
  auto* solve_command =
      app.add_subcommand("solve", "bundle adjustment of all cameras and board poses");
  solve_command->add_option("--observations", solve.observations, "OBS.json")->required();
  solve_command->add_option("--sensors", solve.sensors, "SENSORS.toml")->required();
  solve_command->add_option("--out", solve.out, "SOLUTION.json")->required();

  solve_command->add_flag("--keep-all", solve.keep_all,
                          "leave no corner out, however badly it fits");

  solve_command->add_option("--report", solve.report,
                            "REPORT.html: the page that says how good it is");
  solve_command->add_option(
      "--images", solve.images,
      "the images' folder: they are shown in the report, and its NAME.depth hold "
      "the Kinects' depth images");

  ReportArguments report;
  auto* report_command =
      app.add_subcommand("report", "write the page of a solution anew, with its georeference");
  report_command->add_option("--solution", report.solution, "SOLUTION.json")->required();
  report_command->add_option("--images", report.images, "the images' folder");
  report_command->add_option("--out", report.out, "REPORT.html")->required();

  GeoreferenceArguments georeference;
  auto* georeference_command = app.add_subcommand(
      "georeference", "fit the similarity transform from the board to the world");
  georeference_command->add_option("--solution", georeference.solution, "SOLUTION.json")
      ->required();
  georeference_command->add_option("--targets", georeference.targets, "TARGETS.json")->required();
  georeference_command->add_option(
      "--markers", georeference.markers,
      "the tracker's file (DTrack text or JSON) for targets without \"world\"");
  georeference_command->add_option("--images", georeference.images,
                                   "the images' folder: in the Kinects' depth images of its "
                                   "NAME.depth a sphere is fitted to each clicked ball");
  georeference_command
      ->add_option("--ball-radius", georeference.ball_radius,
                   "in metres, of the balls of targets without \"radius_m\"")
      ->check(CLI::Range(0.005, 0.5));
  georeference_command->add_option("--out", georeference.out, "SOLUTION.json")->required();

  PackArguments pack;
  auto* pack_command = app.add_subcommand("pack", "write the calibration blob for the unit");
  pack_command->add_option("--solution", pack.solution, "SOLUTION.json")->required();
  pack_command->add_option("--out", pack.out, "RIG.blob")->required();

  LatencyArguments latency;
  auto* latency_command = app.add_subcommand(
      "latency", "how late each sensor stamps its frames, from a ball that is waved in view");
  latency_command->add_option("recording", latency.recording, "the recording (MCAP)")->required();
  latency_command->add_option("--rig", latency.rig, "RIG.blob: where the sensors are")->required();
  latency_command->add_option("--ball-radius", latency.ball_radius, "of the ball, in metres")
      ->required()
      ->check(CLI::Range(0.03, 0.5));
  latency_command->add_option("--out", latency.out, "RIG.blob with the delays")->required();

  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& success) {
    return app.exit(success);
  } catch (const CLI::ParseError& error) {
    app.exit(error);
    return 2;
  }
  const auto done = [&]() -> Result<void> {
    if (*detect_command) return run_detect(detect);
    if (*click_command) return run_click(click);
    if (*solve_command) return run_solve(solve);
    if (*report_command) return run_report(report);
    if (*georeference_command) return run_georeference(georeference);
    if (*latency_command) return run_latency(latency);
    return run_pack(pack);
  }();
  if (done) return 0;
  fmt::print(stderr, "{}\n", done.error().message);
  return 1;
}

}  // namespace
}  // namespace wagonsight

int main(int argc, char** argv) {
  return wagonsight::run(argc, argv);
}

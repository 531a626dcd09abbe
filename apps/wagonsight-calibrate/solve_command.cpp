#include <fmt/format.h>

#include <chrono>
#include <cmath>
#include <numbers>

#include "calibrate/pack.h"
#include "calibrate/solve.h"
#include "commands.h"
#include "depth_images.h"
#include "linux/files.h"
#include "rig/blob.h"

namespace wagonsight {
namespace {

constexpr double kDegrees = 180 / std::numbers::pi;

void print_imagers(const Solution& solution) {
  fmt::print("{:<12} {:>8} {:>8} {:>10} {:>10} {:>12} {:>14}\n", "imager", "corners", "rejected",
             "RMS px", "held out", "sigma mm", "sigma degrees");
  for (const ImagerSolution& imager : solution.imagers) {
    const double position = std::sqrt(imager.covariance.bottomRightCorner<3, 3>().trace());
    const double turn = std::sqrt(imager.covariance.topLeftCorner<3, 3>().trace());
    fmt::print("{:<12} {:>8} {:>8} {:>10.3f} {:>10.3f} {:>12.2f} {:>14.4f}\n", imager.name,
               imager.corners, imager.rejected, imager.rms_px, imager.held_out_rms_px,
               position * 1e3, turn * kDegrees);
  }
}

void print_depth(const Solution& solution) {
  for (const ImagerSolution& imager : solution.imagers) {
    if (!imager.depth) continue;
    const DepthCalibration& depth = *imager.depth;
    const auto sigma = [&](int k) { return std::sqrt(depth.covariance(k, k)); };
    fmt::print(
        "{}: depth = {:.4f} +- {:.4f} x reading {:+.1f} +- {:.1f} mm, {:.1f} mm off the "
        "boards of {} images; ",
        imager.name, depth.scale, sigma(6), depth.offset_m * 1e3, sigma(7) * 1e3, depth.rms_m * 1e3,
        depth.views);
    if (depth.from_infrared)
      fmt::print("offset to infrared {:.2f}, {:.2f} +- {:.2f}, {:.2f} px\n", depth.pixel_offset.x(),
                 depth.pixel_offset.y(), sigma(8), sigma(9));
    else
      fmt::print("in the colour camera at {:.1f}, {:.1f}, {:.1f} +- {:.1f}, {:.1f}, {:.1f} mm\n",
                 depth.X_CS.position.x() * 1e3, depth.X_CS.position.y() * 1e3,
                 depth.X_CS.position.z() * 1e3, sigma(3) * 1e3, sigma(4) * 1e3, sigma(5) * 1e3);
  }
  if (solution.scale_check)
    fmt::print("the depth says that a square is {:.2f} +- {:.2f} mm, stated are {:.2f} mm\n",
               solution.scale_check->square_m * 1e3, solution.scale_check->sigma_m * 1e3,
               solution.board.square_m * 1e3);
}

// A new solution knows nothing of the delays of the time stamps, and they do not depend on it:
// those of the blob that is replaced stay.
void keep_stamp_delays(const std::string& path, Rig& rig) {
  const auto file = MappedFile::open(path);
  const auto blob = file ? open_blob(file->bytes()) : Result<RigBlob>(fail(""));
  if (!blob) return;
  for (RigSensor& sensor : rig.sensors) {
    const int index = find_sensor(blob->rig, sensor.name.view());
    if (index < 0) continue;
    sensor.stamp_delay = blob->rig.sensors[static_cast<std::size_t>(index)].stamp_delay;
    if (sensor.stamp_delay.is_known())
      fmt::print("{}: the delay of its time stamps, {:.1f} ms, is kept\n", sensor.name.view(),
                 1e3 * sensor.stamp_delay.delay_s);
  }
}

}  // namespace

Result<Solution> read_solution(const std::string& path) {
  const auto text = read_file(path, kFileBytesMax);
  if (!text) return fail(text.error().message);
  return parse_solution(*text, path);
}

Result<void> run_solve(const SolveArguments& arguments) {
  const auto observations_text = read_file(arguments.observations, kFileBytesMax);
  if (!observations_text) return fail(observations_text.error().message);
  const auto observations = parse_observations(*observations_text, arguments.observations);
  if (!observations) return fail(observations.error().message);
  const auto sensors_text = read_file(arguments.sensors, kFileBytesMax);
  if (!sensors_text) return fail(sensors_text.error().message);
  const auto sensors = parse_sensors(*sensors_text, arguments.sensors);
  if (!sensors) return fail(sensors.error().message);
  SolveOptions options;
  if (arguments.keep_all) options.reject_sigmas = 0;
  auto solution = solve(*observations, *sensors, options);
  if (!solution) return fail(solution.error().message);
  if (!arguments.images.empty()) {
    const auto depth = read_depth_images(arguments.images, *sensors, *solution);
    if (!depth) return fail(depth.error().message);
    if (auto done = calibrate_depth(*depth, *sensors, *solution); !done) return done;
  }
  print_imagers(*solution);
  print_depth(*solution);
  for (const std::string& remark : solution->remarks) fmt::print("{}\n", remark);
  if (auto written = write_file_durably(arguments.out, bytes_of(format_solution(*solution)));
      !written || arguments.report.empty())
    return written;
  return write_report(*solution, arguments.images, arguments.observations, arguments.report);
}

Result<void> run_pack(const PackArguments& arguments) {
  const auto solution = read_solution(arguments.solution);
  if (!solution) return fail(solution.error().message);
  auto rig = to_rig(*solution);
  if (!rig) return fail(rig.error().message);
  rig->provenance.created_unix = std::chrono::duration_cast<std::chrono::seconds>(
                                     std::chrono::system_clock::now().time_since_epoch())
                                     .count();
  keep_stamp_delays(arguments.out, *rig);
  // What was there stays as OUT.previous: the unit falls back to it when the new one is damaged.
  return replace_file_keeping_previous(arguments.out, pack_blob(*rig));
}

}  // namespace wagonsight

// From the board's frame to the wagon's.
#include <fmt/format.h>

#include <numbers>

#include "calibrate/depth_targets.h"
#include "calibrate/georeference.h"
#include "commands.h"
#include "depth_images.h"
#include "geometry/angles.h"
#include "linux/files.h"

namespace wagonsight {
namespace {

constexpr double kDegrees = 180 / std::numbers::pi;

// A ball that a Kinect's depth does not show is told, not fatal: its rays may do.
Result<void> add_spheres(const GeoreferenceArguments& arguments, const Solution& solution,
                         std::vector<Target>& targets) {
  for (Target& target : targets)
    for (const Target::Sighting& sighting : target.seen) {
      if (sighting.image.empty()) continue;
      const auto depth = read_depth_beside(arguments.images, sighting.imager, sighting.image);
      if (!depth) return fail(depth.error().message);
      if (!*depth) continue;
      const double radius = target.radius_m.value_or(arguments.ball_radius);
      if (!(radius > 0))
        return fail(
            fmt::format("target {}: a sphere in depth needs its ball's radius; give "
                        "--ball-radius or its \"radius_m\"",
                        target.id));
      const DepthView& view = **depth;
      const auto found = sphere_in_depth(solution, target, sighting,
                                         {view.raw_mm.data(), view.width, view.height}, radius);
      if (!found) {
        fmt::print("target {}: no sphere: {}\n", target.id, found.error().message);
        continue;
      }
      fmt::print("target {}: a sphere in the depth of {}, {} readings, +- {:.1f} mm\n", target.id,
                 sighting.imager, found->readings, found->sphere.sigma_m * 1e3);
      target.spheres.push_back(found->sphere);
    }
  return {};
}

}  // namespace

Result<void> run_georeference(const GeoreferenceArguments& arguments) {
  auto solution = read_solution(arguments.solution);
  if (!solution) return fail(solution.error().message);
  const auto text = read_file(arguments.targets, kFileBytesMax);
  if (!text) return fail(text.error().message);
  auto targets = parse_targets(*text, arguments.targets);
  if (!targets) return fail(targets.error().message);
  if (!arguments.markers.empty()) {
    const auto tracked = read_file(arguments.markers, kFileBytesMax);
    if (!tracked) return fail(tracked.error().message);
    const auto markers = parse_markers(*tracked, arguments.markers);
    if (!markers) return fail(markers.error().message);
    if (auto taken = take_markers(*markers, *targets); !taken) return taken;
  }
  if (!arguments.images.empty())
    if (auto added = add_spheres(arguments, *solution, *targets); !added) return added;
  if (auto done = georeference(*targets, *solution); !done) return done;
  const Georeferenced& geo = *solution->georeference;
  const OmegaPhiKappa angles = to_omega_phi_kappa(geo.X_WB.rotation);
  fmt::print(
      "X0 {:.4f} m, Y0 {:.4f} m, Z0 {:.4f} m, omega {:.3f}, phi {:.3f}, kappa {:.3f} degrees, "
      "scale {:.5f}\n",
      geo.X_WB.position.x(), geo.X_WB.position.y(), geo.X_WB.position.z(), angles.omega * kDegrees,
      angles.phi * kDegrees, angles.kappa * kDegrees, geo.X_WB.scale);
  for (std::size_t i = 0; i < geo.targets.size(); ++i)
    fmt::print("target {}: {:.1f} mm off\n", geo.targets[i], geo.residuals_m[i].norm() * 1e3);
  return write_file_durably(arguments.out, bytes_of(format_solution(*solution)));
}

}  // namespace wagonsight

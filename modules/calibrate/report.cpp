#include "calibrate/report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "calibrate/findings.h"
#include "calibrate/pack.h"
#include "calibrate/report_figures.h"
#include "calibrate/report_style.h"
#include "geometry/angles.h"

namespace wagonsight {
namespace {

using report::escape;

constexpr double kDegrees = 180 / std::numbers::pi;
constexpr std::size_t kFiguresShown = 12, kFiguresMax = 120, kRowsMax = 400;

template <class T>
std::vector<const T*> worst_first(const std::vector<T>& list) {
  std::vector<const T*> sorted;
  for (const T& item : list) sorted.push_back(&item);
  std::stable_sort(sorted.begin(), sorted.end(),
                   [](const T* a, const T* b) { return a->rms_px > b->rms_px; });
  return sorted;
}

std::string rms_cell(double rms_px, double scale) {
  const char* tone = rms_px > 1.2 ? "bad" : rms_px > 0.6 ? "warn" : "";
  return fmt::format(
      "<td class=\"{}\">{:.3f}<span class=\"bar\" style=\"width:{:.0f}px\"></span></td>", tone,
      rms_px, 90 * rms_px / std::max(scale, 1e-9));
}

std::string verdict_section(const Findings& findings) {
  std::string html = fmt::format("<section class=\"verdict g{}\"><h1>{}</h1><p>{}</p></section>",
                                 static_cast<int>(findings.grade), escape(findings.headline),
                                 escape(findings.sentence));
  html += "<section><h2>What to do better</h2>";
  if (findings.list.empty()) html += "<p>Nothing stands out.</p>";
  html += "<ul class=\"findings\">";
  for (const Finding& finding : findings.list)
    html += fmt::format("<li class=\"g{}\"><b>{}</b> <span>{}.</span></li>",
                        static_cast<int>(finding.grade), escape(finding.what),
                        escape(finding.what_to_do));
  return html + "</ul></section>";
}

std::string camera_table(const Solution& solution) {
  std::string html =
      "<section><h2>Cameras, worst first</h2><p>RMS is the root mean square length of the "
      "residuals, "
      "√2 times the one per coordinate. Held out: of corners that the solution had not seen. The "
      "sigmas are one standard deviation of the pose against the board, intrinsics included.</p>"
      "<div class=\"scroll\"><table><tr><th>camera</th><th>RMS px</th><th>per "
      "coordinate</th><th>held "
      "out</th><th>corners</th><th>left out</th><th>position<br>σ mm</th><th>turn<br>σ °</th>"
      "<th>f<sub>x</sub>, f<sub>y</sub> ± σ px</th><th>c<sub>x</sub>, c<sub>y</sub> ± σ "
      "px</th></tr>";
  const auto sorted = worst_first(solution.imagers);
  for (const ImagerSolution* imager : sorted) {
    const Eigen::Vector4d& s = imager->sigma_intrinsics;
    const char* fixed = imager->intrinsics_fixed ? " (fixed)" : "";
    html += fmt::format(
        "<tr><td>{}</td>{}<td>{:.3f}</td><td>{}</td><td>{}</td><td "
        "class=\"{}\">{}</td><td>{:.2f}</td>"
        "<td>{:.3f}</td><td>{:.1f}, {:.1f} ± {:.1f}{}</td><td>{:.1f}, {:.1f} ± {:.1f}{}</td></tr>",
        escape(imager->name), rms_cell(imager->rms_px, sorted.front()->rms_px),
        imager->rms_px_per_coordinate,
        imager->held_out_rms_px > 0 ? fmt::format("{:.3f}", imager->held_out_rms_px) : "–",
        imager->corners, imager->rejected > 0 ? "warn" : "", imager->rejected,
        1e3 * std::sqrt(imager->covariance.bottomRightCorner<3, 3>().trace()),
        kDegrees * std::sqrt(imager->covariance.topLeftCorner<3, 3>().trace()), imager->camera.fx,
        imager->camera.fy, std::max(s[0], s[1]), fixed, imager->camera.cx, imager->camera.cy,
        std::max(s[2], s[3]), fixed);
  }
  return html + "</table></div></section>";
}

std::string view_table(const Solution& solution) {
  std::string html =
      "<section><h2>Views, worst first</h2><p>Tilt is the angle at which the camera looks onto the "
      "board: 0° straight on, 90° edge on.</p><div class=\"scroll\"><table><tr><th>image</th>"
      "<th class=\"text\">camera</th><th class=\"text\">board pose</th><th>RMS px</th><th>worst "
      "corner "
      "px</th><th>corners</th><th>left out</th><th>tilt °</th></tr>";
  const auto sorted = worst_first(solution.views);
  for (std::size_t i = 0; i < std::min(sorted.size(), kRowsMax); ++i) {
    const ViewSolution& view = *sorted[i];
    int used = 0, left_out = 0;
    double worst = 0;
    for (const auto& r : view.residuals) {
      (r.used ? used : left_out) += 1;
      if (r.used) worst = std::max(worst, r.residual.norm());
    }
    html += fmt::format(
        "<tr><td>{}</td><td class=\"text\">{}</td><td class=\"text\">{}</td>{}<td>{:.2f}</td>"
        "<td>{}</td><td class=\"{}\">{}</td><td>{:.0f}</td></tr>",
        escape(view.image.empty() ? "–" : view.image), escape(view.imager), escape(view.pose),
        rms_cell(view.rms_px, sorted.front()->rms_px), worst, used, left_out > 0 ? "warn" : "",
        left_out, tilt_deg(solution, view));
  }
  html += "</table></div>";
  if (sorted.size() > kRowsMax)
    html += fmt::format("<p>{} better views are not listed.</p>", sorted.size() - kRowsMax);
  return html + "</section>";
}

// A power of two that makes the median residual about a 60th of the image's width.
double enlargement(const Solution& solution) {
  std::vector<double> lengths;
  for (const ViewSolution& view : solution.views)
    for (const auto& r : view.residuals)
      if (r.used) lengths.push_back(r.residual.norm());
  if (lengths.empty()) return 1;
  const auto middle = lengths.begin() + static_cast<std::ptrdiff_t>(lengths.size() / 2);
  std::nth_element(lengths.begin(), middle, lengths.end());
  const double wanted = solution.imagers.front().camera.width / 60.0 / std::max(*middle, 1e-4);
  return std::clamp(std::exp2(std::round(std::log2(wanted))), 1.0, 4096.0);
}

std::string residual_section(const Solution& solution,
                             const std::map<std::string, std::string>& jpegs) {
  const double enlarged = enlargement(solution);
  std::string html = fmt::format(
      "<section><h2>Residuals in the images, worst first</h2><p>From each corner as it was "
      "measured "
      "towards where the solution does not explain it, enlarged {:.0f} times. Vectors that all "
      "point one "
      "way tell of a board that moved or bent; red crosses are corners left out.</p><div "
      "class=\"grid2\">",
      enlarged);
  const auto sorted = worst_first(solution.views);
  const std::size_t count = std::min(sorted.size(), kFiguresMax);
  for (std::size_t i = 0; i < count; ++i) {
    if (i == kFiguresShown)
      html += fmt::format("</div><details><summary>{} more views</summary><div class=\"grid2\">",
                          count - kFiguresShown);
    const ViewSolution& view = *sorted[i];
    const auto imager =
        std::find_if(solution.imagers.begin(), solution.imagers.end(),
                     [&](const ImagerSolution& one) { return one.name == view.imager; });
    if (imager == solution.imagers.end()) continue;
    const auto jpeg = jpegs.find(view.image);
    html += fmt::format(
        "<figure><figcaption><b>{}</b><span>{:.2f} px</span></figcaption>{}</figure>",
        escape(view.image.empty() ? view.imager + ", " + view.pose : view.image), view.rms_px,
        report::residual_figure(view, imager->camera,
                                jpeg == jpegs.end() ? std::string_view() : jpeg->second, enlarged));
  }
  html += count > kFiguresShown ? "</div></details>" : "</div>";
  return html + "</section>";
}

std::string coverage_section(const Solution& solution) {
  std::string html =
      "<section><h2>Coverage of the images</h2><p>Where no corner was seen the lens is only "
      "guessed. "
      "Empty cells are red.</p><div class=\"grid2\">";
  const auto all = coverage_of(solution);
  for (std::size_t i = 0; i < all.size(); ++i)
    html += fmt::format(
        "<figure><figcaption><b>{}</b><span>{:.0f}% covered</span></figcaption>{}</figure>",
        escape(all[i].imager), all[i].share * 100,
        report::coverage_figure(all[i], solution, solution.imagers[i]));
  html +=
      "</div></section><section><h2>Overlap</h2><p>Board poses that two cameras saw at once: what "
      "holds the rig together.</p><div class=\"scroll\"><table><tr><th></th>";
  const auto overlap = overlap_of(solution);
  for (const ImagerSolution& imager : solution.imagers)
    html += fmt::format("<th>{}</th>", escape(imager.name));
  html += "</tr>";
  for (std::size_t i = 0; i < overlap.size(); ++i) {
    html += fmt::format("<tr><td>{}</td>", escape(solution.imagers[i].name));
    for (std::size_t k = 0; k < overlap.size(); ++k)
      html +=
          fmt::format("<td class=\"{}\">{}</td>",
                      i == k || overlap[i][k] == 0 ? "none"
                      : overlap[i][k] < 3          ? "warn"
                                                   : "",
                      i == k ? fmt::format("({})", overlap[i][k]) : std::to_string(overlap[i][k]));
    html += "</tr>";
  }
  return html + "</table></div></section>";
}

std::string map_section(const UncertaintyMap& map, const Result<Rig>& rig) {
  std::string html = "<section><h2>Where a point is placed to within what</h2>";
  if (!rig)
    return html + fmt::format("<p>Not known: {}.</p></section>", escape(rig.error().message));
  if (map.cells.empty())
    return html + "<p>No sensor's view reaches the floor or 1 m above it.</p></section>";
  html += fmt::format(
      "<p>Seen from above, {:.0f} m over the {}; one standard deviation in 3D, of the best of the "
      "sensors "
      "that see the place, grid lines 1 m apart. Left the calibration's share (uncertain poses{}), "
      "right "
      "with the noise of one single reading. Seats and walls are not known here, a stereo camera's "
      "texture neither.</p><div class=\"maps\"><figure><figcaption><b>calibration "
      "alone</b><span>half is "
      "within {:.1f} mm</span></figcaption>{}</figure><figure><figcaption><b>one "
      "reading</b><span>half is "
      "within {:.1f} mm</span></figcaption>{}</figure></div>{}</section>",
      map.height_m, rig->georeference.present ? "floor" : "reference board",
      rig->georeference.present ? " and georeference" : "", map.median_pose_m() * 1e3,
      report::map_figure(map, *rig, true), map.median_total_m() * 1e3,
      report::map_figure(map, *rig, false), report::map_legend());
  return html;
}

// Standard deviations of omega, phi and kappa (radians) from those of the small rotation.
Eigen::Vector3d angle_sigmas(const Georeferenced& geo) {
  const auto angles = [](const Eigen::Quaterniond& q) {
    const OmegaPhiKappa a = to_omega_phi_kappa(q);
    return Eigen::Vector3d(a.omega, a.phi, a.kappa);
  };
  const Eigen::Vector3d at = angles(geo.X_WB.rotation);
  Eigen::Matrix3d J;
  for (int k = 0; k < 3; ++k) {
    constexpr double kStep = 1e-6;
    const Eigen::AngleAxisd turn(kStep, Eigen::Vector3d::Unit(k));
    const Eigen::Vector3d moved = angles(turn * geo.X_WB.rotation);
    for (int i = 0; i < 3; ++i) J(i, k) = wrap_angle(moved[i] - at[i]) / kStep;
  }
  return (J * geo.covariance.topLeftCorner<3, 3>() * J.transpose()).diagonal().cwiseSqrt();
}

std::string georeference_section(const Solution& solution) {
  std::string html = "<section><h2>Georeference</h2>";
  if (!solution.georeference)
    return html +
           "<p>None: the world is the reference board, its z turned upwards. Measure three targets "
           "or "
           "more, then <b>wagonsight-calibrate georeference</b> and <b>report</b>.</p></section>";
  const Georeferenced& geo = *solution.georeference;
  const OmegaPhiKappa angles = to_omega_phi_kappa(geo.X_WB.rotation);
  const Eigen::Vector3d turn = angle_sigmas(geo) * kDegrees;
  const Eigen::VectorXd sigma = geo.covariance.diagonal().cwiseSqrt();
  html +=
      "<p>From the board to the world, p_W = λ R p_B + T with R = Rz(κ) Ry(φ) Rx(ω). λ belongs to "
      "the board's stated size.</p><div class=\"grid2\"><table><tr><th>parameter</th><th>value</th>"
      "<th>σ</th></tr>";
  const auto row = [&](const char* name, const std::string& value, const std::string& s) {
    html += fmt::format("<tr><td>{}</td><td>{}</td><td>{}</td></tr>", name, value, s);
  };
  const Eigen::Vector3d& T = geo.X_WB.position;
  for (int k = 0; k < 3; ++k) {
    static const char* const kNames[] = {"X0 (m)", "Y0 (m)", "Z0 (m)"};
    row(kNames[k], fmt::format("{:.4f}", T[k]), fmt::format("{:.4f}", sigma[3 + k]));
  }
  row("ω omega (deg)", fmt::format("{:.3f}", angles.omega * kDegrees),
      fmt::format("{:.3f}", turn[0]));
  row("φ phi (deg)", fmt::format("{:.3f}", angles.phi * kDegrees), fmt::format("{:.3f}", turn[1]));
  row("κ kappa (deg)", fmt::format("{:.3f}", angles.kappa * kDegrees),
      fmt::format("{:.3f}", turn[2]));
  row("λ scale", fmt::format("{:.5f}", geo.X_WB.scale), fmt::format("{:.5f}", sigma[6]));
  html +=
      "</table><table><tr><th>target</th><th>off x</th><th>y</th><th>z mm</th><th>in all "
      "mm</th></tr>";
  for (std::size_t i = 0; i < geo.targets.size(); ++i) {
    const Eigen::Vector3d r = geo.residuals_m[i] * 1e3;
    html += fmt::format(
        "<tr><td>{}</td><td>{:.1f}</td><td>{:.1f}</td><td>{:.1f}</td><td>{:.1f}</td></tr>",
        escape(geo.targets[i]), r.x(), r.y(), r.z(), r.norm());
  }
  return html + "</table></div></section>";
}

std::string remark_section(const Solution& solution) {
  if (solution.remarks.empty()) return {};
  std::string html = "<section><h2>What was found on the way</h2><ul class=\"remarks\">";
  for (const std::string& remark : solution.remarks) html += "<li>" + escape(remark) + "</li>";
  return html + "</ul></section>";
}

}  // namespace

std::string format_report(const Solution& solution, const std::map<std::string, std::string>& jpegs,
                          std::string_view title) {
  const Result<Rig> rig = to_rig(solution);
  UncertaintyMap map;
  // A rig that hangs about a board on a table may see nothing a metre above it: then at the board.
  for (const double height_m : {1.0, 0.0})
    if (rig && map.cells.empty()) map = map_uncertainty(*rig, height_m, height_m > 0 ? 0.1 : 0.05);
  const Findings findings = judge(solution, map);
  std::string html = fmt::format(
      "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" "
      "content=\"width=device-width,initial-scale=1\"><meta name=\"color-scheme\" content=\"light "
      "dark\">"
      "<title>{0} · calibration</title><style>{1}</style></head><body><main><p "
      "class=\"top\">wagonsight · "
      "calibration of {0}, {2} rows × {3} columns of {4:.1f} mm</p>",
      escape(title), report::kStyle, solution.board.rows, solution.board.columns,
      solution.board.square_m * 1e3);
  html += verdict_section(findings);
  html += camera_table(solution);
  html += map_section(map, rig);
  html += view_table(solution);
  html += residual_section(solution, jpegs);
  html += coverage_section(solution);
  html += georeference_section(solution);
  html += remark_section(solution);
  return html + "</main></body></html>\n";
}

}  // namespace wagonsight

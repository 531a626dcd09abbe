#include "calibrate/report_figures.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace wagonsight::report {
namespace {

// Upper ends of the map's shades, millimetres; the last is open.
constexpr std::array kLevels_mm = {2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 50.0};
constexpr double kMapWidth = 500, kMapHeight = 560;  // of the drawing, about as it is shown

int level_of(double metres) {
  int level = 0;
  while (level < static_cast<int>(kLevels_mm.size()) &&
         metres * 1e3 > kLevels_mm[static_cast<std::size_t>(level)])
    ++level;
  return level;
}

std::string base64(std::string_view bytes) {
  constexpr std::string_view kLetters =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t word = 0;
    for (std::size_t k = 0; k < 3; ++k)
      word = word << 8 | (i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0U);
    for (std::size_t k = 0; k < 4; ++k)
      text += i + k <= bytes.size() ? kLetters[word >> (18 - 6 * k) & 63U] : '=';
  }
  return text;
}

}  // namespace

std::string escape(std::string_view text) {
  std::string safe;
  for (const char c : text) switch (c) {
      case '&':
        safe += "&amp;";
        break;
      case '<':
        safe += "&lt;";
        break;
      case '>':
        safe += "&gt;";
        break;
      case '"':
        safe += "&quot;";
        break;
      case '\'':
        safe += "&#39;";
        break;
      default:
        safe += c;
    }
  return safe;
}

std::string residual_figure(const ViewSolution& view, const Camera& camera, std::string_view jpeg,
                            double enlarged) {
  std::string svg = fmt::format(
      "<svg viewBox=\"-0.5 -0.5 {} {}\" class=\"photo\" role=\"img\" aria-label=\"residuals "
      "of {}\">",
      camera.width, camera.height, escape(view.image));
  if (!jpeg.empty())
    svg += fmt::format(
        "<image x=\"-0.5\" y=\"-0.5\" width=\"{}\" height=\"{}\" preserveAspectRatio=\"none\" "
        "href=\"data:image/jpeg;base64,{}\"/>",
        camera.width, camera.height, base64(jpeg));
  const double dot = camera.width / 260.0;
  std::string lines, dots, crosses;
  for (const auto& r : view.residuals) {
    const Eigen::Vector2d from = r.pixel, to = r.pixel + enlarged * r.residual;
    if (!r.used) {
      crosses +=
          fmt::format("M{:.1f} {:.1f}l{:.1f} {:.1f}m0 {:.1f}l{:.1f} {:.1f}", from.x() - 2 * dot,
                      from.y() - 2 * dot, 4 * dot, 4 * dot, -4 * dot, -4 * dot, 4 * dot);
      continue;
    }
    lines += fmt::format("M{:.1f} {:.1f}L{:.1f} {:.1f}", from.x(), from.y(), to.x(), to.y());
    dots += fmt::format("M{:.1f} {:.1f}h0", from.x(), from.y());
  }
  svg += fmt::format("<path d=\"{}\" class=\"dots\" stroke-width=\"{:.2f}\"/>", dots, 2 * dot);
  svg += fmt::format("<path d=\"{}\" class=\"vectors under\" stroke-width=\"{:.2f}\"/>", lines,
                     2.4 * dot);
  svg +=
      fmt::format("<path d=\"{}\" class=\"vectors\" stroke-width=\"{:.2f}\"/>", lines, 1.3 * dot);
  svg +=
      fmt::format("<path d=\"{}\" class=\"crosses\" stroke-width=\"{:.2f}\"/></svg>", crosses, dot);
  return svg;
}

std::string coverage_figure(const Coverage& coverage, const Solution& solution,
                            const ImagerSolution& imager) {
  const int width = imager.camera.width, height = imager.camera.height;
  std::string svg = fmt::format(
      "<svg viewBox=\"0 0 {} {}\" class=\"coverage\" role=\"img\" aria-label=\"coverage of {}\">",
      width, height, escape(imager.name));
  const double cell_x = static_cast<double>(width) / Coverage::kColumns;
  const double cell_y = static_cast<double>(height) / Coverage::kRows;
  for (int row = 0; row < Coverage::kRows; ++row)
    for (int column = 0; column < Coverage::kColumns; ++column) {
      const int count = coverage.counts[row][column];
      const double shade = count == 0 ? 0 : std::min(0.6, 0.12 + 0.12 * std::log2(1.0 + count));
      svg += fmt::format(
          "<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"{:.1f}\" height=\"{:.1f}\" class=\"{}\" "
          "fill-opacity=\"{:.2f}\"/>",
          column * cell_x, row * cell_y, cell_x, cell_y, count == 0 ? "empty" : "filled",
          count == 0 ? 1 : shade);
    }
  std::string dots;
  for (const ViewSolution& view : solution.views)
    if (view.imager == imager.name)
      for (const auto& r : view.residuals)
        if (r.used) dots += fmt::format("M{:.0f} {:.0f}h0", r.pixel.x(), r.pixel.y());
  return svg + fmt::format("<path d=\"{}\" class=\"corner-dots\" stroke-width=\"{:.1f}\"/></svg>",
                           dots, width / 150.0);
}

std::string map_figure(const UncertaintyMap& map, const Rig& rig, bool pose_only) {
  Eigen::Vector2d low = map.corner;
  Eigen::Vector2d high = map.corner + map.cell_m * Eigen::Vector2d(map.columns, map.rows);
  for (const RigSensor& sensor : rig.sensors) {
    low = low.cwiseMin(sensor.X_WS.position.head<2>());
    high = high.cwiseMax(sensor.X_WS.position.head<2>());
  }
  low.array() -= 0.3;
  high.array() += 0.3;
  // x to the right, y up, as W is seen from above. Names and sensors are as large in any wagon.
  const Eigen::Vector2d extent = high - low;
  const double metre = std::min(kMapWidth / extent.x(), kMapHeight / extent.y());
  const double width = extent.x() * metre, height = extent.y() * metre;
  const auto x = [&](double w) { return (w - low.x()) * metre; };
  const auto y = [&](double w) { return (high.y() - w) * metre; };
  std::string svg = fmt::format(
      "<svg viewBox=\"0 0 {:.0f} {:.0f}\" class=\"map\" role=\"img\" aria-label=\"uncertainty from "
      "above\">",
      width, height);
  std::array<std::string, kLevels_mm.size() + 1> paths;
  const double step = map.cell_m * metre;
  for (int row = 0; row < map.rows; ++row)
    for (int column = 0, end = 0; column < map.columns; column = end) {
      // Cells of one shade side by side become one rectangle.
      const auto shade = [&](int c) {
        const UncertaintyMap::Cell& cell = map.at(c, row);
        return cell.seen_by == 0 ? -1 : level_of(pose_only ? cell.pose_m : cell.total_m);
      };
      const int level = shade(column);
      for (end = column + 1; end < map.columns && shade(end) == level;) ++end;
      if (level < 0) continue;
      paths[static_cast<std::size_t>(level)] += fmt::format(
          "M{:.1f} {:.1f}h{:.1f}v{:.1f}h{:.1f}z", x(map.corner.x() + column * map.cell_m),
          y(map.corner.y() + (row + 1) * map.cell_m), (end - column) * step, step,
          -(end - column) * step);
    }
  for (std::size_t level = 0; level < paths.size(); ++level)
    svg += fmt::format("<path d=\"{}\" class=\"level{}\"/>", paths[level], level);
  std::string grid;
  for (double line = std::ceil(low.x()); line < high.x(); line += 1)
    grid += fmt::format("M{:.1f} 0V{:.0f}", x(line), height);
  for (double line = std::ceil(low.y()); line < high.y(); line += 1)
    grid += fmt::format("M0 {:.1f}H{:.0f}", y(line), width);
  svg += fmt::format("<path d=\"{}\" class=\"grid\"/>", grid);
  svg += fmt::format(
      "<path d=\"M{0:.1f} {1:.1f}h50m-50 0v-50\" class=\"axes\"/>"
      "<text x=\"{2:.1f}\" y=\"{1:.1f}\">x</text><text x=\"{0:.1f}\" y=\"{3:.1f}\">y</text>",
      x(0), y(0), x(0) + 56, y(0) - 56);
  for (const RigSensor& sensor : rig.sensors) {
    const Eigen::Vector3d p = sensor.X_WS.position;
    const Eigen::Vector2d ahead = (sensor.X_WS.rotation * Eigen::Vector3d::UnitZ()).head<2>() * 35;
    svg += fmt::format(
        "<path d=\"M{:.1f} {:.1f}l{:.1f} {:.1f}\" class=\"gaze\"/><circle cx=\"{:.1f}\" "
        "cy=\"{:.1f}\" "
        "r=\"9\" class=\"sensor\"/><text x=\"{:.1f}\" y=\"{:.1f}\" class=\"name\">{}</text>",
        x(p.x()), y(p.y()), ahead.x(), -ahead.y(), x(p.x()), y(p.y()), x(p.x()) + 13, y(p.y()) - 8,
        escape(sensor.name.view()));
  }
  return svg + "</svg>";
}

std::string map_legend() {
  std::string legend = "<p class=\"legend\">";
  double from = 0;
  for (std::size_t level = 0; level <= kLevels_mm.size(); ++level) {
    const bool last = level == kLevels_mm.size();
    legend += fmt::format("<span><i class=\"level{}\"></i>{}</span>", level,
                          last ? fmt::format("over {:.0f} mm", from)
                               : fmt::format("{:.0f}–{:.0f}", from, kLevels_mm[level]));
    if (!last) from = kLevels_mm[level];
  }
  return legend + "</p>";
}

}  // namespace wagonsight::report

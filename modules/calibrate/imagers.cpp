#include "calibrate/imagers.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <set>
#include <span>

#include "base/toml.h"

namespace wagonsight {
namespace {

constexpr std::array kKnownKeys = {"name",
                                   "kind",
                                   "width",
                                   "height",
                                   "fix_intrinsics",
                                   "fx",
                                   "fy",
                                   "cx",
                                   "cy",
                                   "distortion",
                                   "focal_sigma_relative",
                                   "centre_sigma_px",
                                   "baseline_m",
                                   "baseline_sigma_m",
                                   "depth"};

constexpr std::array kDepthKeys = {"through", "width", "height",     "fx",      "fy",
                                   "cx",      "cy",    "distortion", "position"};

std::string at(std::string_view file, const toml::node& node) {
  return fmt::format("{}:{}", file, node.source().begin.line);
}

// The number under `key` if it is there; fails when it is not within [low, high].
Result<std::optional<double>> number(const toml::table& table, std::string_view key, double low,
                                     double high, std::string_view file) {
  const toml::node* node = table.get(key);
  if (node == nullptr) return std::optional<double>();
  const auto value = node->value<double>();
  if (!value || !(*value >= low && *value <= high))
    return fail(
        fmt::format("{}: {} must be a number between {} and {}", at(file, *node), key, low, high));
  return value;
}

Result<void> refuse_unknown_keys(const toml::table& table, std::span<const char* const> known,
                                 std::string_view what, std::string_view file) {
  for (const auto& [key, node] : table)
    if (std::none_of(known.begin(), known.end(), [&](const char* k) { return key.str() == k; }))
      return fail(fmt::format("{}: {} is not a key of {}", at(file, node), key.str(), what));
  return {};
}

struct Ranged {
  const char* key;
  double low, high;
  double* target;
  bool required;
};

Result<void> read_numbers(const toml::table& table, std::initializer_list<Ranged> wanted,
                          std::string_view file) {
  for (const Ranged& item : wanted) {
    auto value = number(table, item.key, item.low, item.high, file);
    if (!value) return fail(value.error().message);
    if (*value)
      *item.target = **value;
    else if (item.required)
      return fail(fmt::format("{}: {} is missing", at(file, table), item.key));
  }
  return {};
}

Result<std::optional<Camera>> read_start(const toml::table& table, const SensorSpec& spec,
                                         std::string_view file) {
  if (!table.contains("fx")) {
    if (spec.fix_intrinsics)
      return fail(fmt::format("{}: sensor {} has fix_intrinsics but no fx, fy, cx, cy to keep",
                              at(file, table), spec.name));
    return std::optional<Camera>();
  }
  Camera camera;
  camera.width = spec.width;
  camera.height = spec.height;
  const auto read = read_numbers(table,
                                 {{"fx", 1, 1e5, &camera.fx, true},
                                  {"fy", 1, 1e5, &camera.fy, true},
                                  {"cx", -1e4, 1e5, &camera.cx, true},
                                  {"cy", -1e4, 1e5, &camera.cy, true}},
                                 file);
  if (!read) return fail(read.error().message);
  if (const toml::array* list = table["distortion"].as_array()) {
    if (list->size() > 5)
      return fail(fmt::format("{}: distortion is [k1, k2, p1, p2, k3], here are {} numbers",
                              at(file, *list), list->size()));
    for (std::size_t i = 0; i < list->size(); ++i) {
      const auto value = (*list)[i].value<double>();
      if (!value) return fail(fmt::format("{}: distortion holds a non-number", at(file, *list)));
      camera.distortion[i] = *value;
    }
  }
  return std::optional<Camera>(camera);
}

// [sensor.depth]: through = "colour" | "infrared"; for colour the depth camera's intrinsics, and
// optionally where it is.
Result<std::optional<DepthCameraSpec>> read_depth(const toml::table& sensor, const SensorSpec& spec,
                                                  std::string_view file) {
  if (!sensor.contains("depth")) return std::optional<DepthCameraSpec>();
  const toml::table* table = sensor["depth"].as_table();
  if (table == nullptr || spec.kind != SensorKind::kKinect)
    return fail(fmt::format("{}: sensor {}: [sensor.depth] describes the depth camera of a kinect",
                            at(file, sensor), spec.name));
  if (auto known = refuse_unknown_keys(*table, kDepthKeys, "a depth camera", file); !known)
    return fail(known.error().message);
  DepthCameraSpec depth;
  const auto through = (*table)["through"].value_or(std::string());
  if (through != "colour" && through != "infrared")
    return fail(fmt::format(
        "{}: sensor {}: through = \"{}\" must name the image that is calibrated, \"colour\" or "
        "\"infrared\"",
        at(file, *table), spec.name, through));
  depth.from_infrared = through == "infrared";
  if (depth.from_infrared) return std::optional<DepthCameraSpec>(depth);
  double width = 0, height = 0;
  Eigen::Vector3d& position = depth.X_CS.position;
  const auto read = read_numbers(
      *table, {{"width", 16, 16384, &width, true}, {"height", 16, 16384, &height, true}}, file);
  if (!read) return fail(read.error().message);
  SensorSpec sizes;
  sizes.width = static_cast<int>(width);
  sizes.height = static_cast<int>(height);
  sizes.name = spec.name;
  sizes.fix_intrinsics = true;  // so that they must be there
  auto camera = read_start(*table, sizes, file);
  if (!camera) return fail(camera.error().message);
  depth.camera = **camera;
  // Kinect v1's depth camera sits 25 mm beside its colour camera.
  position = {-0.025, 0, 0};
  if (const toml::array* list = (*table)["position"].as_array()) {
    if (list->size() != 3)
      return fail(fmt::format("{}: position is [x, y, z] in metres", at(file, *list)));
    for (int i = 0; i < 3; ++i) {
      const auto value = (*list)[static_cast<std::size_t>(i)].value<double>();
      if (!value || !(std::abs(*value) < 1))
        return fail(fmt::format("{}: position is [x, y, z] in metres", at(file, *list)));
      position[i] = *value;
    }
  }
  return std::optional<DepthCameraSpec>(depth);
}

Result<SensorSpec> parse_sensor(const toml::table& table, std::string_view file) {
  if (auto known = refuse_unknown_keys(table, kKnownKeys, "a sensor", file); !known)
    return fail(known.error().message);
  SensorSpec spec;
  spec.name = table["name"].value_or(std::string());
  if (spec.name.empty() || spec.name.size() > Name::capacity())
    return fail(fmt::format("{}: a sensor needs a name of 1 to {} letters", at(file, table),
                            Name::capacity()));
  const auto kind = table["kind"].value_or(std::string());
  if (kind != "kinect" && kind != "stereo")
    return fail(fmt::format("{}: sensor {}: kind = \"{}\" must be \"kinect\" or \"stereo\"",
                            at(file, table), spec.name, kind));
  spec.kind = kind == "stereo" ? SensorKind::kStereo : SensorKind::kKinect;
  double width = 0, height = 0, baseline = 0;
  const auto read = read_numbers(table,
                                 {{"width", 16, 16384, &width, true},
                                  {"height", 16, 16384, &height, true},
                                  {"focal_sigma_relative", 0, 1, &spec.fixed_sigma_focal, false},
                                  {"centre_sigma_px", 0, 1e3, &spec.fixed_sigma_centre_px, false},
                                  {"baseline_m", 0.001, 10, &baseline, false},
                                  {"baseline_sigma_m", 1e-7, 1, &spec.baseline_sigma_m, false}},
                                 file);
  if (!read) return fail(read.error().message);
  spec.width = static_cast<int>(width);
  spec.height = static_cast<int>(height);
  if (baseline > 0) spec.baseline_m = baseline;
  spec.fix_intrinsics =
      table["fix_intrinsics"].value_or(spec.kind == SensorKind::kKinect && table.contains("fx"));
  auto start = read_start(table, spec, file);
  if (!start) return fail(start.error().message);
  spec.start = *start;
  auto depth = read_depth(table, spec, file);
  if (!depth) return fail(depth.error().message);
  spec.depth = *depth;
  return spec;
}

}  // namespace

Result<std::vector<SensorSpec>> parse_sensors(std::string_view text, std::string_view file) {
  const toml::parse_result parsed = toml::parse(text, file);
  if (!parsed)
    return fail(fmt::format("{}:{}: {}", file, parsed.error().source().begin.line,
                            parsed.error().description()));
  const toml::table& root = parsed.table();
  const toml::array* list = root["sensor"].as_array();
  if (list == nullptr || list->empty())
    return fail(fmt::format("{}: no [[sensor]] is described", file));
  std::vector<SensorSpec> specs;
  std::set<std::string> names;
  for (const toml::node& node : *list) {
    if (!node.is_table()) return fail(fmt::format("{}: a sensor is a table", at(file, node)));
    auto spec = parse_sensor(*node.as_table(), file);
    if (!spec) return fail(spec.error().message);
    if (!names.insert(spec->name).second)
      return fail(fmt::format("{}: sensor {} is described twice", at(file, node), spec->name));
    specs.push_back(std::move(*spec));
  }
  if (specs.size() > kSensorsMax)
    return fail(fmt::format("{}: {} sensors are more than the {} of one unit", file, specs.size(),
                            kSensorsMax));
  return specs;
}

std::vector<Imager> imagers_of(const std::vector<SensorSpec>& specs) {
  std::vector<Imager> imagers;
  for (std::size_t i = 0; i < specs.size(); ++i) {
    const int index = static_cast<int>(i);
    if (specs[i].kind == SensorKind::kStereo) {
      imagers.push_back({specs[i].name + ".left", index});
      imagers.push_back({specs[i].name + ".right", index});
    } else {
      imagers.push_back({specs[i].name, index});
    }
  }
  return imagers;
}

}  // namespace wagonsight

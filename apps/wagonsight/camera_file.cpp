#include "camera_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <sstream>

#include "base/toml.h"

namespace wagonsight {
namespace {

std::string shown(const toml::node& value) {
  std::ostringstream text;
  value.visit([&](const auto& typed) { text << typed; });
  return text.str();
}

// Takes keys out of one table; remembers the first thing that is wrong, and in the end what was
// never asked for.
class Keys {
 public:
  Keys(const toml::table& table, std::string path, std::string prefix, std::string& trouble)
      : table_(table), path_(std::move(path)), prefix_(std::move(prefix)), trouble_(trouble) {}

  const toml::node* take(std::string_view key, bool is_required) {
    known_.emplace_back(key);
    const toml::node* value = table_.get(key);
    if (value == nullptr && is_required) say(table_, key, "is missing");
    return value;
  }
  void say(const toml::node& at, std::string_view key, std::string_view rule) {
    if (trouble_.empty())
      trouble_ =
          fmt::format("{}, line {}: {}{} {}", path_, at.source().begin.line, prefix_, key, rule);
  }
  void number(std::string_view key, double& out, bool is_required, double low, double high) {
    const toml::node* value = take(key, is_required);
    if (value == nullptr) return;
    const auto number = value->value<double>();
    if (!number || !(*number >= low && *number <= high))
      say(*value, key,
          fmt::format("is {}, but must be a number from {} to {}", shown(*value), low, high));
    else
      out = *number;
  }
  void whole(std::string_view key, int& out, int low, int high) {
    const toml::node* value = take(key, true);
    if (value == nullptr) return;
    const auto number = value->is_integer() ? value->value<std::int64_t>() : std::nullopt;
    if (!number || *number < low || *number > high)
      say(*value, key,
          fmt::format("is {}, but must be a whole number from {} to {}", shown(*value), low, high));
    else
      out = static_cast<int>(*number);
  }
  template <std::size_t N>
  bool numbers(std::string_view key, std::array<double, N>& out, bool is_required) {
    const toml::node* value = take(key, is_required);
    if (value == nullptr) return false;
    const toml::array* list = value->as_array();
    bool is_good = list != nullptr && list->size() == N;
    for (std::size_t i = 0; is_good && i < N; ++i) {
      const auto number = list->get(i)->value<double>();
      is_good = number.has_value() && std::isfinite(*number);
      if (is_good) out[i] = *number;
    }
    if (!is_good)
      say(*value, key, fmt::format("is {}, but must be a list of {} numbers", shown(*value), N));
    return is_good;
  }
  void refuse_unknown() {
    for (const auto& [key, value] : table_)
      if (std::find(known_.begin(), known_.end(), key.str()) == known_.end())
        say(value, key.str(),
            fmt::format("is not known here; known are {}", fmt::join(known_, ", ")));
  }

 private:
  const toml::table& table_;
  std::string path_, prefix_;
  std::string& trouble_;
  std::vector<std::string> known_;
};

void take_name(Keys& keys, RigSensor& sensor) {
  const toml::node* value = keys.take("name", true);
  if (value == nullptr) return;
  const auto name = value->value<std::string>();
  if (!value->is_string() || !is_sensor_name(*name))
    keys.say(*value, "name",
             fmt::format("is {}, but must be 1 to 40 letters, digits, _ and - in "
                         "quotes",
                         shown(*value)));
  else
    sensor.name = Name(*name);
}

void take_trim(Keys& keys, RigSensor& sensor, const toml::table& table) {
  std::array<double, 2> trim{sensor.trim_near, sensor.trim_far};
  if (!keys.numbers("trim_m", trim, false)) return;
  sensor.trim_near = trim[0];
  sensor.trim_far = trim[1];
  constexpr double kFarthest_m = 65.0;  // 16 bits of millimetres
  if (!(trim[0] >= 0 && trim[0] < trim[1] && trim[1] <= kFarthest_m))
    keys.say(*table.get("trim_m"), "trim_m",
             fmt::format("is [{}, {}], but must be [near, far] with 0 <= near < far <= {}", trim[0],
                         trim[1], kFarthest_m));
}

void take_pose(const toml::table& table, const std::string& path, std::string& trouble,
               RigSensor& sensor) {
  Keys keys(table, path, "pose.", trouble);
  std::array<double, 3> position{};
  std::array<double, 4> rotation{1, 0, 0, 0};
  keys.numbers("position", position, true);
  if (keys.numbers("rotation", rotation, true)) {
    const Eigen::Quaterniond q(rotation[0], rotation[1], rotation[2], rotation[3]);
    // Numbers typed with two decimals are still a rotation; a vector of degrees is not.
    constexpr double kNormTolerance = 0.02;
    if (std::abs(q.norm() - 1) > kNormTolerance)
      keys.say(
          *table.get("rotation"), "rotation",
          fmt::format("has the norm {:.4g}, but must be a unit quaternion [w, x, y, z]", q.norm()));
    else
      sensor.X_WS.rotation = q.normalized();
  }
  keys.refuse_unknown();
  sensor.X_WS.position = {position[0], position[1], position[2]};
  sensor.X_BS = sensor.X_WS;
  sensor.has_pose = true;
}

}  // namespace

Result<CameraFile> parse_camera_file(std::string_view text, const std::string& path) {
  const toml::parse_result parsed = toml::parse(text);
  if (!parsed)
    return fail(fmt::format("{}, line {}: {}", path, parsed.error().source().begin.line,
                            parsed.error().description()));
  const toml::table& table = parsed.table();
  std::string trouble;
  Keys keys(table, path, "", trouble);
  CameraFile file;
  RigSensor& sensor = file.sensor;
  Camera& camera = sensor.camera;
  constexpr int kSideMax = 65'535;
  constexpr double kFocalMax = 100'000;
  take_name(keys, sensor);
  keys.whole("width", camera.width, 1, kSideMax);
  keys.whole("height", camera.height, 1, kSideMax);
  keys.number("fx", camera.fx, true, 1, kFocalMax);
  keys.number("fy", camera.fy, true, 1, kFocalMax);
  keys.number("cx", camera.cx, true, -kSideMax, kSideMax);
  keys.number("cy", camera.cy, true, -kSideMax, kSideMax);
  keys.numbers("distortion", camera.distortion, false);
  keys.number("depth_unit_m", file.depth_unit_m, false, 1e-5, 1);
  keys.number("rate_hz", sensor.rate_hz, false, 0.01, 1000);
  take_trim(keys, sensor, table);
  sensor.has_pose = false;
  if (const toml::node* pose = keys.take("pose", false)) {
    if (const toml::table* inner = pose->as_table())
      take_pose(*inner, path, trouble, sensor);
    else
      keys.say(*pose, "pose", "must be a section [pose] with position and rotation");
  }
  keys.refuse_unknown();
  if (!trouble.empty()) return fail(trouble);
  return file;
}

}  // namespace wagonsight

#include "settings/settings.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>

#include "base/capacities.h"
#include "settings/table_reader.h"
#include "settings/wagon_settings.h"

namespace wagonsight {
namespace {

constexpr std::size_t kPathBytesMax = 1000;
constexpr std::size_t kDeviceBytesMax = 64;
constexpr std::size_t kSocketBytesMax = 107;  // what the system takes
constexpr std::size_t kTokenBytesMin = 16, kTokenBytesMax = 128;

// Relative paths start at the folder of the settings file.
std::string resolved(const std::string& path, std::string_view file_name) {
  const std::size_t slash = file_name.rfind('/');
  if (path.empty() || path.front() == '/' || slash == std::string_view::npos) return path;
  return std::string(file_name.substr(0, slash + 1)) + path;
}

void read_unit(const toml::table& table, Mistakes& mistakes, UnitSettings& unit) {
  TableReader reader(table, "unit", mistakes);
  std::string name;
  if (reader.text("name", name, Name::capacity())) unit.name.assign(name);
  reader.finish();
}

void read_pipeline(const toml::table& table, Mistakes& mistakes, PipelineSettings& pipeline) {
  TableReader reader(table, "pipeline", mistakes);
  reader.number("leaf_m", pipeline.leaf_m, 0.01, 0.10);
  reader.number("voxel_m", pipeline.voxel_m, 0.005, 0.20);
  reader.number("noise_sigmas", pipeline.noise_sigmas, 1, 10);
  reader.number("blob_area_min_m2", pipeline.blob_area_min_m2, 0, 1);
  reader.number("learning_s", pipeline.learning_s, 0, 3600);
  reader.number("fps_expected", pipeline.fps_expected, 0.1, 120);
  reader.boolean("compensate_skew", pipeline.compensate_skew);
  reader.finish();
}

void read_processing(const toml::table& table, Mistakes& mistakes, ProcessingSettings& processing) {
  TableReader reader(table, "processing", mistakes);
  std::int64_t workers = processing.workers;
  if (reader.integer("workers", workers, 0, 8)) processing.workers = static_cast<int>(workers);
  reader.finish();
}

void read_capture(const toml::table& table, Mistakes& mistakes, CaptureSettings& capture) {
  TableReader reader(table, "capture", mistakes);
  reader.choice("grouping", capture.grouping, {"hardware", "barrier"});
  reader.number("barrier_hz", capture.barrier_hz, 1, 60);
  if (reader.has("barrier_hz") && capture.grouping == "hardware")
    reader.refuse("barrier_hz", "belongs to grouping = \"barrier\"");
  reader.finish();
}

void read_stereo(const toml::table& table, Mistakes& mistakes, StereoSettings& stereo) {
  TableReader reader(table, "stereo", mistakes);
  reader.choice("mode", stereo.mode, {"fast", "accurate"});
  const auto whole = [&](std::string_view key, int& out, std::int64_t low, std::int64_t high) {
    std::int64_t value = out;
    if (reader.integer(key, value, low, high)) out = static_cast<int>(value);
  };
  whole("disparities", stereo.disparities, 32, 256);
  if (stereo.disparities % 32 != 0) reader.refuse("disparities", "must be a multiple of 32");
  whole("uniqueness_percent", stereo.uniqueness_percent, 0, 99);
  whole("texture_min", stereo.texture_min, 0, 2047);
  reader.number("whole_every_s", stereo.whole_every_s, 0.1, 3600);
  reader.number("aligned_every_s", stereo.aligned_every_s, 0, 86'400);
  reader.number("shutter_us_max", stereo.shutter_us_max, 100, 100'000);
  reader.number("gain_db_max", stereo.gain_db_max, 0, 48);
  reader.finish();
}

SensorSettings read_sensor(TableReader& reader, std::string_view file_name) {
  SensorSettings sensor;
  reader.require("name", "every sensor has the name that it has in the calibration blob");
  std::string name;
  if (reader.text("name", name, Name::capacity())) sensor.name.assign(name);
  reader.choice("kind", sensor.kind, {"kinect", "stereo"});
  reader.require("source", "must be \"device\", \"recording\" or \"simulated\"");
  std::string source = "recording";
  const bool is_known = reader.choice("source", source, {"device", "recording", "simulated"});
  sensor.source = source == "device"      ? SensorSource::kDevice
                  : source == "simulated" ? SensorSource::kSimulated
                                          : SensorSource::kRecording;
  reader.text("file", sensor.file, kPathBytesMax);
  reader.boolean("loop", sensor.loop);
  reader.text("device", sensor.device, kDeviceBytesMax);
  if (is_known && source == "recording")
    reader.require("file", "a recorded sensor needs its recording");
  if (source != "recording" && reader.has("file"))
    reader.refuse("file", "only a recorded sensor has a recording");
  if (source != "recording" && reader.has("loop"))
    reader.refuse("loop", "only a recording can be looped");
  if (source == "device")
    reader.require("device", "the serial number or the place that `wagonsight devices` tells");
  else if (reader.has("device"))
    reader.refuse("device", "belongs to source = \"device\"");
  reader.choice("trigger", sensor.trigger, {"free", "external", "together"});
  if (reader.has("trigger") && (source != "device" || sensor.kind != "stereo"))
    reader.refuse("trigger", "belongs to kind = \"stereo\" with source = \"device\"");
  sensor.file = resolved(sensor.file, file_name);
  std::array<double, 2> trim{};
  if (reader.numbers("trim_m", trim, 0, 65.535)) {
    if (trim[0] < trim[1])
      sensor.trim_m = trim;
    else
      reader.refuse("trim_m", "must be [near, far] with near below far");
  }
  reader.finish();
  return sensor;
}

void read_sensors(TableReader& root, std::string_view file_name, Mistakes& mistakes,
                  std::vector<SensorSettings>& sensors) {
  for (const toml::table* table : root.tables("sensor")) {
    TableReader reader(*table, fmt::format("sensor {}", sensors.size() + 1), mistakes);
    SensorSettings sensor = read_sensor(reader, file_name);
    const auto same_name = [&](const SensorSettings& other) { return other.name == sensor.name; };
    if (!sensor.name.empty() && std::any_of(sensors.begin(), sensors.end(), same_name))
      reader.refuse("name", "another sensor has this name");
    const auto other_end = [&](const SensorSettings& other) {
      return !sensor.file.empty() && other.file == sensor.file && other.loop != sensor.loop;
    };
    if (std::any_of(sensors.begin(), sensors.end(), other_end))
      reader.refuse("file", "another sensor has this recording; loop must be the same for both");
    if (sensors.size() == kSensorsMax)
      reader.refuse("name", fmt::format("there can be at most {} sensors", kSensorsMax));
    sensors.push_back(std::move(sensor));
  }
}

void read_rig(const toml::table& table, std::string_view file_name, Mistakes& mistakes,
              RigSettings& rig) {
  TableReader reader(table, "rig", mistakes);
  reader.text("blob", rig.blob, kPathBytesMax);
  rig.blob = resolved(rig.blob, file_name);
  reader.finish();
}

bool is_ipv4(std::string_view text) {
  int parts = 0;
  while (true) {
    const std::string_view part = text.substr(0, text.find('.'));
    const bool digits =
        !part.empty() && part.size() <= 3 &&
        std::all_of(part.begin(), part.end(), [](unsigned char c) { return std::isdigit(c) != 0; });
    if (!digits || std::stoi(std::string(part)) > 255) return false;
    ++parts;
    if (part.size() == text.size()) return parts == 4;
    text.remove_prefix(part.size() + 1);
  }
}

// Whether it can be one: what is left is the server's to say when it binds.
bool looks_like_ipv6(std::string_view text) {
  return text.size() <= 45 && std::count(text.begin(), text.end(), ':') >= 2 &&
         std::all_of(text.begin(), text.end(),
                     [](unsigned char c) { return std::isxdigit(c) != 0 || c == ':' || c == '.'; });
}

void read_web(const toml::table& table, Mistakes& mistakes, WebSettings& web) {
  TableReader reader(table, "web", mistakes);
  if (reader.text("host", web.host, 64) && !is_ipv4(web.host) && !looks_like_ipv6(web.host))
    reader.refuse("host", "must be a numeric address, such as 127.0.0.1 or 0.0.0.0");
  std::int64_t port = web.port;
  if (reader.integer("port", port, 0, 65'535)) web.port = static_cast<std::uint16_t>(port);
  reader.texts("host_names", web.host_names, 8, Name::capacity());
  reader.boolean("trusted_network", web.trusted_network);
  if (const toml::table* tokens = reader.table("tokens")) {
    TableReader secrets(*tokens, "web.tokens", mistakes);
    secrets.secret("read", web.read_token, kTokenBytesMin, kTokenBytesMax);
    secrets.secret("admin", web.admin_token, kTokenBytesMin, kTokenBytesMax);
    if (!web.read_token.empty() && web.read_token == web.admin_token)
      secrets.refuse_secret("admin", "must differ from the read token");
    secrets.finish();
  }
  reader.finish();
}

void read_recording(const toml::table& table, std::string_view file_name, Mistakes& mistakes,
                    RecordingSettings& recording) {
  TableReader reader(table, "recording", mistakes);
  reader.require("folder", "recordings need a folder");
  reader.text("folder", recording.folder, kPathBytesMax);
  recording.folder = resolved(recording.folder, file_name);
  reader.boolean("at_start", recording.at_start);
  reader.number("minutes", recording.minutes, 1, 10'080);
  reader.number("file_minutes", recording.file_minutes, 0.1, 1440);
  reader.number("memory_mb", recording.memory_mb, 8, 1024);
  reader.number("free_mb_min", recording.free_mb_min, 16, 1e7);
  reader.finish();
}

void read_vehicle(const toml::table& table, std::string_view file_name, Mistakes& mistakes,
                  VehicleSettings& vehicle) {
  TableReader reader(table, "vehicle", mistakes);
  reader.require("socket", "the train's signals come by a local socket");
  reader.text("socket", vehicle.socket, kSocketBytesMax);
  vehicle.socket = resolved(vehicle.socket, file_name);
  reader.number("silence_s", vehicle.silence_s, 0.5, 3600);
  reader.finish();
}

void read_thermal(const toml::table& table, std::string_view file_name, Mistakes& mistakes,
                  ThermalSettings& thermal) {
  TableReader reader(table, "thermal", mistakes);
  reader.text("folder", thermal.folder, kPathBytesMax);
  thermal.folder = resolved(thermal.folder, file_name);
  reader.number("warm_c", thermal.warm_c, 30, 120);
  reader.number("hot_c", thermal.hot_c, 30, 120);
  if (thermal.hot_c <= thermal.warm_c) reader.refuse("hot_c", "must be above warm_c");
  reader.number("warm_hz", thermal.warm_hz, 1, 120);
  reader.number("hot_hz", thermal.hot_hz, 1, 120);
  if (thermal.hot_hz > thermal.warm_hz) reader.refuse("hot_hz", "must not be above warm_hz");
  reader.number("hysteresis_c", thermal.hysteresis_c, 0.5, 30);
  reader.finish();
}

void read_demo(const toml::table& table, std::string_view file_name, Mistakes& mistakes,
               DemoSettings& demo) {
  TableReader reader(table, "demo", mistakes);
  reader.require("scene", "the simulated wagon is described by a scene");
  reader.text("scene", demo.scene, kPathBytesMax);
  demo.scene = resolved(demo.scene, file_name);
  std::int64_t seed = 1;
  if (reader.integer("seed", seed, 0, INT64_MAX)) demo.seed = static_cast<std::uint64_t>(seed);
  reader.number("speed", demo.speed, 0.01, 100);
  reader.finish();
}

// Rules that bind several sections.
void check_together(TableReader& root, const Settings& settings) {
  const auto is_simulated = [](const SensorSettings& s) {
    return s.source == SensorSource::kSimulated;
  };
  const bool simulated =
      std::any_of(settings.sensors.begin(), settings.sensors.end(), is_simulated);
  if (simulated && !root.has("demo"))
    root.refuse_secret("sensor", "a simulated sensor needs a [demo] section with a scene");
  const bool triggered =
      std::any_of(settings.sensors.begin(), settings.sensors.end(),
                  [](const SensorSettings& s) { return s.trigger == "together"; });
  if (triggered && settings.capture.grouping == "barrier")
    root.refuse_secret("capture",
                       "grouping = \"barrier\" has no ticks at which sensors with trigger = "
                       "\"together\" could be triggered; take \"free\" or \"external\"");
}

Settings read_all(const toml::table& file, std::string_view file_name, Mistakes& mistakes) {
  Settings settings;
  TableReader root(file, "", mistakes);
  if (const auto* unit = root.table("unit")) read_unit(*unit, mistakes, settings.unit);
  if (const auto* pipeline = root.table("pipeline"))
    read_pipeline(*pipeline, mistakes, settings.pipeline);
  if (const auto* processing = root.table("processing"))
    read_processing(*processing, mistakes, settings.processing);
  if (const auto* capture = root.table("capture"))
    read_capture(*capture, mistakes, settings.capture);
  if (const auto* stereo = root.table("stereo")) read_stereo(*stereo, mistakes, settings.stereo);
  settings.wagon = read_wagon(root, mistakes);
  read_sensors(root, file_name, mistakes, settings.sensors);
  if (const auto* rig = root.table("rig")) read_rig(*rig, file_name, mistakes, settings.rig);
  if (const auto* web = root.table("web")) read_web(*web, mistakes, settings.web);
  if (const auto* recording = root.table("recording"))
    read_recording(*recording, file_name, mistakes, settings.recording);
  if (const auto* vehicle = root.table("vehicle"))
    read_vehicle(*vehicle, file_name, mistakes, settings.vehicle);
  if (const auto* thermal = root.table("thermal"))
    read_thermal(*thermal, file_name, mistakes, settings.thermal);
  if (const auto* demo = root.table("demo")) read_demo(*demo, file_name, mistakes, settings.demo);
  check_together(root, settings);
  root.finish();
  return settings;
}

}  // namespace

bool WebSettings::on_loopback() const {
  return host.starts_with("127.") || host == "::1";
}

Result<Settings> parse_settings(std::string_view text, std::string_view file_name) {
  if (text.size() > kSettingsBytesMax)
    return fail(fmt::format("{}: {} bytes are more than the {} of any settings file", file_name,
                            text.size(), kSettingsBytesMax));
  const toml::parse_result file = toml::parse(text, file_name);
  Mistakes mistakes(file_name);
  if (!file) {
    mistakes.add(file.error().source(), "not TOML", file.error().description());
    return fail(mistakes.text());
  }
  Settings settings = read_all(file.table(), file_name, mistakes);
  if (!mistakes.empty()) return fail(mistakes.text());
  return settings;
}

}  // namespace wagonsight

#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/fixed_string.h"
#include "base/result.h"
#include "wagon/wagon.h"

// What a person decides about a unit, as one TOML file. config/wagonsight.toml is the commented
// reference. Degrees in the file, radians here; everything else as in the file.
namespace wagonsight {

struct UnitSettings {
  Name name = "wagon";  // of the unit or its wagon, shown on the page
};

// As PipelineOptions, whose names these are.
struct PipelineSettings {
  double leaf_m = 0.02;
  double voxel_m = 0.02;
  double noise_sigmas = 3.0;
  double blob_area_min_m2 = 0.01;
  double learning_s = 2.0;
  double fps_expected = 30.0;
  bool compensate_skew = true;
};

struct ProcessingSettings {
  // Threads that share the sensors of an instant; nothing that is told depends on it. 0: two where
  // there is a stereo camera and a second processor, else one.
  int workers = 0;
};

// How frames of several sensors become the frames of one instant; see modules/capture.
struct CaptureSettings {
  std::string grouping = "hardware";  // or "barrier", the paper's
  double barrier_hz = 19.0;           // of the barrier's timer
};

// Of every stereo camera of the unit; see modules/stereo.
struct StereoSettings {
  std::string mode = "fast";    // or "accurate"
  int disparities = 64;         // searched, in pixels: the nearest depth is focal * baseline / this
  int uniqueness_percent = 10;  // how much worse the second best match must be
  int texture_min = 4;          // gray levels of 4095 between neighbours; less is no texture
  double whole_every_s = 4.0;   // the whole image is matched at least this often
  double aligned_every_s = 5.0;  // the imagers' rows are compared this often; 0: never
  double shutter_us_max = 8000;  // the longest shutter that the exposure law may ask for
  double gain_db_max = 18;       // and the largest gain
};

enum class SensorSource : std::uint8_t { kDevice, kRecording, kSimulated };

struct SensorSettings {
  Name name;                    // as in the calibration blob
  std::string kind = "kinect";  // or "stereo"
  SensorSource source = SensorSource::kRecording;
  std::string file;    // of the recording; otherwise empty
  bool loop = false;   // the recording begins anew at its end
  std::string device;  // a Kinect's serial number or place ("3-1.2"), a camera's GUID
  // Of a stereo device: at its own pace, by a pulse at its input ("external"), or all of them at
  // one instant, in the middle of what the Kinects see ("together").
  std::string trigger = "free";
  std::optional<std::array<double, 2>> trim_m;  // near, far; instead of the blob's
};

struct RigSettings {
  std::string blob;  // the calibration blob; empty: none
};

struct WebSettings {
  std::string host = "127.0.0.1";  // a numeric address to listen on
  std::uint16_t port = 8080;
  std::vector<std::string> host_names;  // the unit is called by, besides numeric addresses
  std::string read_token, admin_token;  // empty: none
  bool trusted_network = false;         // tokens may cross it without TLS

  bool on_loopback() const;
};

// The recording of everything that the sensors see, for the depot. Off unless it is asked for.
struct RecordingSettings {
  std::string folder;         // empty: this unit cannot record
  bool at_start = false;      // one begins with the daemon
  double minutes = 60;        // it ends by itself after so long, and none may be asked for longer
  double file_minutes = 10;   // of each file
  double memory_mb = 64;      // of frames that wait for the disk, while it records
  double free_mb_min = 1024;  // is left on the disk; below, the recording ends
};

// The train's own signals; see platform/vehicle.
struct VehicleSettings {
  std::string socket;     // the path of the socket it tells them at; empty: none
  double silence_s = 10;  // a signal that was not repeated for so long is unknown again
};

// When the unit's computer gets hot, fewer instants are worked on, before it throttles by itself.
struct ThermalSettings {
  std::string folder = "/sys/class/thermal";  // its zones
  double warm_c = 80, hot_c = 90;             // degrees Celsius from which a band begins
  double warm_hz = 15, hot_hz = 5;            // instants a second that are worked on at most
  double hysteresis_c = 5;                    // so far below its beginning a band is left
};

struct DemoSettings {
  std::string scene;  // of the simulated wagon; empty: no sensor is simulated
  std::uint64_t seed = 1;
  double speed = 1.0;  // simulated seconds a second
};

struct Settings {
  UnitSettings unit;
  PipelineSettings pipeline;
  ProcessingSettings processing;
  CaptureSettings capture;
  StereoSettings stereo;
  std::optional<Wagon> wagon;           // nothing: taken from the scene, or found in the recording
  std::vector<SensorSettings> sensors;  // none, but a scene: all of the scene's, simulated
  RigSettings rig;
  WebSettings web;
  RecordingSettings recording;
  VehicleSettings vehicle;
  ThermalSettings thermal;
  DemoSettings demo;
};

// A settings file has a few kilobytes; more than this is none.
inline constexpr std::size_t kSettingsBytesMax = 1 << 20;

// Reads settings. `file_name` is for the messages and for relative paths, which start at the file's
// folder. The Error lists every mistake, one line each:
//     FILE:LINE: KEY = VALUE: RULE
// Unknown keys are mistakes, too, and get the nearest key that there is. Allocates.
Result<Settings> parse_settings(std::string_view text, std::string_view file_name);

// The same settings as text for a diagnosis, every secret replaced by "(removed)"; comments are
// lost. Empty when the text is not TOML.
std::string without_secrets(std::string_view text);

}  // namespace wagonsight

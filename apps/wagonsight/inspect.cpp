#include "inspect.h"

#include <fmt/format.h>

#include <cstring>

#include "commands.h"
#include "recording/mcap_format.h"
#include "rig/blob.h"

namespace wagonsight {
namespace {

struct InspectOptions {
  std::string file;
  bool json = false;
};

Report report_pose(const Rigid& pose) {
  Report report;
  report["position"] = {pose.position.x(), pose.position.y(), pose.position.z()};
  report["rotation"] = {pose.rotation.w(), pose.rotation.x(), pose.rotation.y(), pose.rotation.z()};
  return report;
}

void print_recording(const Report& report) {
  const auto bytes = report["bytes"].get<double>();
  const auto unpacked = report["unpacked_bytes"].get<double>();
  fmt::print(
      "{}: a recording of {:.1f} s with {} frames, {:.1f} MB ({:.1f} MB unpacked, {:.1f} to "
      "1)\n",
      report["file"].get<std::string>(), report["seconds"].get<double>(),
      report["frames"].get<std::uint64_t>(), bytes * 1e-6, unpacked * 1e-6, unpacked / bytes);
  const auto trouble = report["trouble"].get<std::string>();
  fmt::print("  {}\n", trouble.empty() ? "whole: every chunk was read and its sum is right"
                                       : "not whole: " + trouble);
  const Report origin = report.value("origin", Report::object());
  for (const auto& [key, value] : origin.items())
    fmt::print("  {}: {}\n", key, value.get<std::string>());
  for (const Report& sensor : report["sensors"])
    fmt::print(
        "  sensor {} ({}, {} x {}): {} frames at {:.1f} Hz, {} missing, {} damaged, longest "
        "gap {:.2f} s, {}\n",
        sensor["name"].get<std::string>(), sensor["kind"].get<std::string>(),
        sensor["width"].get<int>(), sensor["height"].get<int>(),
        sensor["frames"].get<std::uint64_t>(), sensor["rate_hz"].get<double>(),
        sensor["missing"].get<std::uint64_t>(), sensor["damaged"].get<std::uint64_t>(),
        sensor["longest_gap_s"].get<double>(),
        sensor["has_pose"].get<bool>() ? "pose known" : "no pose (the floor is found at replay)");
  for (const Report& topic : report["topics"]) fmt::print("  topic {}\n", topic.get<std::string>());
  for (const Report& name : report["attachments"])
    fmt::print("  attachment {}\n", name.get<std::string>());
}

void print_blob(const Report& report) {
  fmt::print("{}: a calibration blob (version {}) of {} sensors, {:.1f} MB, SHA-256 {}\n",
             report["file"].get<std::string>(), report["version"].get<int>(),
             report["sensors"].size(), report["bytes"].get<double>() * 1e-6,
             report["sha256"].get<std::string>());
  fmt::print("  made by {}; {}\n", report["made_by"].get<std::string>(),
             report["note"].get<std::string>());
  for (const Report& sensor : report["sensors"]) {
    const auto position = sensor["X_WS"]["position"].get<std::array<double, 3>>();
    fmt::print("  sensor {} ({}, {} x {}, f = {:.1f}, {:.1f}): ", sensor["name"].get<std::string>(),
               sensor["kind"].get<std::string>(), sensor["width"].get<int>(),
               sensor["height"].get<int>(), sensor["fx"].get<double>(), sensor["fy"].get<double>());
    if (sensor["has_pose"].get<bool>())
      fmt::print("at ({:.3f}, {:.3f}, {:.3f}) m", position[0], position[1], position[2]);
    else
      fmt::print("no pose");
    const auto rms = sensor["rms_px"].get<double>();
    fmt::print(", {}", rms > 0 ? fmt::format("calibrated to {:.3f} px RMS", rms)
                               : std::string("reprojection error not stated"));
    const Report& delay = sensor["stamp_delay_ms"];
    fmt::print(", {}\n", delay.is_null()
                             ? std::string("delay of its time stamps not measured")
                             : fmt::format("time stamps {:.1f} +- {:.1f} ms late",
                                           delay[0].get<double>(), delay[1].get<double>()));
  }
  fmt::print("  georeference: {}\n", report["georeference"].get<bool>() ? "present" : "none");
}

Result<void> inspect(const InspectOptions& options) {
  const auto file = open_input(options.file);
  if (!file) return tl::unexpected(file.error());
  const bool is_mcap =
      file->bytes().size() >= 5 && std::memcmp(file->bytes().data(), kMcapMagic.data(), 5) == 0;
  const auto report = is_mcap ? inspect_recording(options.file) : inspect_blob(options.file, *file);
  if (!report) return tl::unexpected(report.error());
  if (options.json)
    fmt::print("{}\n", report->dump(2));
  else if (is_mcap)
    print_recording(*report);
  else
    print_blob(*report);
  return {};
}

}  // namespace

Result<Report> inspect_blob(const std::string& path, const MappedFile& file) {
  const auto blob = open_blob(file.bytes());
  if (!blob)
    return fail(fmt::format("{} is neither a recording nor a calibration blob that can be used: {}",
                            path, blob.error().message));
  Report report;
  report["file"] = path;
  report["kind"] = "calibration blob";
  report["version"] = kBlobVersion;
  report["bytes"] = file.bytes().size();
  std::string sum;
  for (const std::uint8_t byte : blob->sha256) sum += fmt::format("{:02x}", byte);
  report["sha256"] = sum;
  report["made_by"] = std::string(blob->rig.provenance.made_by.view());
  report["note"] = std::string(blob->rig.provenance.note.view());
  report["created_unix"] = blob->rig.provenance.created_unix;
  report["georeference"] = blob->rig.georeference.present;
  report["sensors"] = Report::array();
  for (const RigSensor& sensor : blob->rig.sensors) {
    Report told;
    told["name"] = std::string(sensor.name.view());
    told["kind"] = sensor.kind == SensorKind::kStereo ? "stereo" : "kinect";
    told["width"] = sensor.camera.width;
    told["height"] = sensor.camera.height;
    told["fx"] = sensor.camera.fx;
    told["fy"] = sensor.camera.fy;
    told["cx"] = sensor.camera.cx;
    told["cy"] = sensor.camera.cy;
    told["distortion"] = sensor.camera.distortion;
    told["has_pose"] = sensor.has_pose;
    told["X_WS"] = report_pose(sensor.X_WS);
    told["trim_m"] = {sensor.trim_near, sensor.trim_far};
    told["rate_hz"] = sensor.rate_hz;
    told["rms_px"] = sensor.rms_px;
    told["stamp_delay_ms"] = nullptr;
    if (sensor.stamp_delay.is_known())
      told["stamp_delay_ms"] = {1e3 * sensor.stamp_delay.delay_s, 1e3 * sensor.stamp_delay.sigma_s};
    report["sensors"].push_back(told);
  }
  return report;
}

void add_inspect(CommandLine& line) {
  auto options = std::make_shared<InspectOptions>();
  CLI::App* command =
      line.app.add_subcommand("inspect", "Tell what is in a recording or a calibration blob");
  command->add_option("file", options->file, "The recording or the blob")->required();
  command->add_flag("--json", options->json, "One JSON object instead of words");
  command->callback([&line, options] { line.run = [options] { return inspect(*options); }; });
}

}  // namespace wagonsight

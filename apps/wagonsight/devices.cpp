#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "commands.h"

namespace wagonsight {
namespace {

namespace fs = std::filesystem;

struct DevicesOptions {
  std::string sysfs = "/sys";
  bool json = false;
};

// What one plugged-in camera says of itself.
struct Device {
  std::string kind;     // as in the settings
  std::string product;  // in words
  std::string id;       // serial number or GUID; empty when it has none
  std::string place;    // the kernel's name of the port
  std::string controller;
  double speed_mbit = 0;  // 0: not stated
};

std::string read_line(const fs::path& path) {
  std::ifstream file(path);
  std::string line;
  std::getline(file, line);
  return line;
}

struct KnownUsb {
  const char* vendor;
  const char* product;
  const char* name;
};
// The camera parts only; motor and audio of the same Kinect are not counted again.
constexpr KnownUsb kKinects[] = {{"045e", "02ae", "Kinect for Xbox 360"},
                                 {"045e", "02bf", "Kinect for Windows"}};

std::optional<std::string> kinect_name(const fs::path& device) {
  const std::string vendor = read_line(device / "idVendor");
  const std::string product = read_line(device / "idProduct");
  for (const KnownUsb& known : kKinects)
    if (vendor == known.vendor && product == known.product) return known.name;
  return std::nullopt;
}

// The PCI device a bus hangs on: two Kinects on one USB controller seldom both get their bandwidth.
std::string controller_of(const fs::path& device) {
  std::error_code trouble;
  std::string found;
  for (const fs::path& part : fs::weakly_canonical(device, trouble)) {
    const std::string name = part.string();
    if (std::count(name.begin(), name.end(), ':') == 2) found = name;  // 0000:00:14.0
  }
  return found;
}

std::vector<fs::path> sorted_entries(const fs::path& folder) {
  std::error_code trouble;
  std::vector<fs::path> entries;
  for (const auto& entry : fs::directory_iterator(folder, trouble)) entries.push_back(entry.path());
  std::sort(entries.begin(), entries.end());
  return entries;
}

std::vector<Device> find_kinects(const fs::path& sysfs) {
  std::vector<Device> devices;
  for (const fs::path& entry : sorted_entries(sysfs / "bus/usb/devices")) {
    const auto name = kinect_name(entry);
    if (!name) continue;
    Device device{"kinect",
                  *name,
                  read_line(entry / "serial"),
                  entry.filename().string(),
                  controller_of(entry),
                  0};
    // Some Kinects report a serial number of zeros, which tells nothing.
    if (device.id.find_first_not_of('0') == std::string::npos) device.id.clear();
    device.speed_mbit = std::strtod(read_line(entry / "speed").c_str(), nullptr);
    devices.push_back(device);
  }
  return devices;
}

std::vector<Device> find_firewire(const fs::path& sysfs) {
  std::vector<Device> devices;
  for (const fs::path& entry : sorted_entries(sysfs / "bus/firewire/devices")) {
    // IIDC cameras are units of specifier 0x00a02d (1394 TA); other units are disks and the like.
    if (read_line(entry / "units").find("0x00a02d") == std::string::npos) continue;
    const std::string product =
        read_line(entry / "vendor_name") + " " + read_line(entry / "model_name");
    devices.push_back({"stereo", product == " " ? "IIDC camera" : product,
                       read_line(entry / "guid"), entry.filename().string(), controller_of(entry),
                       0});
  }
  return devices;
}

nlohmann::ordered_json to_json(const std::vector<Device>& devices) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const Device& device : devices)
    list.push_back({{"kind", device.kind},
                    {"product", device.product},
                    {"id", device.id},
                    {"place", device.place},
                    {"controller", device.controller},
                    {"speed_mbit", device.speed_mbit}});
  return list;
}

void print_lines(const std::vector<Device>& devices, const fs::path& sysfs) {
  if (devices.empty()) {
    fmt::print(
        "# No Kinect and no FireWire camera is plugged in (looked in {}/bus/usb and "
        "{}/bus/firewire).\n"
        "# If one should be: check its power supply and its cable, then run this again.\n",
        sysfs.string(), sysfs.string());
    return;
  }
  std::size_t kinects = 0;
  std::size_t stereos = 0;
  for (const Device& device : devices) {
    const bool is_kinect = device.kind == "kinect";
    fmt::print("\n# {}, {}, at {}{}{}\n", device.product,
               device.id.empty() ? std::string("without a serial number") : "id " + device.id,
               device.place, device.controller.empty() ? "" : ", controller " + device.controller,
               device.speed_mbit > 0 ? fmt::format(", {:g} Mbit/s", device.speed_mbit) : "");
    if (is_kinect && device.speed_mbit > 0 && device.speed_mbit < 480)
      fmt::print("# It runs below 480 Mbit/s, which is too slow for depth: use another port.\n");
    const auto shares = std::count_if(devices.begin(), devices.end(), [&](const Device& other) {
      return other.kind == device.kind && other.controller == device.controller;
    });
    if (is_kinect && shares > 1 && !device.controller.empty())
      fmt::print("# {} Kinects share this controller; each needs most of one: spread them.\n",
                 shares);
    fmt::print("[[sensor]]\nname = \"{}{}\"\nkind = \"{}\"\nsource = \"device\"\ndevice = \"{}\"\n",
               is_kinect ? "k" : "s", is_kinect ? kinects++ : stereos++, device.kind,
               device.id.empty() ? device.place : device.id);
  }
}

Result<void> list_devices(const DevicesOptions& options) {
  const fs::path sysfs(options.sysfs);
  std::vector<Device> devices = find_kinects(sysfs);
  for (Device& camera : find_firewire(sysfs)) devices.push_back(std::move(camera));
  if (options.json)
    fmt::print("{}\n", to_json(devices).dump(2));
  else
    print_lines(devices, sysfs);
  return {};
}

}  // namespace

void add_devices(CommandLine& line) {
  auto options = std::make_shared<DevicesOptions>();
  CLI::App* command = line.app.add_subcommand(
      "devices", "List the cameras that are plugged in, as lines to paste into the settings");
  command->add_option("--sysfs", options->sysfs, "Where the kernel tells of its devices")
      ->capture_default_str();
  command->add_flag("--json", options->json, "A JSON list instead of lines");
  command->callback([&line, options] { line.run = [options] { return list_devices(*options); }; });
}

}  // namespace wagonsight

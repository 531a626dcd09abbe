#include "iidc/fire_nodes.h"

#include <dirent.h>
#include <fcntl.h>
#include <linux/firewire-cdev.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <span>

namespace wagonsight {
namespace {

using Rom = std::span<const std::uint32_t>;

// A directory's entries; empty when it is not inside the ROM.
Rom directory(Rom rom, std::size_t at) {
  if (at >= rom.size()) return {};
  const std::size_t count = rom[at] >> 16U;
  return at + count < rom.size() ? rom.subspan(at + 1, count) : Rom{};
}

unsigned key_of(std::uint32_t entry) {
  return entry >> 24U;
}
std::size_t target_of(Rom rom, const std::uint32_t& entry) {
  return static_cast<std::size_t>(&entry - rom.data()) + (entry & 0xffffffU);
}

// Would libdc1394 read a name of that leaf safely?
bool is_sound_leaf(Rom rom, std::size_t at) {
  return at < rom.size() && rom[at] >> 16U != 0 && at + (rom[at] >> 16U) < rom.size();
}

struct Verdict {
  bool is_camera = false, is_sound = true;
};

Verdict judge_unit(Rom rom, std::size_t at) {
  constexpr std::uint32_t kTradeAssociation = 0x00a02d, kPointGrey = 0x00b09d;
  Verdict verdict;
  const Rom unit = directory(rom, at);
  bool is_iidc = false;
  const std::uint32_t* dependent = nullptr;
  for (const std::uint32_t& entry : unit) {
    const std::uint32_t value = entry & 0xffffffU;
    if (key_of(entry) == 0x12) is_iidc = value == kTradeAssociation || value == kPointGrey;
    if (key_of(entry) == 0xd4) dependent = &entry;
  }
  if (!is_iidc || dependent == nullptr) return verdict;
  const Rom part = directory(rom, target_of(rom, *dependent));
  verdict.is_camera = !part.empty();
  verdict.is_sound = !part.empty();
  for (const std::uint32_t& entry : part)
    if (key_of(entry) == 0x81 || key_of(entry) == 0x82)
      verdict.is_sound = verdict.is_sound && is_sound_leaf(rom, target_of(rom, entry));
  return verdict;
}

Verdict judge(Rom rom) {
  constexpr std::uint32_t kBusName = 0x31333934;  // "1394"
  Verdict verdict;
  if (rom.size() < 6 || rom[0] >> 24U != 4 || rom[1] != kBusName) return verdict;
  for (const std::uint32_t& entry : directory(rom, 5)) {
    if (key_of(entry) != 0xd1) continue;
    const Verdict unit = judge_unit(rom, target_of(rom, entry));
    verdict.is_camera = verdict.is_camera || unit.is_camera;
    verdict.is_sound = verdict.is_sound && unit.is_sound;
  }
  return verdict;
}

void look_at(const std::string& path, FireNodes& found) {
  const int fd = open(path.c_str(), O_RDWR | O_CLOEXEC);
  if (fd < 0) {
    found.some_forbidden = found.some_forbidden || errno == EACCES || errno == EPERM;
    return;
  }
  std::array<std::uint32_t, 256> rom{};
  fw_cdev_get_info info{};
  info.version = 4;
  info.rom = reinterpret_cast<std::uintptr_t>(rom.data());
  info.rom_length = sizeof rom;
  const bool is_told = ioctl(fd, FW_CDEV_IOC_GET_INFO, &info) == 0;
  close(fd);
  if (!is_told) return;
  const Rom known(rom.data(), std::min<std::size_t>(info.rom_length / 4, rom.size()));
  const Verdict verdict = judge(known);
  found.some_malformed = found.some_malformed || !verdict.is_sound;
  found.nodes.push_back(
      {path, std::uint64_t{rom[3]} << 32U | rom[4], info.card, verdict.is_camera});
}

}  // namespace

const FireNode* FireNodes::find(std::uint64_t guid) const {
  const auto found = std::find_if(nodes.begin(), nodes.end(), [&](const FireNode& node) {
    return node.guid == guid && node.is_camera;
  });
  return found == nodes.end() ? nullptr : &*found;
}

int FireNodes::cameras_on(std::uint32_t card) const {
  return static_cast<int>(std::count_if(nodes.begin(), nodes.end(), [&](const FireNode& node) {
    return node.card == card && node.is_camera;
  }));
}

FireNodes find_fire_nodes() {
  FireNodes found;
  DIR* const folder = opendir("/dev");
  if (folder == nullptr) return found;
  while (const dirent* const entry = readdir(folder)) {
    const std::string_view name(static_cast<const char*>(entry->d_name));
    if (name.size() > 2 && name.substr(0, 2) == "fw" && name[2] >= '0' && name[2] <= '9')
      look_at("/dev/" + std::string(name), found);
  }
  closedir(folder);
  return found;
}

bool reset_fire_bus(const FireNode& node) {
  const int fd = open(node.path.c_str(), O_RDWR | O_CLOEXEC);
  if (fd < 0) return false;
  fw_cdev_initiate_bus_reset reset{};
  reset.type = FW_CDEV_SHORT_RESET;
  const bool done = ioctl(fd, FW_CDEV_IOC_INITIATE_BUS_RESET, &reset) == 0;
  close(fd);
  return done;
}

std::uint64_t parse_guid(std::string_view text) {
  constexpr std::size_t kDigits = 16;
  if (text.substr(0, 2) == "0x") text.remove_prefix(2);
  std::uint64_t guid = 0;
  const char* const end = text.data() + text.size();
  const auto [stopped, trouble] = std::from_chars(text.data(), end, guid, 16);
  return trouble == std::errc{} && stopped == end && text.size() == kDigits ? guid : 0;
}

}  // namespace wagonsight

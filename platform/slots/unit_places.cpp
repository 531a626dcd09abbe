#include "slots/unit_places.h"

#include <fmt/format.h>
#include <sys/mount.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <utility>

#include "linux/append_file.h"
#include "linux/files.h"
#include "slots/key_lines.h"

namespace wagonsight {
namespace {

constexpr std::size_t kFileBytesMax = 16'384;
constexpr const char* kBootMount = "/run/wagonsight-boot";

Result<std::optional<PublicKey>> read_optional_key(const std::string& path) {
  if (!file_exists(path)) return std::optional<PublicKey>();
  const auto text = read_file(path, kFileBytesMax);
  if (!text) return tl::unexpected(text.error());
  const auto key = read_key(*text, path);
  if (!key) return tl::unexpected(key.error());
  return std::optional<PublicKey>(*key);
}

// Files of /proc and /sys have no size.
std::string kernel_text(const std::string& path) {
  std::string text;
  if (std::FILE* file = std::fopen(path.c_str(), "re"); file != nullptr) {
    std::array<char, 4096> piece{};
    text.assign(piece.data(), std::fread(piece.data(), 1, piece.size(), file));
    (void)std::fclose(file);
  }
  return text;
}

}  // namespace

Result<ImageFacts> read_image_facts(const std::string& folder) {
  ImageFacts facts;
  if (const auto text = read_file(folder + "/release", kFileBytesMax)) {
    facts.version = line_value(*text, "version");
    facts.architecture = line_value(*text, "architecture");
    facts.index = leading_number<std::uint64_t>(line_value(*text, "index"));
  }
  auto update_key = read_optional_key(folder + "/update.pub");
  if (!update_key) return tl::unexpected(update_key.error());
  auto provision_key = read_optional_key(folder + "/provision.pub");
  if (!provision_key) return tl::unexpected(provision_key.error());
  facts.update_key = *update_key;
  facts.provision_key = *provision_key ? *provision_key : *update_key;
  return facts;
}

Result<std::string> partition_device(const std::string& name) {
  const std::string wanted = fmt::format("PARTNAME={}\n", name);
  std::error_code ignored;
  for (const auto& entry : std::filesystem::directory_iterator("/sys/class/block", ignored))
    if (kernel_text(entry.path().string() + "/uevent").find(wanted) != std::string::npos)
      return "/dev/" + entry.path().filename().string();
  return fail(fmt::format("there is no partition {}; is this a unit?", name));
}

Result<char> running_slot() {
  const std::string words = " " + kernel_text("/proc/cmdline");
  const std::size_t at = words.find(" slot=");
  if (at == std::string::npos || at + 6 >= words.size() ||
      (words[at + 6] != 'a' && words[at + 6] != 'b'))
    return fail("the kernel was not told which slot it runs from; is this a unit?");
  return words[at + 6];
}

std::string boot_id() {
  return kernel_text("/proc/sys/kernel/random/boot_id").substr(0, 36);
}

Result<BootPartition> BootPartition::open(const std::string& folder) {
  if (!folder.empty()) return BootPartition(folder, false);
  const auto device = partition_device("boot");
  if (!device) return tl::unexpected(device.error());
  if (auto made = make_folders(kBootMount); !made) return tl::unexpected(made.error());
  if (mount(device->c_str(), kBootMount, "vfat", MS_NOSUID | MS_NODEV | MS_NOEXEC, nullptr) != 0)
    return fail(
        fmt::format("the boot partition {} cannot be mounted: {}", *device, std::strerror(errno)));
  return BootPartition(kBootMount, true);
}

BootPartition::BootPartition(BootPartition&& other) noexcept
    : folder_(std::move(other.folder_)), is_ours_(std::exchange(other.is_ours_, false)) {}

BootPartition::~BootPartition() {
  if (is_ours_) umount2(folder_.c_str(), 0);
}

}  // namespace wagonsight

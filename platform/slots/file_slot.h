#pragma once

#include <map>
#include <memory>
#include <string>

#include "slots/slot_install.h"

namespace wagonsight {

// A slot as the unit has it: its root partition (or a file), and a folder for kernel and initramfs
// beside the loader's entries on the boot partition.
class FileSlot final : public Slot {
 public:
  // `boot_folder` is where the boot partition is mounted, to be written.
  FileSlot(char letter, std::string root_device, std::string boot_folder);
  ~FileSlot() override;
  FileSlot(const FileSlot&) = delete;
  FileSlot& operator=(const FileSlot&) = delete;

  Result<void> prepare(const BundlePart& part) override;
  Result<bool> read(std::string_view part, std::uint64_t offset,
                    std::span<std::byte> bytes) override;
  Result<void> write(std::string_view part, std::uint64_t offset,
                     std::span<const std::byte> bytes) override;
  Result<void> sync() override;
  Result<void> unlist() override;
  Result<void> list(std::string_view version, std::string_view options) override;

 private:
  Result<std::string> path_of(std::string_view part) const;
  Result<int> open_part(std::string_view part);

  char letter_;
  std::string root_device_, boot_folder_;
  std::map<std::string, int, std::less<>> open_;
};

}  // namespace wagonsight

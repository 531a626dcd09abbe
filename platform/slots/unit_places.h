#pragma once

#include <cstdint>
#include <string>

#include "base/result.h"
#include "update/bundle_check.h"

namespace wagonsight {

// Where everything of a unit is, and what it runs. Tests give folders and files.
struct UnitPlaces {
  std::string data = "/data";             // the data partition, mounted
  std::string facts = "/etc/wagonsight";  // of the image: `release`, `update.pub`, `provision.pub`
  std::string boot;                       // where the boot partition is mounted; empty: it is not
  std::string root_a, root_b;             // empty: the partitions of these names
  char running = 0;                       // the slot; 0: as the kernel was told
  std::string daemon = "wagonsightd";     // checks settings
};

// What the image says of itself: lines of `release`, made by scripts/image.
struct ImageFacts {
  std::string version = "unknown", architecture;
  std::uint64_t index = 0;
  std::optional<PublicKey> update_key,
      provision_key;  // the second is the first where it is not there
};

// A key that is there and cannot be read is an Error; one that is not there is none.
Result<ImageFacts> read_image_facts(const std::string& folder);

// /dev/... of the partition with this name; the Error says that there is none.
Result<std::string> partition_device(const std::string& name);

// The slot that the kernel's words name.
Result<char> running_slot();

// Differs after every start of the machine.
std::string boot_id();

// The boot partition, mounted to be written for as long as this lives.
class BootPartition {
 public:
  // Where it is mounted already (`folder` is not empty), nothing is mounted.
  static Result<BootPartition> open(const std::string& folder);
  BootPartition(BootPartition&& other) noexcept;
  BootPartition(const BootPartition&) = delete;
  BootPartition& operator=(const BootPartition&) = delete;
  BootPartition& operator=(BootPartition&&) = delete;
  ~BootPartition();
  const std::string& folder() const { return folder_; }

 private:
  BootPartition(std::string folder, bool is_ours) : folder_(std::move(folder)), is_ours_(is_ours) {}
  std::string folder_;
  bool is_ours_;
};

}  // namespace wagonsight

#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "base/result.h"
#include "slots/slot_install.h"

namespace wagonsight {

// What a unit keeps on its data partition: who it is, what it was provisioned with, and how far
// its updates have come. Whatever happens to it happens whole or not at all, a power cut included.
//
//   identity/name             the unit's name; taken once, kept for good
//   identity/update-index     of the newest version that was good here; only rises
//   unit/                     what it was provisioned with: unit.toml and what that names
//   unit/.provision-index     of the bundle that brought it; 0: unsigned
//   unit.next/                as unit/, checked; takes its place at the next start
//   reset-asked               a factory reset is to be made at the next start
//   calibration/              what a factory reset kept, until the next provisioning
class UnitData {
 public:
  // Says whether a folder can be provisioned from: what its settings say, and that all is there.
  using CheckFolder = std::function<Result<void>(const std::string& folder)>;

  UnitData(std::string folder, CheckFolder check);

  bool is_provisioned() const;
  std::string name() const;  // empty: it has none yet
  std::uint64_t update_index() const;
  std::uint64_t provision_index() const;

  // Never lowers it.
  Result<void> raise_update_index(std::uint64_t index);

  // Takes an unsigned folder, at once; only while the unit is not provisioned. With a file
  // SHA256SUMS its files must match. A file `name` names the unit; without one it is named
  // `name_if_none`.
  Result<void> take_folder(const std::string& source, const std::string& name_if_none);
  // Takes a checked bundle; it counts from the next settle() on.
  Result<void> take_bundle(const Manifest& manifest, const PartSource& source);

  // To be made before anything reads unit/: finishes what a bundle or a reset began.
  Result<void> settle();
  bool is_settled() const;

  // Asks for a factory reset at the next settle(): only the identity and the calibration stay.
  Result<void> ask_for_reset();

 private:
  Result<void> check_and_seal(const std::string& prepared);
  Result<void> keep_calibration(const std::string& prepared) const;
  Result<void> reset();
  std::string path(const char* name) const { return folder_ + "/" + name; }

  std::string folder_;
  CheckFolder check_;
};

}  // namespace wagonsight

#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <string_view>

#include "base/result.h"
#include "update/manifest.h"

// Puts an update into the slot that does not run.
namespace wagonsight {

// The one slot that may be written. It knows no way to the other one.
class Slot {
 public:
  virtual ~Slot() = default;
  // Before a part is written: that there is room for it, and nothing behind it.
  virtual Result<void> prepare(const BundlePart& part) = 0;
  // Fills `bytes` from the part's `offset` on; false when the part is shorter.
  virtual Result<bool> read(std::string_view part, std::uint64_t offset,
                            std::span<std::byte> bytes) = 0;
  virtual Result<void> write(std::string_view part, std::uint64_t offset,
                             std::span<const std::byte> bytes) = 0;
  // All that was written is on the disk, and what is read from now on comes from there.
  virtual Result<void> sync() = 0;
  // The loader does not know the slot any more, and this is on the disk.
  virtual Result<void> unlist() = 0;
  // The loader knows it, with three tries and before the running one; on the disk. `options` are
  // the kernel's words.
  virtual Result<void> list(std::string_view version, std::string_view options) = 0;
};

// Gives the payload: fills `bytes` from the part's `offset` on.
using PartSource = std::function<Result<void>(const BundlePart& part, std::uint64_t offset,
                                              std::span<std::byte> bytes)>;

struct InstallProgress {
  std::uint64_t chunks = 0;          // of the bundle
  std::uint64_t chunks_done = 0;     // written or found to be there
  std::uint64_t chunks_written = 0;  // of these; the rest was there from before
};

// Takes the slot from the loader, writes what differs chunk by chunk, reads everything back from
// the disk, and only then lists the slot. At whatever instant the power fails, the slot is either
// not listed or whole, and a second run goes on where the first one was. `tell` is called after
// every chunk. Holds two chunks.
Result<InstallProgress> install(const Manifest& manifest, const PartSource& source, Slot& slot,
                                const std::function<void(const InstallProgress&)>& tell = {});

}  // namespace wagonsight

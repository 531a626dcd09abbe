#pragma once

#include <cstdint>

#include "base/result.h"
#include "base/seqlock.h"
#include "snapshot/snapshot.h"
#include "snapshot/unit_info.h"

namespace wagonsight {

// What the daemon tells other processes: flat memory that it writes and they map read-only.
struct SharedBlock {
  static constexpr std::uint64_t kMagic = 0x31'6B'63'6F'6C'62'73'77;  // "wsblock1"
  std::uint64_t magic = kMagic;
  std::uint64_t size = sizeof(SharedBlock);
  UnitInfo unit;  // written before any reader is started
  Seqlock<Snapshot> snapshot;
  Seqlock<LogTail> log;
};

// The daemon's end: anonymous shared memory that is mapped writable here and sealed against every
// other writable mapping.
class SharedBlockWriter {
 public:
  static Result<SharedBlockWriter> create(const UnitInfo& unit);
  SharedBlockWriter(SharedBlockWriter&& other) noexcept;
  SharedBlockWriter(const SharedBlockWriter&) = delete;
  SharedBlockWriter& operator=(const SharedBlockWriter&) = delete;
  SharedBlockWriter& operator=(SharedBlockWriter&&) = delete;
  ~SharedBlockWriter();

  SharedBlock& block() { return *block_; }
  int fd() const { return fd_; }

 private:
  SharedBlockWriter(int fd, SharedBlock* block) : fd_(fd), block_(block) {}
  int fd_;
  SharedBlock* block_;
};

// A reader's end: maps `fd` for the rest of the process. The Error says when it is not this
// version's block.
Result<const SharedBlock*> map_shared_block(int fd);

}  // namespace wagonsight

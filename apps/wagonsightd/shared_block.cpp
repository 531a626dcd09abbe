#include "shared_block.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <new>
#include <utility>

#ifndef F_SEAL_FUTURE_WRITE
#define F_SEAL_FUTURE_WRITE 0x0010  // Linux 5.1; glibc's fcntl.h may lack it
#endif

namespace wagonsight {

Result<SharedBlockWriter> SharedBlockWriter::create(const UnitInfo& unit) {
  const auto failed = [](int fd, const char* step) {
    const std::string reason = std::strerror(errno);
    if (fd >= 0) close(fd);
    return fail(
        fmt::format("shared memory: {}: {}; free some memory and start again", step, reason));
  };
  const int fd = memfd_create("wagonsight-snapshot", MFD_CLOEXEC | MFD_ALLOW_SEALING);
  if (fd < 0) return failed(fd, "memfd_create");
  if (ftruncate(fd, sizeof(SharedBlock)) != 0) return failed(fd, "ftruncate");
  void* memory =
      mmap(nullptr, sizeof(SharedBlock), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_POPULATE, fd, 0);
  if (memory == MAP_FAILED) return failed(fd, "mmap");
  // Whoever gets the descriptor can read what we write, and can neither write nor shrink it.
  if (fcntl(fd, F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_FUTURE_WRITE | F_SEAL_SEAL) !=
      0) {
    munmap(memory, sizeof(SharedBlock));
    return failed(fd, "sealing");
  }
  auto* block = new (memory) SharedBlock;
  block->unit = unit;
  return SharedBlockWriter(fd, block);
}

SharedBlockWriter::SharedBlockWriter(SharedBlockWriter&& other) noexcept
    : fd_(std::exchange(other.fd_, -1)), block_(std::exchange(other.block_, nullptr)) {}

SharedBlockWriter::~SharedBlockWriter() {
  if (block_ != nullptr) munmap(block_, sizeof(SharedBlock));
  if (fd_ >= 0) close(fd_);
}

Result<const SharedBlock*> map_shared_block(int fd) {
  struct stat status {};
  if (fstat(fd, &status) != 0 || status.st_size != static_cast<off_t>(sizeof(SharedBlock)))
    return fail("shared memory: is not this version's; start daemon and readers of one build");
  void* memory = mmap(nullptr, sizeof(SharedBlock), PROT_READ, MAP_SHARED, fd, 0);
  if (memory == MAP_FAILED)
    return fail(fmt::format("shared memory: mmap: {}", std::strerror(errno)));
  const auto* block = static_cast<const SharedBlock*>(memory);
  if (block->magic != SharedBlock::kMagic || block->size != sizeof(SharedBlock))
    return fail("shared memory: is not this version's; start daemon and readers of one build");
  return block;
}

}  // namespace wagonsight

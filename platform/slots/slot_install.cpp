#include "slots/slot_install.h"

#include <fmt/format.h>

#include <vector>

namespace wagonsight {
namespace {

class Installation {
 public:
  Installation(const Manifest& manifest, const PartSource& source, Slot& slot,
               const std::function<void(const InstallProgress&)>& tell)
      : manifest_(manifest), source_(source), slot_(slot), tell_(tell), buffer_(kChunkBytes) {
    for (const BundlePart& part : manifest.parts) progress_.chunks += part.chunks.size();
  }

  Result<InstallProgress> run() {
    Result<void> done = slot_.unlist();
    for (const BundlePart& part : manifest_.parts)
      if (done) done = slot_.prepare(part);
    if (done) done = each_chunk([&](const Chunk& chunk) { return put(chunk); });
    if (done) done = slot_.sync();
    if (done) done = each_chunk([&](const Chunk& chunk) { return hold(chunk); });
    if (done) done = slot_.list(manifest_.version, manifest_.boot);
    if (!done) return tl::unexpected(done.error());
    return progress_;
  }

 private:
  struct Chunk {
    const BundlePart& part;
    std::size_t index;
    std::uint64_t offset;
    std::span<std::byte> bytes;
  };

  template <class Work>
  Result<void> each_chunk(const Work& work) {
    for (const BundlePart& part : manifest_.parts)
      for (std::size_t i = 0; i < part.chunks.size(); ++i) {
        const Chunk chunk{part, i, i * kChunkBytes,
                          std::span(buffer_).first(static_cast<std::size_t>(part.chunk_bytes(i)))};
        if (auto done = work(chunk); !done) return done;
      }
    return {};
  }

  // Whether the slot holds what the manifest says.
  Result<bool> is_there(const Chunk& chunk) {
    const auto read = slot_.read(chunk.part.name, chunk.offset, chunk.bytes);
    if (!read) return tl::unexpected(read.error());
    return *read && digest_of(chunk.bytes) == chunk.part.chunks[chunk.index];
  }

  Result<void> put(const Chunk& chunk) {
    const auto there = is_there(chunk);
    if (!there) return tl::unexpected(there.error());
    if (!*there) {
      if (auto given = source_(chunk.part, chunk.offset, chunk.bytes); !given) return given;
      // The bundle lay on a disk since it was checked.
      if (digest_of(chunk.bytes) != chunk.part.chunks[chunk.index])
        return fail(
            fmt::format("the stored bundle has decayed: chunk {} of part {} is not what was "
                        "signed; upload it again",
                        chunk.index + 1, chunk.part.name));
      if (auto written = slot_.write(chunk.part.name, chunk.offset, chunk.bytes); !written)
        return written;
      ++progress_.chunks_written;
    }
    ++progress_.chunks_done;
    if (tell_) tell_(progress_);
    return {};
  }

  Result<void> hold(const Chunk& chunk) {
    const auto there = is_there(chunk);
    if (!there) return tl::unexpected(there.error());
    if (!*there)
      return fail(
          fmt::format("the disk does not give back what was written: chunk {} of part {}; "
                      "the unit stays with what runs, and its disk needs replacing",
                      chunk.index + 1, chunk.part.name));
    return {};
  }

  const Manifest& manifest_;
  const PartSource& source_;
  Slot& slot_;
  const std::function<void(const InstallProgress&)>& tell_;
  std::vector<std::byte> buffer_;
  InstallProgress progress_;
};

}  // namespace

Result<InstallProgress> install(const Manifest& manifest, const PartSource& source, Slot& slot,
                                const std::function<void(const InstallProgress&)>& tell) {
  return Installation(manifest, source, slot, tell).run();
}

}  // namespace wagonsight

#include "slots/bundle_stage.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <vector>

#include "linux/append_file.h"
#include "slots/folders.h"

namespace wagonsight {
namespace {

constexpr std::size_t kSignatureAt = 24, kSignatureEnd = 88;
// What a power cut can cost of an upload.
constexpr std::uint64_t kUnsyncedMax = std::uint64_t{1} << 20U;
// Left on the data partition for everything else.
constexpr std::uint64_t kFreeBytesMin = std::uint64_t{2} << 20U;

tl::unexpected<Error> failed(const std::string& path, const char* what) {
  return fail(fmt::format("{}: {}: {}", path, what, std::strerror(errno)));
}

std::string signature_in(std::span<const std::byte> head) {
  if (head.size() < kSignatureEnd) return {};
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(head.data());
  return hex_text({bytes + kSignatureAt, kSignatureEnd - kSignatureAt});
}

// Calls `take` with piece after piece of the file; what it says ends that.
template <class Take>
Result<void> read_pieces(int fd, const std::string& path, const Take& take) {
  std::vector<std::byte> piece(kChunkBytes);
  for (std::uint64_t at = 0;;) {
    const ssize_t got = pread(fd, piece.data(), piece.size(), static_cast<off_t>(at));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return failed(path, "cannot be read");
    if (got == 0) return {};
    at += static_cast<std::uint64_t>(got);
    if (auto taken = take(std::span(piece).first(static_cast<std::size_t>(got))); !taken)
      return taken;
  }
}

}  // namespace

// ---- a stored bundle

StoredBundle::~StoredBundle() {
  close(fd_);
}

Result<std::unique_ptr<StoredBundle>> StoredBundle::open(const std::string& path,
                                                         const BundleRules& rules) {
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) return failed(path, "cannot be opened");
  std::unique_ptr<StoredBundle> bundle(new StoredBundle(path, fd));
  if (auto checked = bundle->check(rules); !checked) return tl::unexpected(checked.error());
  return bundle;
}

Result<void> StoredBundle::check(const BundleRules& rules) {
  const off_t size = lseek(fd_, 0, SEEK_END);
  BundleCheck check(rules, static_cast<std::uint64_t>(std::max<off_t>(size, 0)));
  auto done = read_pieces(fd_, path_, [&](auto piece) { return check.take(piece); });
  if (done) done = check.finish();
  if (!done) return done;
  manifest_ = *check.manifest();
  payload_start_ = check.payload_start();
  return {};
}

PartSource StoredBundle::source() const {
  return [this](const BundlePart& wanted, std::uint64_t offset,
                std::span<std::byte> bytes) -> Result<void> {
    std::uint64_t at = payload_start_ + offset;
    for (const BundlePart& part : manifest_.parts) {
      if (part.name == wanted.name) break;
      at += part.bytes;
    }
    while (!bytes.empty()) {
      const ssize_t got = pread(fd_, bytes.data(), bytes.size(), static_cast<off_t>(at));
      if (got < 0 && errno == EINTR) continue;
      if (got <= 0) return failed(path_, "cannot be read");
      at += static_cast<std::uint64_t>(got);
      bytes = bytes.subspan(static_cast<std::size_t>(got));
    }
    return {};
  };
}

// ---- a bundle that comes

BundleStage::BundleStage(std::string folder, BundleRules rules)
    : folder_(std::move(folder)), incoming_(folder_ + "/incoming"), rules_(std::move(rules)) {
  take_up();
}

BundleStage::~BundleStage() {
  close_file();
}

void BundleStage::close_file() {
  if (fd_ >= 0) close(fd_);
  fd_ = -1;
}

void BundleStage::take_up() {
  fd_ = ::open(incoming_.c_str(), O_RDWR | O_APPEND | O_CLOEXEC);
  if (fd_ < 0) return;
  check_.emplace(rules_);
  const auto taken = read_pieces(fd_, incoming_, [&](std::span<const std::byte> piece) {
    if (check_->taken_bytes() == 0) signature_ = signature_in(piece);
    return check_->take(piece);
  });
  if (!taken) return discard();
  if (check_->is_complete()) (void)complete();  // was cut between the last block and this
}

std::uint64_t BundleStage::received_bytes() const {
  return check_ ? check_->taken_bytes() : 0;
}

std::optional<std::string> BundleStage::bundle_path() const {
  const std::string path = folder_ + "/bundle";
  return file_exists(path) ? std::optional(path) : std::nullopt;
}

void BundleStage::discard() {
  close_file();
  check_.reset();
  signature_.clear();
  unlink(incoming_.c_str());
  unlink((folder_ + "/bundle").c_str());
}

Result<void> BundleStage::begin(std::uint64_t total_bytes, std::span<const std::byte> first) {
  discard();
  if (auto made = make_folders(folder_); !made) return made;
  fd_ = ::open(incoming_.c_str(), O_RDWR | O_APPEND | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
  if (fd_ < 0) return failed(incoming_, "cannot be made");
  check_.emplace(rules_, total_bytes);
  signature_ = signature_in(first);
  unsynced_bytes_ = 0;
  return sync_folder(folder_);
}

Result<void> BundleStage::take(std::uint64_t offset, std::uint64_t total_bytes,
                               std::span<const std::byte> bytes) {
  if (offset == 0) {
    if (auto begun = begin(total_bytes, bytes); !begun) return begun;
  } else if (!check_ || offset != check_->taken_bytes()) {
    return fail(fmt::format("the block begins at {}, but the next one wanted begins at {}", offset,
                            received_bytes()));
  }
  const bool was_known = check_->manifest() != nullptr;
  auto taken = check_->take(bytes);
  if (taken && !was_known && check_->manifest() != nullptr) {
    const auto room = free_disk_bytes(folder_);
    if (!room || *room < check_->bundle_bytes() + kFreeBytesMin)
      taken =
          fail(fmt::format("the bundle has {} bytes, for which the data partition has no room; "
                           "take recordings away first",
                           check_->bundle_bytes()));
  }
  if (taken) taken = keep(bytes);
  if (taken && check_->is_complete()) taken = complete();
  if (!taken) discard();
  return taken;
}

Result<void> BundleStage::keep(std::span<const std::byte> bytes) {
  unsynced_bytes_ += bytes.size();
  while (!bytes.empty()) {
    const ssize_t put = write(fd_, bytes.data(), bytes.size());
    if (put < 0 && errno == EINTR) continue;
    if (put < 0) return failed(incoming_, "cannot be written");
    bytes = bytes.subspan(static_cast<std::size_t>(put));
  }
  if (unsynced_bytes_ < kUnsyncedMax) return {};
  unsynced_bytes_ = 0;
  if (fdatasync(fd_) != 0) return failed(incoming_, "cannot be written to the disk");
  return {};
}

Result<void> BundleStage::complete() {
  if (fsync(fd_) != 0) return failed(incoming_, "cannot be written to the disk");
  close_file();
  check_.reset();
  signature_.clear();
  const std::string whole = folder_ + "/bundle";
  if (std::rename(incoming_.c_str(), whole.c_str()) != 0) return failed(whole, "cannot be made");
  return sync_folder(folder_);
}

}  // namespace wagonsight

#include "linux/files.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>

namespace wagonsight {
namespace {

class Descriptor {
 public:
  explicit Descriptor(int fd) : fd_(fd) {}
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  ~Descriptor() {
    if (fd_ >= 0) ::close(fd_);
  }
  int get() const { return fd_; }
  bool valid() const { return fd_ >= 0; }
  // Closes now and says whether that went well: a full disk may only show here.
  bool close() {
    const int fd = std::exchange(fd_, -1);
    return ::close(fd) == 0;
  }

 private:
  int fd_;
};

tl::unexpected<Error> failed(const std::string& path, const char* what) {
  return fail(fmt::format("{}: {}: {}", path, what, std::strerror(errno)));
}

// The size of a regular file, or why it cannot be used as one.
Result<std::size_t> size_of(const Descriptor& file, const std::string& path) {
  struct stat status {};
  if (fstat(file.get(), &status) != 0) return failed(path, "cannot be examined");
  if (!S_ISREG(status.st_mode)) return fail(fmt::format("{}: is not a regular file", path));
  return static_cast<std::size_t>(status.st_size);
}

bool write_all(int fd, std::span<const std::byte> bytes) {
  while (!bytes.empty()) {
    const ssize_t written = ::write(fd, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) return false;
    bytes = bytes.subspan(static_cast<std::size_t>(written));
  }
  return true;
}

std::string directory_of(const std::string& path) {
  const std::size_t slash = path.rfind('/');
  if (slash == std::string::npos) return ".";
  return slash == 0 ? "/" : path.substr(0, slash);
}

// A rename lasts only when its directory was written.
Result<void> sync_directory_of(const std::string& path) {
  const std::string directory = directory_of(path);
  const Descriptor fd(::open(directory.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (!fd.valid()) return failed(directory, "cannot be opened");
  if (fsync(fd.get()) != 0) return failed(directory, "cannot be written to the disk");
  return {};
}

}  // namespace

Result<std::string> read_file(const std::string& path, std::size_t bytes_max) {
  const Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (!file.valid()) return failed(path, "cannot be opened");
  const auto size = size_of(file, path);
  if (!size) return fail(size.error().message);
  if (*size > bytes_max)
    return fail(
        fmt::format("{}: has {} bytes, more than the {} that are read", path, *size, bytes_max));
  std::string text(*size, '\0');
  std::size_t done = 0;
  while (done < text.size()) {
    const ssize_t got = ::read(file.get(), text.data() + done, text.size() - done);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return failed(path, "cannot be read");
    if (got == 0) break;  // it was cut meanwhile
    done += static_cast<std::size_t>(got);
  }
  text.resize(done);
  return text;
}

Result<void> write_file_durably(const std::string& path, std::span<const std::byte> bytes) {
  const std::string temporary = path + ".new";
  {
    constexpr mode_t kMode = 0644;
    Descriptor file(::open(temporary.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, kMode));
    if (!file.valid()) return failed(temporary, "cannot be created");
    const bool written = write_all(file.get(), bytes) && fsync(file.get()) == 0;
    if (!written || !file.close()) {
      const auto error = failed(temporary, "cannot be written");
      ::unlink(temporary.c_str());
      return error;
    }
  }
  if (std::rename(temporary.c_str(), path.c_str()) != 0) {
    const auto error = failed(path, "cannot be replaced");
    ::unlink(temporary.c_str());
    return error;
  }
  return sync_directory_of(path);
}

MappedFile::~MappedFile() {
  if (!bytes_.empty()) ::munmap(const_cast<std::byte*>(bytes_.data()), bytes_.size());
}

Result<MappedFile> MappedFile::open(const std::string& path, Pages pages) {
  const Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (!file.valid()) return failed(path, "cannot be opened");
  const auto size = size_of(file, path);
  if (!size) return fail(size.error().message);
  MappedFile mapped;
  if (*size == 0) return mapped;
  const int flags = MAP_PRIVATE | (pages == Pages::kResident ? MAP_POPULATE : 0);
  void* memory = ::mmap(nullptr, *size, PROT_READ, flags, file.get(), 0);
  if (memory == MAP_FAILED) return failed(path, "cannot be mapped");
  mapped.bytes_ = {static_cast<const std::byte*>(memory), *size};
  return mapped;
}

void MappedFile::let_go(std::size_t count) const {
  const auto page = static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
  const std::size_t whole = std::min(count, bytes_.size()) / page * page;
  // Nothing is lost when this fails; the pages only stay.
  if (whole > 0)
    (void)::madvise(const_cast<std::byte*>(bytes_.data()), whole, MADV_DONTNEED);  // NOLINT
}

Result<CheckedFile> open_file_or_previous(const std::string& path, const FileCheck& check) {
  std::string refusals;
  for (const std::string& candidate : {path, path + ".previous"}) {
    auto file = MappedFile::open(candidate);
    if (!file) {
      refusals += (refusals.empty() ? "" : "; ") + file.error().message;
      continue;
    }
    if (const auto checked = check(file->bytes()); !checked) {
      refusals +=
          fmt::format("{}{}: {}", refusals.empty() ? "" : "; ", candidate, checked.error().message);
      continue;
    }
    return CheckedFile{std::move(*file), candidate, refusals};
  }
  return fail(refusals);
}

Result<void> replace_file_keeping_previous(const std::string& path,
                                           std::span<const std::byte> bytes) {
  const std::string previous = path + ".previous", link = previous + ".new";
  ::unlink(link.c_str());
  // A second name for the old file first: it is never without one.
  if (::link(path.c_str(), link.c_str()) == 0) {
    if (std::rename(link.c_str(), previous.c_str()) != 0)
      return failed(previous, "cannot be replaced");
    // When both were the same file already, rename does nothing and leaves the link.
    ::unlink(link.c_str());
  } else if (errno != ENOENT) {
    return failed(previous, "cannot be created");
  }
  return write_file_durably(path, bytes);
}

}  // namespace wagonsight

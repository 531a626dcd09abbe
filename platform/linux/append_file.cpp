#include "linux/append_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

namespace wagonsight {
namespace {

constexpr mode_t kFileMode = 0640;  // images of people
constexpr mode_t kFolderMode = 0750;

tl::unexpected<Error> failed(const std::string& path, const char* what) {
  return fail(fmt::format("{}: {}: {}", path, what, std::strerror(errno)));
}

}  // namespace

Result<std::unique_ptr<AppendFile>> AppendFile::create(const std::string& path) {
  const int fd = ::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, kFileMode);
  if (fd < 0) return failed(path, "cannot be created");
  std::unique_ptr<AppendFile> file(new AppendFile(path, fd));
  const std::size_t slash = path.rfind('/');
  const std::string folder = slash == std::string::npos ? "." : path.substr(0, slash + 1);
  const int folder_fd = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  const bool is_durable = folder_fd >= 0 && fsync(folder_fd) == 0;
  if (folder_fd >= 0) ::close(folder_fd);
  if (!is_durable) return failed(folder, "cannot be written to the disk");
  return file;
}

AppendFile::~AppendFile() {
  ::close(fd_);
}

Result<void> AppendFile::append(std::span<const std::byte> bytes) {
  while (!bytes.empty()) {
    const ssize_t written = ::write(fd_, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) return failed(path_, "cannot be written");
    bytes = bytes.subspan(static_cast<std::size_t>(written));
  }
  return {};
}

Result<void> AppendFile::sync() {
  if (fdatasync(fd_) != 0) return failed(path_, "cannot be written to the disk");
  return {};
}

Result<void> AppendFile::cut_to(std::uint64_t size) {
  const auto end = static_cast<off_t>(size);
  if (ftruncate(fd_, end) != 0 || lseek(fd_, end, SEEK_SET) != end)
    return failed(path_, "cannot be cut");
  return {};
}

Result<std::uint64_t> free_disk_bytes(const std::string& folder) {
  struct statvfs disk {};
  if (statvfs(folder.c_str(), &disk) != 0) return failed(folder, "cannot be examined");
  return std::uint64_t{disk.f_bavail} * disk.f_frsize;
}

Result<void> make_folders(const std::string& folder) {
  for (std::size_t end = folder.find('/', 1);; end = folder.find('/', end + 1)) {
    const std::string part = folder.substr(0, end);
    if (::mkdir(part.c_str(), kFolderMode) != 0 && errno != EEXIST)
      return failed(part, "cannot be made");
    if (end == std::string::npos) return {};
  }
}

bool file_exists(const std::string& path) {
  return ::access(path.c_str(), F_OK) == 0;
}

}  // namespace wagonsight

#include "slots/folders.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>

namespace wagonsight {
namespace {

namespace fs = std::filesystem;

Result<void> failed(const std::string& path, const char* what) {
  return fail(fmt::format("{}: {}: {}", path, what, std::strerror(errno)));
}

Result<void> sync_path(const std::string& path, int flags) {
  const int fd = open(path.c_str(), O_RDONLY | O_CLOEXEC | flags);
  if (fd < 0) return failed(path, "cannot be opened");
  const bool synced = fsync(fd) == 0;
  const auto answer = synced ? Result<void>{} : failed(path, "cannot be written to the disk");
  close(fd);
  return answer;
}

}  // namespace

Result<void> sync_folder(const std::string& folder) {
  return sync_path(folder, O_DIRECTORY);
}

Result<void> sync_tree(const std::string& folder) {
  std::error_code error;
  for (const auto& entry : fs::recursive_directory_iterator(folder, error))
    if (!entry.is_symlink())
      if (auto synced = sync_path(entry.path().string(), entry.is_directory() ? O_DIRECTORY : 0);
          !synced)
        return synced;
  if (error) return fail(fmt::format("{}: cannot be read: {}", folder, error.message()));
  return sync_folder(folder);
}

Result<void> remove_tree(const std::string& path) {
  std::error_code error;
  fs::remove_all(path, error);
  if (error) return fail(fmt::format("{}: cannot be removed: {}", path, error.message()));
  return {};
}

Result<void> replace_folder(const std::string& prepared, const std::string& name) {
  if (renameat2(AT_FDCWD, prepared.c_str(), AT_FDCWD, name.c_str(), RENAME_EXCHANGE) != 0) {
    if (errno != ENOENT) return failed(name, "cannot be replaced");
    if (std::rename(prepared.c_str(), name.c_str()) != 0)
      return failed(prepared, "cannot be renamed");
  }
  if (auto synced = sync_folder(fs::path(name).parent_path().string()); !synced) return synced;
  return remove_tree(prepared);  // what was there before
}

}  // namespace wagonsight

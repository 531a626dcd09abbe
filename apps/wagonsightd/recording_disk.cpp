#include "recording_disk.h"

#include "linux/append_file.h"

namespace wagonsight {
namespace {

class SystemFile final : public RecordingFile {
 public:
  explicit SystemFile(std::unique_ptr<AppendFile> file) : file_(std::move(file)) {}
  Result<void> append(std::span<const std::byte> bytes) override { return file_->append(bytes); }
  Result<void> sync() override { return file_->sync(); }
  Result<void> cut_to(std::uint64_t size) override { return file_->cut_to(size); }

 private:
  std::unique_ptr<AppendFile> file_;
};

class SystemDisk final : public RecordingDisk {
 public:
  Result<void> make_folder(const std::string& folder) override { return make_folders(folder); }
  bool exists(const std::string& path) override { return file_exists(path); }
  Result<std::unique_ptr<RecordingFile>> create(const std::string& path) override {
    auto file = AppendFile::create(path);
    if (!file) return tl::unexpected(file.error());
    return std::make_unique<SystemFile>(std::move(*file));
  }
  Result<std::uint64_t> free_bytes(const std::string& folder) override {
    return free_disk_bytes(folder);
  }
};

}  // namespace

RecordingDisk& system_disk() {
  static SystemDisk disk;
  return disk;
}

}  // namespace wagonsight

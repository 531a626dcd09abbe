#pragma once

#include <cstddef>
#include <cstdio>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/result.h"
#include "recording/byte_sink.h"

namespace wagonsight {

// A file mapped for reading, page by page as it is used: a recording may be larger than the
// memory. Its bytes are page-aligned and stay as long as the object.
class InputFile {
 public:
  static Result<InputFile> open(const std::string& path);
  InputFile(InputFile&& other) noexcept;
  InputFile(const InputFile&) = delete;
  InputFile& operator=(const InputFile&) = delete;
  InputFile& operator=(InputFile&&) = delete;
  ~InputFile();

  std::span<const std::byte> bytes() const { return bytes_; }
  std::string_view text() const {
    return {reinterpret_cast<const char*>(bytes_.data()), bytes_.size()};
  }

 private:
  explicit InputFile(std::span<const std::byte> bytes) : bytes_(bytes) {}
  std::span<const std::byte> bytes_;
};

// A file that is written from its beginning. Every write goes to the system at once; close() says
// whether all of it arrived. A file that is not closed is taken away again: a job that failed
// leaves nothing that looks like an answer.
class OutputFile final : public ByteSink {
 public:
  static Result<std::unique_ptr<OutputFile>> create(const std::string& path);
  ~OutputFile() override;
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;

  Result<void> write(std::span<const std::byte> bytes) override;
  Result<void> write(std::string_view text) {
    return write(std::as_bytes(std::span(text.data(), text.size())));
  }
  Result<void> close();
  // For a recording, of which every whole chunk can be read.
  void keep_when_unfinished() { removes_unfinished_ = false; }

 private:
  OutputFile(std::string path, int descriptor, bool is_regular)
      : path_(std::move(path)), descriptor_(descriptor), removes_unfinished_(is_regular) {}
  std::string path_;
  int descriptor_ = -1;
  bool removes_unfinished_;  // never a device or a pipe
};

// Writes the whole file. The Error names it and says why.
Result<void> write_file(const std::string& path, std::span<const std::byte> bytes);
inline Result<void> write_file(const std::string& path, std::string_view text) {
  return write_file(path, std::as_bytes(std::span(text.data(), text.size())));
}

// Makes the folder (and those above it) when it is not there.
Result<void> make_folder(const std::string& path);

}  // namespace wagonsight

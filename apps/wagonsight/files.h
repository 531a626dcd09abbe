#pragma once

#include <cstddef>
#include <cstdio>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/result.h"
#include "linux/files.h"
#include "recording/byte_sink.h"

namespace wagonsight {

// What a command reads, be it a recording larger than the memory.
inline Result<MappedFile> open_input(const std::string& path) {
  return MappedFile::open(path, MappedFile::Pages::kOnDemand);
}

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

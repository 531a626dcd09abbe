#pragma once

#include <memory>
#include <string>

#include "base/result.h"
#include "files.h"
#include "recording/recording_reader.h"

namespace wagonsight {

// A recording on the disk: the mapped file and its reader, kept together.
struct RecordingFile {
  std::string path;
  std::unique_ptr<MappedFile> file;
  std::unique_ptr<RecordingReader> reader;
};

// Every Error begins with the path.
Result<RecordingFile> open_recording(const std::string& path, DamagePolicy policy);

// How many frames it holds: by its summary where there is one, 0 where that is not known.
std::uint64_t frame_count_hint(const RecordingReader& reader);

// What an operator must know of a recording that is not whole or had damaged chunks; empty when all
// is well. Call it after reading.
std::string recording_trouble(const RecordingFile& recording);

}  // namespace wagonsight

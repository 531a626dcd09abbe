#include "recording_file.h"

#include <fmt/format.h>

namespace wagonsight {

Result<RecordingFile> open_recording(const std::string& path, DamagePolicy policy) {
  auto file = open_input(path);
  if (!file) return tl::unexpected(file.error());
  RecordingFile recording;
  recording.path = path;
  recording.file = std::make_unique<MappedFile>(std::move(*file));
  auto reader = RecordingReader::open(recording.file->bytes(), policy);
  if (!reader) return fail(fmt::format("{} {}", path, reader.error().message));
  recording.reader = std::move(*reader);
  return recording;
}

std::uint64_t frame_count_hint(const RecordingReader& reader) {
  return reader.stated_frame_count();
}

std::string recording_trouble(const RecordingFile& recording) {
  const McapReader& mcap = recording.reader->mcap();
  std::string text;
  if (!mcap.complete())
    text = fmt::format(
        "{} has no end (a power cut, or a copy that stopped); its {} whole chunks were read",
        recording.path, mcap.segments().size());
  const McapCursor& cursor = recording.reader->cursor();
  if (cursor.damaged_chunks() > 0)
    text +=
        fmt::format("{}{}: {} damaged chunks were left out, the last: {}", text.empty() ? "" : "; ",
                    recording.path, cursor.damaged_chunks(), cursor.last_damage());
  return text;
}

}  // namespace wagonsight

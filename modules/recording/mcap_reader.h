#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/result.h"
#include "recording/mcap_format.h"

namespace wagonsight {

// Where messages lie in the file: a chunk, or a run of messages outside of chunks.
struct McapSegment {
  std::uint64_t offset = 0, length = 0;  // of the chunk record, or of the whole run
  bool is_chunk = true;
  std::uint64_t start_time = 0, end_time = 0;  // log times; 0 for runs
  std::uint64_t uncompressed_size = 0;
};

// An opened MCAP file: what it holds and where. Uses the summary when the file has a sound one;
// otherwise (a power cut, a copy that stopped, a damaged end) scans the records from the start and
// keeps every whole one. `file` (a mapped file) must outlive the reader. Allocates.
class McapReader {
 public:
  // The Error: too short, not MCAP, a version that is not known, no whole header.
  static Result<McapReader> open(std::span<const std::byte> file);

  // False when the file ends before its end mark; everything up to whole_bytes() is readable.
  bool complete() const { return complete_; }
  std::uint64_t whole_bytes() const { return whole_bytes_; }

  const std::string& profile() const { return profile_; }
  const std::string& library() const { return library_; }
  const std::vector<McapSchema>& schemas() const { return schemas_; }
  const std::vector<McapChannel>& channels() const { return channels_; }
  const std::vector<McapMetadata>& metadata() const { return metadata_; }
  const std::vector<McapSegment>& segments() const { return segments_; }
  std::span<const std::byte> file() const { return file_; }

  // Messages of a channel by the summary's statistics; 0 where they do not tell.
  std::uint64_t stated_message_count(std::uint16_t channel_id) const;

  const McapSchema* find_schema(std::uint16_t id) const;
  // The value of `key` in the metadata record `name`; empty when there is none.
  std::string_view metadata_value(std::string_view name, std::string_view key) const;

  std::vector<std::string> attachment_names() const;
  // The first attachment of that name: nothing when there is none, an Error when it is damaged.
  Result<std::optional<McapAttachment>> find_attachment(std::string_view name) const;

 private:
  bool read_summary();
  bool read_summary_record(McapOpcode opcode, std::span<const std::byte> content);
  void scan();
  void scan_chunk(std::uint64_t offset, std::uint64_t length, std::span<const std::byte> content);
  void take_schema_or_channel(McapOpcode opcode, std::span<const std::byte> content);
  void take_statistics(std::span<const std::byte> content);
  void clear();

  std::span<const std::byte> file_;
  std::size_t data_begin_ = 0;
  bool complete_ = false;
  std::uint64_t whole_bytes_ = 0;
  std::string profile_, library_;
  std::vector<McapSchema> schemas_;
  std::vector<McapChannel> channels_;
  std::vector<McapMetadata> metadata_;
  std::vector<McapSegment> segments_;
  std::vector<std::pair<std::uint16_t, std::uint64_t>> message_counts_;  // by channel
  std::uint64_t message_count_ = 0;
  std::vector<McapAttachment> attachments_;  // views into the file
  std::vector<bool> attachment_is_sound_;
  std::vector<std::byte> buffer_;  // scan only
};

enum class DamagePolicy : std::uint8_t {
  kStop,  // a damaged chunk is an Error
  kSkip,  // it is left out and counted
};

// Walks the messages in the order of the file. Its memory is one unpacked chunk, reused; a message
// is valid until the next call.
class McapCursor {
 public:
  McapCursor(const McapReader& reader, DamagePolicy policy) : reader_(&reader), policy_(policy) {}

  // False at the end. An Error names the chunk: its number, its place and what is wrong with it;
  // the next call goes on behind it.
  Result<bool> next(McapMessage& message);
  void rewind();
  // Goes on with segment `index` of the reader.
  void seek(std::size_t index);

  std::size_t segment_index() const { return segment_; }  // of what next() will read from
  std::uint64_t damaged_chunks() const { return damaged_; }
  const std::string& last_damage() const { return last_damage_; }

 private:
  Result<void> open_segment();

  const McapReader* reader_;
  DamagePolicy policy_;
  std::size_t segment_ = 0;
  bool is_open_ = false;
  std::span<const std::byte> records_;
  std::size_t position_ = 0;
  std::vector<std::byte> buffer_;
  std::uint64_t damaged_ = 0;
  std::string last_damage_;
};

}  // namespace wagonsight

#include "recording/mcap_reader.h"

#include <fmt/format.h>

#include <algorithm>

#include "recording/little_endian.h"
#include "recording/mcap_records.h"

namespace wagonsight {
namespace {

bool has_magic(std::span<const std::byte> bytes) {
  return bytes.size() >= kMcapMagic.size() &&
         std::memcmp(bytes.data(), kMcapMagic.data(), kMcapMagic.size()) == 0;
}

constexpr std::size_t kVersionAt = 5;

}  // namespace

Result<McapReader> McapReader::open(std::span<const std::byte> file) {
  if (file.empty()) return fail("is empty; nothing was recorded");
  if (file.size() < kMcapMagic.size() ||
      std::memcmp(file.data(), kMcapMagic.data(), kVersionAt) != 0)
    return fail("is not an MCAP recording (it does not begin with the MCAP mark)");
  if (!has_magic(file))
    return fail(
        fmt::format("is MCAP of version '{}', and only version '0' is known; convert it or "
                    "update this program",
                    static_cast<char>(file[kVersionAt])));
  McapReader reader;
  reader.file_ = file;
  std::size_t offset = kMcapMagic.size();
  const auto header = read_record(file, offset);
  if (!header || header->opcode != McapOpcode::kHeader)
    return fail("is an MCAP recording that ends within its header; nothing in it can be read");
  ByteReader fields(header->content);
  reader.profile_ = fields.text();
  reader.library_ = fields.text();
  reader.data_begin_ = offset;
  if (!reader.read_summary()) {
    reader.clear();
    reader.scan();
  }
  return reader;
}

void McapReader::clear() {
  schemas_.clear();
  channels_.clear();
  metadata_.clear();
  segments_.clear();
  message_counts_.clear();
  attachments_.clear();
  attachment_is_sound_.clear();
}

void McapReader::take_schema_or_channel(McapOpcode opcode, std::span<const std::byte> content) {
  const auto take_new = [](auto& known, auto decoded) {
    if (!decoded) return;
    const auto same = [&](const auto& other) { return other.id == decoded->id; };
    if (std::none_of(known.begin(), known.end(), same)) known.push_back(std::move(*decoded));
  };
  if (opcode == McapOpcode::kSchema) take_new(schemas_, decode_schema(content));
  if (opcode == McapOpcode::kChannel) take_new(channels_, decode_channel(content));
}

// The record a summary points at; false when it is not where the summary says.
bool McapReader::read_summary_record(McapOpcode opcode, std::span<const std::byte> content) {
  ByteReader fields(content);
  if (opcode == McapOpcode::kSchema || opcode == McapOpcode::kChannel) {
    take_schema_or_channel(opcode, content);
    return true;
  }
  if (opcode == McapOpcode::kChunkIndex) {
    McapSegment segment;
    segment.start_time = fields.number<std::uint64_t>();
    segment.end_time = fields.number<std::uint64_t>();
    segment.offset = fields.number<std::uint64_t>();
    segment.length = fields.number<std::uint64_t>();
    fields.raw(fields.number<std::uint32_t>());  // offsets of the message indexes
    fields.number<std::uint64_t>();              // their length
    fields.text();                               // compression
    fields.number<std::uint64_t>();              // compressed size
    segment.uncompressed_size = fields.number<std::uint64_t>();
    segments_.push_back(segment);
    return fields.ok() && segment.offset <= file_.size() &&
           segment.length <= file_.size() - segment.offset;
  }
  if (opcode == McapOpcode::kAttachmentIndex || opcode == McapOpcode::kMetadataIndex) {
    const auto offset = fields.number<std::uint64_t>();
    if (!fields.ok() || offset >= file_.size()) return false;
    auto at = static_cast<std::size_t>(offset);
    const auto record = read_record(file_, at);
    if (!record) return false;
    if (opcode == McapOpcode::kMetadataIndex) {
      auto metadata = decode_metadata(record->content);
      if (metadata) metadata_.push_back(std::move(*metadata));
      return record->opcode == McapOpcode::kMetadata && metadata.has_value();
    }
    auto attachment = decode_attachment(record->content);
    if (record->opcode != McapOpcode::kAttachment || !attachment) return false;
    attachments_.push_back(std::move(attachment->attachment));
    attachment_is_sound_.push_back(attachment->sound);
  }
  return true;
}

void McapReader::take_statistics(std::span<const std::byte> content) {
  ByteReader fields(content);
  message_count_ = fields.number<std::uint64_t>();
  // Counts of schemas, channels, attachments, metadata and chunks, then first and last log time.
  fields.raw(2 + 4 + 4 + 4 + 4 + 8 + 8);
  ByteReader counts(fields.raw(fields.number<std::uint32_t>()));
  while (counts.remaining() > 0) {
    const auto id = counts.number<std::uint16_t>();
    const auto count = counts.number<std::uint64_t>();
    if (!counts.ok()) return;
    message_counts_.emplace_back(id, count);
  }
}

std::uint64_t McapReader::stated_message_count(std::uint16_t channel_id) const {
  for (const auto& [id, count] : message_counts_)
    if (id == channel_id) return count;
  return 0;
}

bool McapReader::read_summary() {
  const std::size_t tail = kMcapFooterBytes + kMcapMagic.size();
  if (file_.size() < data_begin_ + tail) return false;
  if (!has_magic(file_.last(kMcapMagic.size()))) return false;
  const std::size_t footer_at = file_.size() - tail;
  std::size_t offset = footer_at;
  const auto record = read_record(file_, offset);
  if (!record || record->opcode != McapOpcode::kFooter) return false;
  const auto footer = decode_footer(record->content);
  if (!footer || footer->summary_start == 0 || footer->summary_start > footer_at) return false;

  const auto begin = static_cast<std::size_t>(footer->summary_start);
  const std::size_t crc_bytes = sizeof footer->summary_crc;
  const auto summed = file_.subspan(begin, footer_at + kMcapFooterBytes - crc_bytes - begin);
  if (footer->summary_crc != 0 && footer->summary_crc != mcap_crc32(summed)) return false;

  offset = begin;
  while (offset < footer_at) {
    const auto entry = read_record(file_.first(footer_at), offset);
    if (!entry || !read_summary_record(entry->opcode, entry->content)) return false;
    if (entry->opcode == McapOpcode::kStatistics) take_statistics(entry->content);
  }
  // Messages outside of chunks are in no index.
  if (segments_.empty() && message_count_ > 0) return false;
  std::sort(segments_.begin(), segments_.end(),
            [](const McapSegment& a, const McapSegment& b) { return a.offset < b.offset; });
  complete_ = true;
  whole_bytes_ = file_.size();
  return true;
}

void McapReader::scan_chunk(std::uint64_t offset, std::uint64_t length,
                            std::span<const std::byte> content) {
  McapSegment segment{.offset = offset, .length = length};
  if (const auto chunk = decode_chunk(content)) {
    segment.start_time = chunk->start_time;
    segment.end_time = chunk->end_time;
    segment.uncompressed_size = chunk->uncompressed_size;
    // Other writers put schemas and channels into chunks only. A damaged chunk stays in the list:
    // whoever reads it says so.
    if (const auto records = unpack_chunk(*chunk, buffer_)) {
      std::size_t at = 0;
      while (const auto record = read_record(*records, at))
        take_schema_or_channel(record->opcode, record->content);
    }
  }
  segments_.push_back(segment);
}

void McapReader::scan() {
  std::size_t offset = data_begin_;
  bool at_end = false;
  while (!at_end) {
    const std::size_t begin = offset;
    const auto record = read_record(file_, offset);
    if (!record) break;
    const std::uint64_t length = offset - begin;
    switch (record->opcode) {
      case McapOpcode::kChunk:
        scan_chunk(begin, length, record->content);
        break;
      case McapOpcode::kMessage:
        if (!segments_.empty() && !segments_.back().is_chunk &&
            segments_.back().offset + segments_.back().length == begin)
          segments_.back().length += length;
        else
          segments_.push_back({.offset = begin, .length = length, .is_chunk = false});
        break;
      case McapOpcode::kAttachment:
        if (auto attachment = decode_attachment(record->content)) {
          attachments_.push_back(std::move(attachment->attachment));
          attachment_is_sound_.push_back(attachment->sound);
        }
        break;
      case McapOpcode::kMetadata:
        if (auto metadata = decode_metadata(record->content))
          metadata_.push_back(std::move(*metadata));
        break;
      case McapOpcode::kDataEnd:
      case McapOpcode::kFooter:
        at_end = true;
        break;
      default:
        take_schema_or_channel(record->opcode, record->content);
    }
  }
  whole_bytes_ = offset;
  complete_ = at_end && has_magic(file_.last(kMcapMagic.size()));
  buffer_ = {};
}

const McapSchema* McapReader::find_schema(std::uint16_t id) const {
  const auto found = std::find_if(schemas_.begin(), schemas_.end(),
                                  [&](const McapSchema& schema) { return schema.id == id; });
  return found == schemas_.end() ? nullptr : &*found;
}

std::string_view McapReader::metadata_value(std::string_view name, std::string_view key) const {
  for (const McapMetadata& metadata : metadata_) {
    if (metadata.name != name) continue;
    for (const auto& [known, value] : metadata.values)
      if (known == key) return value;
  }
  return {};
}

std::vector<std::string> McapReader::attachment_names() const {
  std::vector<std::string> names;
  for (const McapAttachment& attachment : attachments_) names.push_back(attachment.name);
  return names;
}

Result<std::optional<McapAttachment>> McapReader::find_attachment(std::string_view name) const {
  for (std::size_t i = 0; i < attachments_.size(); ++i) {
    if (attachments_[i].name != name) continue;
    if (!attachment_is_sound_[i])
      return fail(fmt::format("has a damaged attachment \"{}\" (its CRC does not match)", name));
    return std::optional(attachments_[i]);
  }
  return std::optional<McapAttachment>();
}

void McapCursor::rewind() {
  seek(0);
  damaged_ = 0;
}

void McapCursor::seek(std::size_t index) {
  segment_ = index;
  is_open_ = false;
}

Result<void> McapCursor::open_segment() {
  const McapSegment& segment = reader_->segments()[segment_];
  const auto bytes = reader_->file().subspan(static_cast<std::size_t>(segment.offset),
                                             static_cast<std::size_t>(segment.length));
  position_ = 0;
  records_ = {};
  is_open_ = true;
  if (!segment.is_chunk) {
    records_ = bytes;
    return {};
  }
  std::size_t at = 0;
  const auto record = read_record(bytes, at);
  const auto chunk =
      record && record->opcode == McapOpcode::kChunk ? decode_chunk(record->content) : std::nullopt;
  std::string trouble = "is damaged (there is no chunk where one should be)";
  if (chunk) {
    auto records = unpack_chunk(*chunk, buffer_);
    if (records) {
      records_ = *records;
      return {};
    }
    trouble = records.error().message;
  }
  ++damaged_;
  last_damage_ = fmt::format("chunk {} of {} at byte {} {}", segment_ + 1,
                             reader_->segments().size(), segment.offset, trouble);
  return fail(last_damage_);
}

Result<bool> McapCursor::next(McapMessage& message) {
  while (segment_ < reader_->segments().size()) {
    if (!is_open_) {
      auto opened = open_segment();
      if (!opened && policy_ == DamagePolicy::kStop) {
        seek(segment_ + 1);
        return tl::unexpected(opened.error());
      }
    }
    while (position_ < records_.size()) {
      const auto record = read_record(records_, position_);
      if (!record) break;
      if (record->opcode != McapOpcode::kMessage) continue;
      const auto decoded = decode_message(record->content);
      if (!decoded) continue;
      message = *decoded;
      return true;
    }
    seek(segment_ + 1);
  }
  return false;
}

}  // namespace wagonsight

#include "recording/mcap_writer.h"

#include <zlib.h>
#include <zstd.h>

#include <algorithm>

#include "base/check.h"

namespace wagonsight {
namespace {

// Opens a record; the returned place gets its length when the content is there.
std::size_t begin_record(ByteWriter& out, McapOpcode opcode) {
  out.number(static_cast<std::uint8_t>(opcode));
  return out.reserve<std::uint64_t>();
}

void end_record(ByteWriter& out, std::size_t length_at) {
  out.patch(length_at, static_cast<std::uint64_t>(out.size() - length_at - sizeof(std::uint64_t)));
}

void append_pairs(ByteWriter& out, const McapPairs& pairs) {
  const std::size_t length_at = out.reserve<std::uint32_t>();
  for (const auto& [key, value] : pairs) {
    out.text(key);
    out.text(value);
  }
  out.patch(length_at, static_cast<std::uint32_t>(out.size() - length_at - sizeof(std::uint32_t)));
}

void free_zstd(ZSTD_CCtx_s* context) {
  ZSTD_freeCCtx(context);
}

}  // namespace

std::uint32_t mcap_crc32(std::span<const std::byte> bytes, std::uint32_t crc) {
  return static_cast<std::uint32_t>(
      crc32_z(crc, reinterpret_cast<const unsigned char*>(bytes.data()), bytes.size()));
}

McapWriter::McapWriter(ByteSink& sink, const McapWriterOptions& options)
    : sink_(sink), options_(options), zstd_(ZSTD_createCCtx(), free_zstd) {
  WS_CHECK(zstd_ != nullptr, "no memory for zstd at level %d", options.zstd_level);
  ZSTD_CCtx_setParameter(zstd_.get(), ZSTD_c_compressionLevel, options.zstd_level);
  // One image may pass the limit before the group ends.
  open_chunk_.reserve_bytes(options.chunk_bytes * 2);
  chunks_.reserve(1024);
}

McapWriter::~McapWriter() = default;

Result<std::unique_ptr<McapWriter>> McapWriter::create(ByteSink& sink,
                                                       const McapWriterOptions& options) {
  std::unique_ptr<McapWriter> writer(new McapWriter(sink, options));
  ByteWriter& record = writer->record_;
  record.raw(std::as_bytes(std::span(kMcapMagic)));
  const std::size_t header = begin_record(record, McapOpcode::kHeader);
  record.text(options.profile);
  record.text(options.library);
  end_record(record, header);
  if (auto done = writer->emit(record.bytes()); !done) return tl::unexpected(done.error());
  return writer;
}

Result<void> McapWriter::emit(std::span<const std::byte> bytes) {
  data_crc_ = mcap_crc32(bytes, data_crc_);
  offset_ += bytes.size();
  return sink_.write(bytes);
}

Result<std::uint16_t> McapWriter::add_schema(std::string_view name, std::string_view encoding,
                                             std::string_view data) {
  const std::uint16_t id = ++schema_count_;
  record_.clear();
  const std::size_t schema = begin_record(record_, McapOpcode::kSchema);
  record_.number(id);
  record_.text(name);
  record_.text(encoding);
  record_.text(data);
  end_record(record_, schema);
  schemas_.raw(record_.bytes());
  if (auto done = emit(record_.bytes()); !done) return tl::unexpected(done.error());
  return id;
}

Result<std::uint16_t> McapWriter::add_channel(std::uint16_t schema_id, std::string_view topic,
                                              std::string_view message_encoding,
                                              const McapPairs& metadata) {
  WS_CHECK(schema_id >= 1 && schema_id <= schema_count_, "schema %d of %d", schema_id,
           schema_count_);
  const auto id = static_cast<std::uint16_t>(channel_states_.size());
  channel_states_.emplace_back().index.reserve(16);
  record_.clear();
  const std::size_t channel = begin_record(record_, McapOpcode::kChannel);
  record_.number(id);
  record_.number(schema_id);
  record_.text(topic);
  record_.text(message_encoding);
  append_pairs(record_, metadata);
  end_record(record_, channel);
  channels_.raw(record_.bytes());
  if (auto done = emit(record_.bytes()); !done) return tl::unexpected(done.error());
  return id;
}

void McapWriter::add_message(const McapMessage& message,
                             std::initializer_list<std::span<const std::byte>> parts) {
  WS_CHECK(!finished_ && message.channel_id < channel_states_.size(), "channel %d of %zu",
           message.channel_id, channel_states_.size());
  ChannelState& channel = channel_states_[message.channel_id];
  channel.index.push_back({message.log_time, open_chunk_.size()});
  ++channel.message_count;

  const std::size_t record = begin_record(open_chunk_, McapOpcode::kMessage);
  open_chunk_.number(message.channel_id);
  open_chunk_.number(message.sequence);
  open_chunk_.number(message.log_time);
  open_chunk_.number(message.publish_time);
  for (const auto part : parts) open_chunk_.raw(part);
  end_record(open_chunk_, record);

  const bool first = message_count_ == 0;
  start_time_ = first ? message.log_time : std::min(start_time_, message.log_time);
  end_time_ = first ? message.log_time : std::max(end_time_, message.log_time);
  chunk_start_ = chunk_has_messages_ ? std::min(chunk_start_, message.log_time) : message.log_time;
  chunk_end_ = chunk_has_messages_ ? std::max(chunk_end_, message.log_time) : message.log_time;
  chunk_has_messages_ = true;
  ++message_count_;
}

Result<void> McapWriter::end_group() {
  const auto span_ns = static_cast<std::uint64_t>(options_.chunk_duration.count());
  if (open_chunk_.size() < options_.chunk_bytes && chunk_end_ - chunk_start_ < span_ns) return {};
  return close_chunk();
}

Result<void> McapWriter::close_chunk() {
  if (open_chunk_.empty()) return {};
  const auto records = open_chunk_.bytes();
  message_bytes_ += records.size();
  compressed_.resize(std::max(compressed_.size(), ZSTD_compressBound(records.size())));
  const std::size_t compressed_size = ZSTD_compress2(
      zstd_.get(), compressed_.data(), compressed_.size(), records.data(), records.size());
  WS_CHECK(ZSTD_isError(compressed_size) == 0U, "zstd: %s", ZSTD_getErrorName(compressed_size));

  ChunkIndex chunk{.start_time = chunk_start_,
                   .end_time = chunk_end_,
                   .offset = offset_,
                   .compressed_size = compressed_size,
                   .uncompressed_size = records.size(),
                   .index_offsets = {}};
  record_.clear();
  const std::size_t record = begin_record(record_, McapOpcode::kChunk);
  record_.number(chunk_start_);
  record_.number(chunk_end_);
  record_.number(chunk.uncompressed_size);
  record_.number(mcap_crc32(records));
  record_.text("zstd");
  record_.number(chunk.compressed_size);
  record_.raw(std::span(compressed_).first(compressed_size));
  end_record(record_, record);
  chunk.length = record_.size();
  append_message_indexes(chunk);
  chunks_.push_back(std::move(chunk));
  open_chunk_.clear();
  chunk_has_messages_ = false;
  chunk_start_ = chunk_end_ = 0;
  return emit(record_.bytes());
}

void McapWriter::append_message_indexes(ChunkIndex& chunk) {
  for (std::size_t id = 0; id < channel_states_.size(); ++id) {
    auto& index = channel_states_[id].index;
    if (index.empty()) continue;
    chunk.index_offsets.emplace_back(static_cast<std::uint16_t>(id), offset_ + record_.size());
    const std::size_t record = begin_record(record_, McapOpcode::kMessageIndex);
    record_.number(static_cast<std::uint16_t>(id));
    record_.number(static_cast<std::uint32_t>(index.size() * sizeof(IndexEntry)));
    for (const IndexEntry& entry : index) {
      record_.number(entry.log_time);
      record_.number(entry.offset);
    }
    end_record(record_, record);
    index.clear();
  }
  chunk.index_length = record_.size() - chunk.length;
}

Result<void> McapWriter::add_attachment(const McapAttachment& attachment) {
  record_.clear();
  const std::size_t record = begin_record(record_, McapOpcode::kAttachment);
  const std::size_t content = record_.size();
  record_.number(attachment.log_time);
  record_.number(attachment.create_time);
  record_.text(attachment.name);
  record_.text(attachment.media_type);
  record_.number(static_cast<std::uint64_t>(attachment.data.size()));
  record_.raw(attachment.data);
  record_.number(mcap_crc32(record_.bytes().subspan(content)));
  end_record(record_, record);

  const std::size_t index = begin_record(attachments_, McapOpcode::kAttachmentIndex);
  attachments_.number(offset_);
  attachments_.number(static_cast<std::uint64_t>(record_.size()));
  attachments_.number(attachment.log_time);
  attachments_.number(attachment.create_time);
  attachments_.number(static_cast<std::uint64_t>(attachment.data.size()));
  attachments_.text(attachment.name);
  attachments_.text(attachment.media_type);
  end_record(attachments_, index);
  ++attachment_count_;
  return emit(record_.bytes());
}

Result<void> McapWriter::add_metadata(const McapMetadata& metadata) {
  record_.clear();
  const std::size_t record = begin_record(record_, McapOpcode::kMetadata);
  record_.text(metadata.name);
  append_pairs(record_, metadata.values);
  end_record(record_, record);

  const std::size_t index = begin_record(metadata_, McapOpcode::kMetadataIndex);
  metadata_.number(offset_);
  metadata_.number(static_cast<std::uint64_t>(record_.size()));
  metadata_.text(metadata.name);
  end_record(metadata_, index);
  ++metadata_count_;
  return emit(record_.bytes());
}

void McapWriter::append_chunk_indexes() {
  for (const ChunkIndex& chunk : chunks_) {
    const std::size_t record = begin_record(summary_, McapOpcode::kChunkIndex);
    summary_.number(chunk.start_time);
    summary_.number(chunk.end_time);
    summary_.number(chunk.offset);
    summary_.number(chunk.length);
    constexpr std::size_t kPairBytes = sizeof(std::uint16_t) + sizeof(std::uint64_t);
    summary_.number(static_cast<std::uint32_t>(chunk.index_offsets.size() * kPairBytes));
    for (const auto& [id, offset] : chunk.index_offsets) {
      summary_.number(id);
      summary_.number(offset);
    }
    summary_.number(chunk.index_length);
    summary_.text("zstd");
    summary_.number(chunk.compressed_size);
    summary_.number(chunk.uncompressed_size);
    end_record(summary_, record);
  }
}

void McapWriter::append_statistics() {
  const std::size_t record = begin_record(summary_, McapOpcode::kStatistics);
  summary_.number(message_count_);
  summary_.number(schema_count_);
  summary_.number(static_cast<std::uint32_t>(channel_states_.size()));
  summary_.number(attachment_count_);
  summary_.number(metadata_count_);
  summary_.number(static_cast<std::uint32_t>(chunks_.size()));
  summary_.number(start_time_);
  summary_.number(end_time_);
  const std::size_t counts = summary_.reserve<std::uint32_t>();
  for (std::size_t id = 0; id < channel_states_.size(); ++id) {
    summary_.number(static_cast<std::uint16_t>(id));
    summary_.number(channel_states_[id].message_count);
  }
  summary_.patch(counts,
                 static_cast<std::uint32_t>(summary_.size() - counts - sizeof(std::uint32_t)));
  end_record(summary_, record);
}

void McapWriter::append_summary_offset(McapOpcode group, std::size_t group_begin) {
  if (summary_.size() == group_begin) return;
  const std::size_t record = begin_record(summary_offset_, McapOpcode::kSummaryOffset);
  summary_offset_.number(static_cast<std::uint8_t>(group));
  summary_offset_.number(offset_ + group_begin);
  summary_offset_.number(static_cast<std::uint64_t>(summary_.size() - group_begin));
  end_record(summary_offset_, record);
}

Result<void> McapWriter::finish() {
  WS_CHECK(!finished_, "a recording of %zu chunks is finished twice", chunks_.size());
  if (auto done = close_chunk(); !done) return done;
  finished_ = true;

  record_.clear();
  const std::size_t data_end = begin_record(record_, McapOpcode::kDataEnd);
  record_.number(data_crc_);
  end_record(record_, data_end);
  if (auto done = emit(record_.bytes()); !done) return done;

  const auto add_group = [&](McapOpcode opcode, const auto& append) {
    const std::size_t begin = summary_.size();
    append();
    append_summary_offset(opcode, begin);
  };
  add_group(McapOpcode::kSchema, [&] { summary_.raw(schemas_.bytes()); });
  add_group(McapOpcode::kChannel, [&] { summary_.raw(channels_.bytes()); });
  add_group(McapOpcode::kChunkIndex, [&] { append_chunk_indexes(); });
  add_group(McapOpcode::kAttachmentIndex, [&] { summary_.raw(attachments_.bytes()); });
  add_group(McapOpcode::kMetadataIndex, [&] { summary_.raw(metadata_.bytes()); });
  add_group(McapOpcode::kStatistics, [&] { append_statistics(); });

  const std::uint64_t summary_start = offset_;
  const std::uint64_t summary_offset_start = offset_ + summary_.size();
  summary_.raw(summary_offset_.bytes());
  const std::size_t footer = begin_record(summary_, McapOpcode::kFooter);
  summary_.number(summary_start);
  summary_.number(summary_offset_start);
  summary_.patch(footer, std::uint64_t{8 + 8 + 4});  // part of what the sum covers
  summary_.number(mcap_crc32(summary_.bytes()));
  summary_.raw(std::as_bytes(std::span(kMcapMagic)));
  return emit(summary_.bytes());
}

}  // namespace wagonsight

#pragma once

#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <memory>
#include <span>
#include <string_view>
#include <vector>

#include "base/result.h"
#include "base/time.h"
#include "recording/byte_sink.h"
#include "recording/little_endian.h"
#include "recording/mcap_format.h"

struct ZSTD_CCtx_s;

namespace wagonsight {

struct McapWriterOptions {
  std::size_t chunk_bytes = std::size_t{1} << 20;  // a chunk closes at the first group beyond it
  Duration chunk_duration = std::chrono::milliseconds(500);  // or when it spans this much log time
  int zstd_level = 1;  // the fastest; higher levels gain little on depth (see the README)
  std::string_view profile = "ros2";
  std::string_view library = "wagonsight";
};

// Encodes one MCAP file into a sink. Schemas, channels, attachments and metadata lie in the data
// section at once, messages in zstd chunks with their CRC; each chunk with its indices reaches the
// sink in one call. One thread; memory is one chunk, its compressed form and some 200 bytes a chunk
// for the summary. Times are nanoseconds.
class McapWriter {
 public:
  // Writes magic and header. The sink must outlive the writer.
  static Result<std::unique_ptr<McapWriter>> create(ByteSink& sink,
                                                    const McapWriterOptions& options);
  ~McapWriter();
  McapWriter(const McapWriter&) = delete;
  McapWriter& operator=(const McapWriter&) = delete;

  Result<std::uint16_t> add_schema(std::string_view name, std::string_view encoding,
                                   std::string_view data);
  Result<std::uint16_t> add_channel(std::uint16_t schema_id, std::string_view topic,
                                    std::string_view message_encoding, const McapPairs& metadata);

  // The message's data is given in parts, so that an image is copied once. The message's `data` is
  // ignored.
  void add_message(const McapMessage& message,
                   std::initializer_list<std::span<const std::byte>> parts);
  // Messages since the last call belong together: a chunk is only closed here, never within.
  Result<void> end_group();
  // Closes the chunk that is open, however small it is.
  Result<void> flush() { return close_chunk(); }

  Result<void> add_attachment(const McapAttachment& attachment);
  Result<void> add_metadata(const McapMetadata& metadata);

  // The last chunk, the summary and the footer. Nothing may be added after it.
  Result<void> finish();

  std::uint64_t bytes_written() const { return offset_; }
  std::uint64_t message_bytes() const { return message_bytes_; }  // before compression
  std::uint64_t message_count() const { return message_count_; }
  std::size_t chunk_count() const { return chunks_.size(); }

 private:
  struct IndexEntry {
    std::uint64_t log_time = 0, offset = 0;
  };
  struct ChannelState {
    std::uint64_t message_count = 0;
    std::vector<IndexEntry> index;  // of the open chunk
  };
  struct ChunkIndex {
    std::uint64_t start_time = 0, end_time = 0, offset = 0, length = 0;
    std::uint64_t compressed_size = 0, uncompressed_size = 0, index_length = 0;
    std::vector<std::pair<std::uint16_t, std::uint64_t>> index_offsets;
  };

  McapWriter(ByteSink& sink, const McapWriterOptions& options);
  Result<void> emit(std::span<const std::byte> bytes);
  Result<void> close_chunk();
  void append_message_indexes(ChunkIndex& chunk);
  void append_chunk_indexes();
  void append_statistics();
  void append_summary_offset(McapOpcode group, std::size_t group_begin);

  ByteSink& sink_;
  McapWriterOptions options_;
  std::unique_ptr<ZSTD_CCtx_s, void (*)(ZSTD_CCtx_s*)> zstd_;
  ByteWriter open_chunk_;                // uncompressed records
  std::vector<std::byte> compressed_;    // scratch
  ByteWriter record_;                    // scratch
  ByteWriter schemas_, channels_;        // as records, repeated in the summary
  ByteWriter attachments_, metadata_;    // index records
  ByteWriter summary_, summary_offset_;  // built by finish()
  std::vector<ChannelState> channel_states_;
  std::vector<ChunkIndex> chunks_;
  std::uint64_t chunk_start_ = 0, chunk_end_ = 0;  // log times of the open chunk
  bool chunk_has_messages_ = false;
  std::uint64_t start_time_ = 0, end_time_ = 0;  // of the file
  std::uint64_t offset_ = 0, message_bytes_ = 0, message_count_ = 0;
  std::uint32_t attachment_count_ = 0, metadata_count_ = 0;
  std::uint16_t schema_count_ = 0;
  std::uint32_t data_crc_ = 0;
  bool finished_ = false;
};

}  // namespace wagonsight

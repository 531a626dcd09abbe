#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "base/result.h"
#include "recording/mcap_format.h"

// The records of an MCAP file, one function each: bytes in, fields out, nothing where the bytes do
// not hold what the record must. Views point into the bytes that were given.
namespace wagonsight {

struct McapRecord {
  McapOpcode opcode{};
  std::span<const std::byte> content;
};

// A chunk as it lies in the file.
struct McapChunk {
  std::uint64_t start_time = 0, end_time = 0;  // log times of its messages
  std::uint64_t uncompressed_size = 0;
  std::uint32_t crc = 0;  // of the uncompressed records; 0: not stated
  std::string_view compression;
  std::span<const std::byte> records;
};

struct McapFooter {
  std::uint64_t summary_start = 0, summary_offset_start = 0;
  std::uint32_t summary_crc = 0;
};

// The record that begins at `offset`, which moves behind it; nothing when it is not whole.
std::optional<McapRecord> read_record(std::span<const std::byte> bytes, std::size_t& offset);

std::optional<McapSchema> decode_schema(std::span<const std::byte> content);
std::optional<McapChannel> decode_channel(std::span<const std::byte> content);
std::optional<McapMessage> decode_message(std::span<const std::byte> content);
std::optional<McapChunk> decode_chunk(std::span<const std::byte> content);
std::optional<McapMetadata> decode_metadata(std::span<const std::byte> content);
std::optional<McapFooter> decode_footer(std::span<const std::byte> content);

// Also checks the attachment's sum, in which `sound` is the answer.
struct McapAttachmentRecord {
  McapAttachment attachment;
  bool sound = false;
};
std::optional<McapAttachmentRecord> decode_attachment(std::span<const std::byte> content);

// Unpacks a chunk into `buffer`, which grows to the largest chunk seen, and checks its sum. The
// Error says what is wrong with the chunk, without its place.
Result<std::span<const std::byte>> unpack_chunk(const McapChunk& chunk,
                                                std::vector<std::byte>& buffer);

}  // namespace wagonsight

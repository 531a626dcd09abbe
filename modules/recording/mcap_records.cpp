#include "recording/mcap_records.h"

#include <fmt/format.h>
#include <lz4frame.h>
#include <zstd.h>

#include <memory>

#include "recording/little_endian.h"

namespace wagonsight {
namespace {

template <class T>
std::optional<T> if_ok(const ByteReader& reader, T value) {
  if (!reader.ok()) return std::nullopt;
  return value;
}

McapPairs read_pairs(ByteReader& reader) {
  const auto bytes = reader.raw(reader.number<std::uint32_t>());
  ByteReader inner(bytes);
  McapPairs pairs;
  while (inner.ok() && inner.remaining() > 0) {
    const auto key = inner.text();
    const auto value = inner.text();
    if (inner.ok()) pairs.emplace_back(key, value);
  }
  return pairs;
}

// LZ4 is what other writers (the mcap tool, older Foxglove agents) use; we never write it.
bool unpack_lz4(std::span<const std::byte> packed, std::span<std::byte> out) {
  LZ4F_dctx* created = nullptr;
  if (LZ4F_isError(LZ4F_createDecompressionContext(&created, LZ4F_VERSION)) != 0U) return false;
  const std::unique_ptr<LZ4F_dctx, LZ4F_errorCode_t (*)(LZ4F_dctx*)> context(
      created, LZ4F_freeDecompressionContext);
  while (!out.empty() && !packed.empty()) {
    std::size_t out_size = out.size();
    std::size_t packed_size = packed.size();
    const std::size_t hint =
        LZ4F_decompress(context.get(), out.data(), &out_size, packed.data(), &packed_size, nullptr);
    if (LZ4F_isError(hint) != 0U || (out_size == 0 && packed_size == 0)) return false;
    out = out.subspan(out_size);
    packed = packed.subspan(packed_size);
  }
  return out.empty();
}

}  // namespace

std::optional<McapRecord> read_record(std::span<const std::byte> bytes, std::size_t& offset) {
  ByteReader reader(bytes.subspan(offset));
  McapRecord record;
  record.opcode = static_cast<McapOpcode>(reader.number<std::uint8_t>());
  record.content = reader.raw(reader.number<std::uint64_t>());
  if (!reader.ok() || record.opcode == McapOpcode{0}) return std::nullopt;
  offset += reader.position();
  return record;
}

std::optional<McapSchema> decode_schema(std::span<const std::byte> content) {
  ByteReader reader(content);
  McapSchema schema;
  schema.id = reader.number<std::uint16_t>();
  schema.name = reader.text();
  schema.encoding = reader.text();
  schema.data = reader.text();
  return if_ok(reader, std::move(schema));
}

std::optional<McapChannel> decode_channel(std::span<const std::byte> content) {
  ByteReader reader(content);
  McapChannel channel;
  channel.id = reader.number<std::uint16_t>();
  channel.schema_id = reader.number<std::uint16_t>();
  channel.topic = reader.text();
  channel.message_encoding = reader.text();
  channel.metadata = read_pairs(reader);
  return if_ok(reader, std::move(channel));
}

std::optional<McapMessage> decode_message(std::span<const std::byte> content) {
  ByteReader reader(content);
  McapMessage message;
  message.channel_id = reader.number<std::uint16_t>();
  message.sequence = reader.number<std::uint32_t>();
  message.log_time = reader.number<std::uint64_t>();
  message.publish_time = reader.number<std::uint64_t>();
  message.data = reader.raw(reader.remaining());
  return if_ok(reader, message);
}

std::optional<McapChunk> decode_chunk(std::span<const std::byte> content) {
  ByteReader reader(content);
  McapChunk chunk;
  chunk.start_time = reader.number<std::uint64_t>();
  chunk.end_time = reader.number<std::uint64_t>();
  chunk.uncompressed_size = reader.number<std::uint64_t>();
  chunk.crc = reader.number<std::uint32_t>();
  chunk.compression = reader.text();
  chunk.records = reader.raw(reader.number<std::uint64_t>());
  return if_ok(reader, chunk);
}

std::optional<McapMetadata> decode_metadata(std::span<const std::byte> content) {
  ByteReader reader(content);
  McapMetadata metadata;
  metadata.name = reader.text();
  metadata.values = read_pairs(reader);
  return if_ok(reader, std::move(metadata));
}

std::optional<McapFooter> decode_footer(std::span<const std::byte> content) {
  ByteReader reader(content);
  McapFooter footer;
  footer.summary_start = reader.number<std::uint64_t>();
  footer.summary_offset_start = reader.number<std::uint64_t>();
  footer.summary_crc = reader.number<std::uint32_t>();
  return if_ok(reader, footer);
}

std::optional<McapAttachmentRecord> decode_attachment(std::span<const std::byte> content) {
  ByteReader reader(content);
  McapAttachmentRecord record;
  record.attachment.log_time = reader.number<std::uint64_t>();
  record.attachment.create_time = reader.number<std::uint64_t>();
  record.attachment.name = reader.text();
  record.attachment.media_type = reader.text();
  record.attachment.data = reader.raw(reader.number<std::uint64_t>());
  const std::size_t summed = reader.position();
  const auto crc = reader.number<std::uint32_t>();
  if (!reader.ok()) return std::nullopt;
  record.sound = crc == 0 || crc == mcap_crc32(content.first(summed));
  return record;
}

Result<std::span<const std::byte>> unpack_chunk(const McapChunk& chunk,
                                                std::vector<std::byte>& buffer) {
  if (chunk.uncompressed_size > kMcapChunkBytesMax)
    return fail(fmt::format("claims {} bytes uncompressed, more than the {} MiB that are accepted",
                            chunk.uncompressed_size, kMcapChunkBytesMax >> 20));
  const auto size = static_cast<std::size_t>(chunk.uncompressed_size);
  std::span<const std::byte> records = chunk.records;
  if (!chunk.compression.empty()) {
    // A frame that tells its size is asked before memory is taken for a claim.
    const auto told = ZSTD_getFrameContentSize(chunk.records.data(), chunk.records.size());
    const bool is_told = told != ZSTD_CONTENTSIZE_UNKNOWN && told != ZSTD_CONTENTSIZE_ERROR;
    if (chunk.compression == "zstd" && is_told && told != chunk.uncompressed_size)
      return fail("is damaged (its size is not the stated one)");
    if (buffer.size() < size) buffer.resize(size);
    const std::span<std::byte> out = std::span(buffer).first(size);
    if (chunk.compression == "zstd") {
      const std::size_t unpacked =
          ZSTD_decompress(out.data(), size, chunk.records.data(), chunk.records.size());
      if (ZSTD_isError(unpacked) != 0U || unpacked != size)
        return fail("is damaged (zstd cannot unpack it)");
    } else if (chunk.compression == "lz4") {
      if (!unpack_lz4(chunk.records, out)) return fail("is damaged (lz4 cannot unpack it)");
    } else {
      return fail(
          fmt::format("is compressed with \"{}\", which is not known here (zstd and lz4 are)",
                      chunk.compression));
    }
    records = out;
  } else if (records.size() != size) {
    return fail("is damaged (its size is not the stated one)");
  }
  if (chunk.crc != 0 && chunk.crc != mcap_crc32(records))
    return fail("is damaged (its CRC does not match)");
  return records;
}

}  // namespace wagonsight

#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <utility>
#include <vector>

// The MCAP container (mcap.dev/spec): a magic, a header, records of one opcode byte and a 64-bit
// length, chunks of compressed records with their indices, a summary, a footer and the magic again.
namespace wagonsight {

inline constexpr std::array<unsigned char, 8> kMcapMagic{0x89, 'M', 'C', 'A', 'P', '0', '\r', '\n'};
inline constexpr std::size_t kMcapRecordHeaderBytes = 9;
inline constexpr std::size_t kMcapFooterBytes = kMcapRecordHeaderBytes + 8 + 8 + 4;

// A chunk that claims more than this uncompressed is refused: we write about 1 MiB, rosbag2 and
// Foxglove at most a few MiB, and a damaged length must not take the machine's memory.
inline constexpr std::uint64_t kMcapChunkBytesMax = std::uint64_t{256} << 20;

enum class McapOpcode : std::uint8_t {
  kHeader = 0x01,
  kFooter = 0x02,
  kSchema = 0x03,
  kChannel = 0x04,
  kMessage = 0x05,
  kChunk = 0x06,
  kMessageIndex = 0x07,
  kChunkIndex = 0x08,
  kAttachment = 0x09,
  kAttachmentIndex = 0x0A,
  kStatistics = 0x0B,
  kMetadata = 0x0C,
  kMetadataIndex = 0x0D,
  kSummaryOffset = 0x0E,
  kDataEnd = 0x0F,
};

using McapPairs = std::vector<std::pair<std::string, std::string>>;

struct McapSchema {
  std::uint16_t id = 0;
  std::string name, encoding, data;
};

struct McapChannel {
  std::uint16_t id = 0;
  std::uint16_t schema_id = 0;
  std::string topic, message_encoding;
  McapPairs metadata;
};

// Times are nanoseconds since an epoch the writer chose.
struct McapMessage {
  std::uint16_t channel_id = 0;
  std::uint32_t sequence = 0;
  std::uint64_t log_time = 0;
  std::uint64_t publish_time = 0;
  std::span<const std::byte> data{};
};

struct McapAttachment {
  std::string name, media_type;
  std::uint64_t log_time = 0, create_time = 0;
  std::span<const std::byte> data{};
};

struct McapMetadata {
  std::string name;
  McapPairs values;
};

// The checksum of MCAP: CRC-32 as of ISO 3309 (zlib's), continued from `crc`.
std::uint32_t mcap_crc32(std::span<const std::byte> bytes, std::uint32_t crc = 0);

}  // namespace wagonsight

#include "zip_reader.h"

#include <fmt/format.h>
#include <zlib.h>

#include <optional>

#include "recording/little_endian.h"

namespace wagonsight {
namespace {

constexpr std::uint32_t kEndMark = 0x06054b50;
constexpr std::uint32_t kEntryMark = 0x02014b50;
constexpr std::uint32_t kFileMark = 0x04034b50;
constexpr std::size_t kEndBytes = 22;
constexpr std::size_t kFileHeaderBytes = 30;
constexpr std::uint32_t kContentMax = 64U << 20U;  // a bundle is some hundred kilobytes

struct Entry {
  std::uint16_t method = 0;
  std::uint32_t crc = 0, packed_size = 0, size = 0, offset = 0;
};

// The end record is the last thing but a comment of at most 64 KB.
std::optional<std::size_t> find_end(std::span<const std::byte> archive) {
  if (archive.size() < kEndBytes) return std::nullopt;
  const std::size_t last = archive.size() - kEndBytes;
  const std::size_t first = last > 65'535 ? last - 65'535 : 0;
  for (std::size_t at = last + 1; at-- > first;)
    if (ByteReader(archive.subspan(at)).number<std::uint32_t>() == kEndMark) return at;
  return std::nullopt;
}

std::optional<Entry> find_entry(std::span<const std::byte> archive, std::size_t end,
                                std::string_view name) {
  ByteReader end_record(archive.subspan(end));
  end_record.raw(10);
  const auto count = end_record.number<std::uint16_t>();
  end_record.number<std::uint32_t>();  // size of the directory
  const auto offset = end_record.number<std::uint32_t>();
  if (offset > archive.size()) return std::nullopt;
  ByteReader directory(archive.subspan(offset));
  for (std::size_t i = 0; i < count && directory.ok(); ++i) {
    if (directory.number<std::uint32_t>() != kEntryMark) return std::nullopt;
    Entry entry;
    directory.raw(6);  // versions and flags
    entry.method = directory.number<std::uint16_t>();
    directory.raw(4);  // time and date
    entry.crc = directory.number<std::uint32_t>();
    entry.packed_size = directory.number<std::uint32_t>();
    entry.size = directory.number<std::uint32_t>();
    const auto name_size = directory.number<std::uint16_t>();
    const auto extra_size = directory.number<std::uint16_t>();
    const auto comment_size = directory.number<std::uint16_t>();
    directory.raw(8);  // disk and attributes
    entry.offset = directory.number<std::uint32_t>();
    const auto found = directory.raw(name_size);
    directory.raw(std::uint64_t{extra_size} + comment_size);
    if (!directory.ok()) return std::nullopt;
    if (std::string_view(reinterpret_cast<const char*>(found.data()), found.size()) == name)
      return entry;
  }
  return std::nullopt;
}

std::optional<std::string> inflated(std::span<const std::byte> packed, std::uint32_t size) {
  constexpr int kRawDeflate = -15;
  std::string out(size, '\0');
  z_stream stream{};
  if (inflateInit2(&stream, kRawDeflate) != Z_OK) return std::nullopt;
  stream.next_in =
      const_cast<Bytef*>(reinterpret_cast<const Bytef*>(packed.data()));  // zlib only reads it
  stream.avail_in = static_cast<uInt>(packed.size());
  stream.next_out = reinterpret_cast<Bytef*>(out.data());
  stream.avail_out = static_cast<uInt>(out.size());
  const int done = inflate(&stream, Z_FINISH);
  const bool is_whole = done == Z_STREAM_END && stream.total_out == size;
  inflateEnd(&stream);
  if (!is_whole) return std::nullopt;
  return out;
}

}  // namespace

Result<std::string> read_from_zip(std::span<const std::byte> archive, std::string_view name) {
  const auto end = find_end(archive);
  if (!end) return fail("is not a zip archive, or was cut");
  const auto entry = find_entry(archive, *end, name);
  if (!entry) return fail(fmt::format("has no {} in it, so it is no diagnostics bundle", name));
  const auto damaged = fail(fmt::format("is damaged at {}", name));
  if (entry->size > kContentMax || entry->offset > archive.size()) return damaged;
  ByteReader file(archive.subspan(entry->offset));
  if (file.number<std::uint32_t>() != kFileMark) return damaged;
  file.raw(kFileHeaderBytes - 4 - 4);
  const auto name_size = file.number<std::uint16_t>();
  const auto extra_size = file.number<std::uint16_t>();
  file.raw(std::uint64_t{name_size} + extra_size);
  const auto packed = file.raw(entry->packed_size);
  if (!file.ok()) return damaged;
  std::optional<std::string> content;
  if (entry->method == 0)
    content.emplace(reinterpret_cast<const char*>(packed.data()), packed.size());
  else if (entry->method == 8)
    content = inflated(packed, entry->size);
  if (!content) return damaged;
  const auto crc = crc32_z(0, reinterpret_cast<const Bytef*>(content->data()), content->size());
  if (crc != entry->crc) return damaged;
  return std::move(*content);
}

}  // namespace wagonsight

#include "status/zip.h"

#include <zlib.h>

#include <chrono>
#include <cstdint>

#include "base/check.h"

namespace wagonsight {
namespace {

constexpr int kRaw = -15;         // deflate without a wrapper, 32 KB window
constexpr int kGzipWrapper = 31;  // 15 + 16
constexpr std::uint16_t kUtf8Names = 0x0800;
constexpr std::uint16_t kDeflated = 8;
constexpr std::uint16_t kVersion = 20;  // 2.0: deflate

std::string deflated(std::string_view text, int window_bits) {
  z_stream stream{};
  const int made =
      deflateInit2(&stream, Z_BEST_COMPRESSION, Z_DEFLATED, window_bits, 8, Z_DEFAULT_STRATEGY);
  WS_CHECK(made == Z_OK, "zlib said %d", made);
  std::string out(deflateBound(&stream, static_cast<uLong>(text.size())), '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(text.data()));  // zlib only reads it
  stream.avail_in = static_cast<uInt>(text.size());
  stream.next_out = reinterpret_cast<Bytef*>(out.data());
  stream.avail_out = static_cast<uInt>(out.size());
  const int done = deflate(&stream, Z_FINISH);
  WS_CHECK(done == Z_STREAM_END, "zlib said %d", done);
  out.resize(stream.total_out);
  deflateEnd(&stream);
  return out;
}

void append_u16(std::string& out, std::uint32_t value) {
  out += static_cast<char>(value & 0xFF);
  out += static_cast<char>(value >> 8 & 0xFF);
}
void append_u32(std::string& out, std::uint64_t value) {
  append_u16(out, static_cast<std::uint32_t>(value & 0xFFFF));
  append_u16(out, static_cast<std::uint32_t>(value >> 16 & 0xFFFF));
}

struct DosTime {
  std::uint16_t time = 0;
  std::uint16_t date = 1 << 5 | 1;  // 1980-01-01, where the format begins
};

DosTime dos_time(double unix_time) {
  using namespace std::chrono;
  const sys_seconds instant{seconds{static_cast<std::int64_t>(unix_time)}};
  const sys_days day = floor<days>(instant);
  const year_month_day date{day};
  const int year = static_cast<int>(date.year());
  if (year < 1980 || year > 2107) return {};
  const hh_mm_ss<seconds> time{instant - day};
  return {static_cast<std::uint16_t>(time.hours().count() << 11 | time.minutes().count() << 5 |
                                     time.seconds().count() / 2),
          static_cast<std::uint16_t>(static_cast<unsigned>(year - 1980) << 9 |
                                     static_cast<unsigned>(date.month()) << 5 |
                                     static_cast<unsigned>(date.day()))};
}

}  // namespace

std::string make_zip(const std::vector<ZipEntry>& entries, double unix_time) {
  const DosTime stamp = dos_time(unix_time);
  std::string archive, directory;
  for (const ZipEntry& entry : entries) {
    const std::string packed = deflated(entry.content, kRaw);
    const std::uint64_t offset = archive.size();
    std::string fields;  // the part that the local and the central header have in common
    append_u16(fields, kVersion);
    append_u16(fields, kUtf8Names);
    append_u16(fields, kDeflated);
    append_u16(fields, stamp.time);
    append_u16(fields, stamp.date);
    append_u32(fields, crc32(0, reinterpret_cast<const Bytef*>(entry.content.data()),
                             static_cast<uInt>(entry.content.size())));
    append_u32(fields, packed.size());
    append_u32(fields, entry.content.size());
    append_u16(fields, static_cast<std::uint32_t>(entry.name.size()));
    append_u16(fields, 0);  // extra field

    archive += "PK\x03\x04" + fields + entry.name + packed;
    directory += "PK\x01\x02";
    append_u16(directory, kVersion);
    directory += fields;
    append_u16(directory, 0);  // comment
    append_u16(directory, 0);  // disk
    append_u16(directory, 0);  // internal attributes
    append_u32(directory, 0);  // external attributes
    append_u32(directory, offset);
    directory += entry.name;
  }
  const std::uint64_t directory_offset = archive.size();
  archive += directory + "PK\x05\x06";
  append_u32(archive, 0);  // this disk, the directory's disk
  append_u16(archive, static_cast<std::uint32_t>(entries.size()));
  append_u16(archive, static_cast<std::uint32_t>(entries.size()));
  append_u32(archive, directory.size());
  append_u32(archive, directory_offset);
  append_u16(archive, 0);  // comment
  return archive;
}

std::string make_gzip(std::string_view text) {
  return deflated(text, kGzipWrapper);
}

}  // namespace wagonsight

#include "update/manifest.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <iterator>
#include <numeric>

namespace wagonsight {
namespace {

constexpr std::string_view kFirstLine = "wagonsight bundle 1";
constexpr std::size_t kTextMax = 1000;

bool is_word_letter(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.' ||
         c == '_' || c == '-';
}

bool is_printable(std::string_view text) {
  return text.size() <= kTextMax &&
         std::all_of(text.begin(), text.end(), [](char c) { return c >= ' ' && c <= '~'; });
}

bool read_number(std::string_view text, std::uint64_t& number) {
  const char* end = text.data() + text.size();
  const auto read = std::from_chars(text.data(), end, number);
  return read.ec == std::errc{} && read.ptr == end;
}

// Takes a text apart, line by line, each "KEY VALUE".
class Lines {
 public:
  explicit Lines(std::string_view text) : text_(text) {}

  bool ended() const { return text_.empty(); }
  bool next_is(std::string_view key) const {
    return text_.starts_with(key) && text_.size() > key.size() && text_[key.size()] == ' ';
  }
  // The value of a line that must have this key.
  Result<std::string_view> value(std::string_view key) {
    ++number_;
    const std::size_t end = text_.find('\n');
    if (end == std::string_view::npos || !next_is(key))
      return wrong(fmt::format("should begin with \"{} \"", key));
    const std::string_view line = text_.substr(0, end);
    text_.remove_prefix(end + 1);
    if (!is_printable(line)) return wrong("has other than printable characters, or too many");
    return line.substr(key.size() + 1);
  }
  Result<std::uint64_t> number(std::string_view key) {
    const auto text = value(key);
    if (!text) return tl::unexpected(text.error());
    std::uint64_t number = 0;
    if (!read_number(*text, number)) return wrong("should be a whole number");
    return number;
  }
  tl::unexpected<Error> wrong(std::string_view why) const {
    return fail(fmt::format("the manifest's line {} {}", number_, why));
  }

 private:
  std::string_view text_;
  int number_ = 0;
};

Result<BundlePart> read_part(Lines& lines, std::uint64_t total) {
  const auto value = lines.value("part");
  if (!value) return tl::unexpected(value.error());
  const std::size_t space = value->find(' ');
  BundlePart part;
  part.name = value->substr(0, space);
  const bool has_size =
      space != std::string_view::npos && read_number(value->substr(space + 1), part.bytes);
  if (!is_part_name(part.name) || !has_size) return lines.wrong("should be \"part NAME BYTES\"");
  if (part.bytes > kPartBytesMax - std::min(total, kPartBytesMax))
    return lines.wrong("makes the bundle larger than any");
  const std::size_t count = chunk_count(part.bytes);
  if (count > kManifestBytesMax / 64) return lines.wrong("has more chunks than fit a manifest");
  part.chunks.resize(count);
  for (Digest& digest : part.chunks) {
    const auto chunk = lines.value("chunk");
    if (!chunk) return tl::unexpected(chunk.error());
    if (!read_hex(*chunk, digest)) return lines.wrong("should be a SHA-256 digest");
  }
  return part;
}

Result<Manifest> read_head(Lines& lines) {
  Manifest manifest;
  const auto format = lines.value("wagonsight");
  if (!format || *format != kFirstLine.substr(11))
    return fail("the manifest is of another format than this version of wagonsight reads");
  const auto kind = lines.value("kind");
  if (!kind) return tl::unexpected(kind.error());
  if (*kind != "update" && *kind != "provision")
    return lines.wrong("should be \"kind update\" or \"kind provision\"");
  manifest.kind = *kind == "update" ? BundleKind::kUpdate : BundleKind::kProvision;
  const auto version = lines.value("version");
  if (!version) return tl::unexpected(version.error());
  manifest.version = *version;
  const auto index = lines.number("index");
  if (!index) return tl::unexpected(index.error());
  manifest.index = *index;
  const bool is_update = manifest.kind == BundleKind::kUpdate;
  const auto whom = lines.value(is_update ? "architecture" : "unit");
  if (!whom) return tl::unexpected(whom.error());
  if (!is_update && !is_unit_name(*whom)) return lines.wrong("names no possible unit");
  (is_update ? manifest.architecture : manifest.unit) = *whom;
  if (!is_update) return manifest;
  const auto boot = lines.value("boot");
  if (!boot) return tl::unexpected(boot.error());
  manifest.boot = *boot;
  return manifest;
}

}  // namespace

std::string_view to_text(BundleKind kind) {
  return kind == BundleKind::kUpdate ? "update" : "provision";
}

std::uint64_t BundlePart::chunk_bytes(std::size_t index) const {
  return std::min(kChunkBytes, bytes - kChunkBytes * index);
}

std::uint64_t Manifest::payload_bytes() const {
  return std::accumulate(
      parts.begin(), parts.end(), std::uint64_t{0},
      [](std::uint64_t sum, const BundlePart& part) { return sum + part.bytes; });
}

const BundlePart* Manifest::part(std::string_view name) const {
  const auto found = std::find_if(parts.begin(), parts.end(),
                                  [&](const BundlePart& part) { return part.name == name; });
  return found == parts.end() ? nullptr : &*found;
}

std::size_t chunk_count(std::uint64_t bytes) {
  return static_cast<std::size_t>((bytes + kChunkBytes - 1) / kChunkBytes);
}

BundlePart make_part(std::string name, std::span<const std::byte> bytes) {
  BundlePart part;
  part.name = std::move(name);
  part.bytes = bytes.size();
  for (std::size_t i = 0; i < chunk_count(part.bytes); ++i)
    part.chunks.push_back(
        digest_of(bytes.subspan(i * kChunkBytes, static_cast<std::size_t>(part.chunk_bytes(i)))));
  return part;
}

bool is_part_name(std::string_view name) {
  return !name.empty() && name.size() <= 64 && name.front() != '.' &&
         std::all_of(name.begin(), name.end(), is_word_letter);
}

bool is_unit_name(std::string_view name) {
  return is_part_name(name);
}

std::string manifest_text(const Manifest& manifest) {
  const bool is_update = manifest.kind == BundleKind::kUpdate;
  std::string text = fmt::format("{}\nkind {}\nversion {}\nindex {}\n", kFirstLine,
                                 to_text(manifest.kind), manifest.version, manifest.index);
  if (is_update)
    text += fmt::format("architecture {}\nboot {}\n", manifest.architecture, manifest.boot);
  else
    text += fmt::format("unit {}\n", manifest.unit);
  for (const BundlePart& part : manifest.parts) {
    text += fmt::format("part {} {}\n", part.name, part.bytes);
    for (const Digest& digest : part.chunks) text += fmt::format("chunk {}\n", hex_text(digest));
  }
  return text;
}

Result<Manifest> parse_manifest(std::string_view text) {
  Lines lines(text);
  auto manifest = read_head(lines);
  if (!manifest) return manifest;
  std::uint64_t total = 0;
  while (!lines.ended()) {
    auto part = read_part(lines, total);
    if (!part) return tl::unexpected(part.error());
    if (manifest->part(part->name) != nullptr)
      return lines.wrong("names a part for the second time");
    if (manifest->parts.size() == kPartsMax) return lines.wrong("is one part too many");
    total += part->bytes;
    manifest->parts.push_back(std::move(*part));
  }
  if (manifest->parts.empty()) return fail("the manifest names no part");
  return manifest;
}

}  // namespace wagonsight

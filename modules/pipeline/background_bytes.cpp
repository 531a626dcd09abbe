#include <fmt/format.h>

#include <bit>
#include <cstring>

#include "base/crc32c.h"
#include "pipeline/state.h"

// The backgrounds of all sensors as one run of bytes, little-endian: a magic, the number of
// sensors, then for each its name (40 bytes), the length of its part and the part; last the CRC32C
// of all that precedes it.
namespace wagonsight {
namespace {

static_assert(std::endian::native == std::endian::little);
constexpr std::array<char, 8> kMagic{'w', 's', 'b', 'a', 'c', 'k', '0', '1'};
constexpr std::size_t kNameBytes = 40;

void append(std::vector<std::byte>& bytes, const void* from, std::size_t count) {
  if (count == 0) return;
  bytes.resize(bytes.size() + count);
  std::memcpy(bytes.data() + bytes.size() - count, from, count);
}

std::array<char, kNameBytes> name_field(std::string_view name) {
  std::array<char, kNameBytes> field{};
  std::memcpy(field.data(), name.data(), std::min(name.size(), kNameBytes));
  return field;
}

// Takes `count` bytes off the front; empty when there are fewer.
std::span<const std::byte> take(std::span<const std::byte>& bytes, std::size_t count) {
  if (bytes.size() < count) return {};
  const auto front = bytes.first(count);
  bytes = bytes.subspan(count);
  return front;
}

std::uint64_t take_number(std::span<const std::byte>& bytes) {
  std::uint64_t value = 0;
  const auto field = take(bytes, sizeof value);
  if (!field.empty()) std::memcpy(&value, field.data(), sizeof value);
  return value;
}

}  // namespace

std::vector<std::byte> Pipeline::save_background() const {
  std::vector<std::byte> bytes;
  append(bytes, kMagic.data(), kMagic.size());
  const std::uint64_t count = state_->rig.sensors.size();
  append(bytes, &count, sizeof count);
  for (std::size_t i = 0; i < count; ++i) {
    const auto name = name_field(state_->rig.sensors[i].name.view());
    const auto part = state_->lanes[i].extractor->save_background();
    const std::uint64_t length = part.size();
    append(bytes, name.data(), name.size());
    append(bytes, &length, sizeof length);
    append(bytes, part.data(), part.size());
  }
  const std::uint32_t sum = crc32c(bytes);
  append(bytes, &sum, sizeof sum);
  return bytes;
}

Result<void> Pipeline::load_background(std::span<const std::byte> bytes) {
  if (bytes.size() < kMagic.size() + 12 ||
      std::memcmp(bytes.data(), kMagic.data(), kMagic.size()) != 0)
    return fail("this is not a background file; make one with replay or by letting the unit learn");
  std::uint32_t sum = 0;
  std::memcpy(&sum, bytes.data() + bytes.size() - sizeof sum, sizeof sum);
  auto rest = bytes.first(bytes.size() - sizeof sum);
  if (crc32c(rest) != sum)
    return fail("the background file is damaged (its check sum is wrong); learn it again");
  rest = rest.subspan(kMagic.size());
  const std::uint64_t count = take_number(rest);
  if (count != state_->rig.sensors.size())
    return fail(
        fmt::format("the background was learned with {} sensors, the rig has {}; learn it "
                    "again",
                    count, state_->rig.sensors.size()));
  for (std::size_t i = 0; i < count; ++i) {
    const auto name = take(rest, kNameBytes);
    const std::string_view sensor = state_->rig.sensors[i].name.view();
    if (name.empty() || std::memcmp(name.data(), name_field(sensor).data(), kNameBytes) != 0)
      return fail(
          fmt::format("the background has no part for sensor {} in its place; learn it "
                      "again",
                      sensor));
    const auto part = take(rest, take_number(rest));
    auto loaded = state_->lanes[i].extractor->load_background(part);
    if (!loaded) return fail(fmt::format("sensor {}: {}", sensor, loaded.error().message));
  }
  return {};
}

}  // namespace wagonsight

#include "drift/static_model.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string_view>

#include "base/crc32c.h"

namespace wagonsight {
namespace {

constexpr std::string_view kMagic = "WSSTATIC";
constexpr std::uint16_t kVersion = 1;
constexpr float kUnitsPerMetre = 10'000;  // 6.5 m at most, which no trim exceeds

class Writer {
 public:
  void put(std::uint64_t value, int bytes) {
    for (int i = 0; i < bytes; ++i) bytes_.push_back(static_cast<std::byte>(value >> (8 * i)));
  }
  void put(std::span<const std::byte> raw) { bytes_.insert(bytes_.end(), raw.begin(), raw.end()); }
  std::vector<std::byte> done() {
    put(crc32c(bytes_), 4);
    return std::move(bytes_);
  }

 private:
  std::vector<std::byte> bytes_;
};

class Reader {
 public:
  explicit Reader(std::span<const std::byte> bytes) : bytes_(bytes) {}
  bool has(std::size_t count) const { return bytes_.size() - at_ >= count; }
  std::uint64_t take(std::size_t count) {
    std::uint64_t value = 0;
    for (std::size_t i = 0; i < count; ++i)
      value |= std::to_integer<std::uint64_t>(bytes_[at_ + i]) << (8 * i);
    at_ += count;
    return value;
  }
  std::span<const std::byte> raw(std::size_t count) {
    const auto part = bytes_.subspan(at_, count);
    at_ += count;
    return part;
  }

 private:
  std::span<const std::byte> bytes_;
  std::size_t at_ = 0;
};

std::span<const std::byte> bytes_of(std::string_view text) {
  return std::as_bytes(std::span(text.data(), text.size()));
}

}  // namespace

std::vector<std::byte> format_static_model(const StaticModel& model) {
  Writer out;
  out.put(bytes_of(kMagic));
  out.put(kVersion, 2);
  out.put(std::as_bytes(std::span(model.blob_sha256)));
  out.put(model.views.size(), 2);
  for (const StaticModel::View& view : model.views) {
    out.put(view.sensor.view().size(), 2);
    out.put(bytes_of(view.sensor.view()));
    out.put(static_cast<std::uint64_t>(view.grid.width), 2);
    out.put(static_cast<std::uint64_t>(view.grid.height), 2);
    out.put(view.depth_m.empty() ? 0 : 1, 1);
    for (const float depth : view.depth_m)
      out.put(
          static_cast<std::uint64_t>(std::clamp(std::lround(depth * kUnitsPerMetre), 0L, 65'535L)),
          2);
  }
  return out.done();
}

Result<StaticModel> parse_static_model(std::span<const std::byte> bytes) {
  const std::size_t head = kMagic.size() + 2 + 32 + 2;
  if (bytes.size() < head + 4) return fail("the model of the static wagon is too short");
  if (std::memcmp(bytes.data(), kMagic.data(), kMagic.size()) != 0)
    return fail("this is not a model of the static wagon");
  Reader tail(bytes.last(4));
  if (crc32c(bytes.first(bytes.size() - 4)) != tail.take(4))
    return fail("the model of the static wagon is damaged");
  Reader in(bytes.first(bytes.size() - 4));
  in.raw(kMagic.size());
  if (in.take(2) != kVersion)
    return fail("the model of the static wagon was made by another version");
  StaticModel model;
  std::memcpy(model.blob_sha256.data(), in.raw(32).data(), 32);
  const std::size_t count = in.take(2);
  for (std::size_t i = 0; i < count; ++i) {
    StaticModel::View view;
    if (!in.has(2)) return fail("the model of the static wagon is cut off");
    const std::size_t letters = in.take(2);
    if (letters > Name::capacity() || !in.has(letters + 5))
      return fail("the model of the static wagon is cut off");
    const auto name = in.raw(letters);
    view.sensor = std::string_view(reinterpret_cast<const char*>(name.data()), name.size());
    view.grid.width = static_cast<int>(in.take(2));
    view.grid.height = static_cast<int>(in.take(2));
    if (in.take(1) != 0) {
      if (!in.has(2 * view.grid.size())) return fail("the model of the static wagon is cut off");
      view.depth_m.reserve(view.grid.size());
      for (std::size_t cell = 0; cell < view.grid.size(); ++cell)
        view.depth_m.push_back(static_cast<float>(in.take(2)) / kUnitsPerMetre);
    }
    model.views.push_back(std::move(view));
  }
  return model;
}

}  // namespace wagonsight

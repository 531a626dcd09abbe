#include <fmt/format.h>

#include <cstring>

#include "base/crc32c.h"
#include "foreground/extractor.h"

// The background's bytes, little-endian:
//   "WSBG", u16 version, u16 width, u16 height, u16 zero, f64 leaf_m, 3 x f64 grid minimum,
//   3 x i32 leaves, u32 leaf count, then a leaf each: u32 address, u8 hits; then open pixels as u64
//   words; last a CRC-32C of all before it.
namespace wagonsight {
namespace {

constexpr char kMagic[4] = {'W', 'S', 'B', 'G'};
constexpr std::uint16_t kVersion = 1;

template <class T>
void put(std::vector<std::byte>& bytes, T value) {
  std::byte raw[sizeof(T)];
  std::memcpy(raw, &value, sizeof(T));
  bytes.insert(bytes.end(), raw, raw + sizeof(T));
}

class Reader {
 public:
  explicit Reader(std::span<const std::byte> bytes) : bytes_(bytes) {}
  template <class T>
  bool get(T& value) {
    if (bytes_.size() < sizeof(T)) return false;
    std::memcpy(&value, bytes_.data(), sizeof(T));
    bytes_ = bytes_.subspan(sizeof(T));
    return true;
  }
  std::size_t left() const { return bytes_.size(); }

 private:
  std::span<const std::byte> bytes_;
};

void put_header(std::vector<std::byte>& bytes, const SensorView& view) {
  for (const char c : kMagic) put(bytes, c);
  put(bytes, kVersion);
  put(bytes, static_cast<std::uint16_t>(view.width()));
  put(bytes, static_cast<std::uint16_t>(view.height()));
  put(bytes, std::uint16_t{0});
  put(bytes, view.grid().leaf_m());
  for (int axis = 0; axis < 3; ++axis) put(bytes, view.grid().min()[axis]);
  for (const int leaves : view.grid().leaves()) put(bytes, static_cast<std::int32_t>(leaves));
}

}  // namespace

void Background::save(std::vector<std::byte>& bytes) const {
  put(bytes, static_cast<std::uint32_t>(leaves_.leaf_count()));
  leaves_.visit([&](LeafAddress leaf) {
    put(bytes, leaf);
    const LeafEvidence* evidence = evidence_.find(leaf);
    put(bytes, evidence == nullptr ? std::uint8_t{1} : evidence->hits);
  });
  for (const std::uint64_t word : thresholds_.open_rays()) put(bytes, word);
}

bool Background::load(const SensorView& view, std::span<const std::byte> bytes) {
  Reader reader(bytes);
  std::uint32_t count = 0;
  const auto open = thresholds_.open_rays();
  if (!reader.get(count)) return false;
  if (reader.left() != std::size_t{count} * 5 + open.size() * 8) return false;
  leaves_.clear();
  vote_ += 2;
  forget_candidates();
  evidence_.clear();
  for (std::uint32_t i = 0; i < count; ++i) {
    LeafAddress leaf = 0;
    std::uint8_t hits = 0;
    if (!reader.get(leaf) || !reader.get(hits)) return false;
    if (leaf >= view.grid().brick_count() * kBrickLeaves) return false;
    leaves_.insert(leaf);
    if (LeafEvidence* evidence = evidence_.find_or_add(leaf)) *evidence = {hits, 0};
  }
  redo_thresholds(view);
  for (std::size_t word = 0; word < open.size(); ++word) {
    std::uint64_t bits = 0;
    if (!reader.get(bits)) return false;
    for (std::size_t place = 0; place < 64; ++place) {
      const std::size_t pixel = word * 64 + place;
      if (((bits >> place) & 1) != 0 && pixel < view.pixel_count()) thresholds_.set_open(pixel);
    }
  }
  return true;
}

std::vector<std::byte> ForegroundExtractor::save_background() const {
  std::vector<std::byte> bytes;
  put_header(bytes, view_);
  background_.save(bytes);
  put(bytes, crc32c(bytes));
  return bytes;
}

Result<void> ForegroundExtractor::load_background(std::span<const std::byte> bytes) {
  std::vector<std::byte> header;
  put_header(header, view_);
  if (bytes.size() < header.size() + 8) return fail("background: too short, learn it again");
  std::uint32_t sum = 0;
  std::memcpy(&sum, bytes.data() + bytes.size() - 4, 4);
  if (std::memcmp(bytes.data(), kMagic, 4) != 0) return fail("background: not a background file");
  if (sum != crc32c(bytes.first(bytes.size() - 4))) {
    return fail("background: its sum does not match, the file is damaged, learn it again");
  }
  std::uint16_t version = 0;
  std::memcpy(&version, bytes.data() + 4, 2);
  if (version > kVersion) {
    return fail(fmt::format("background: made by a newer version ({})", version));
  }
  if (std::memcmp(bytes.data(), header.data(), header.size()) != 0) {
    return fail("background: learned with another image size, leaf size or inside, learn it again");
  }
  if (!background_.load(view_, bytes.subspan(header.size(), bytes.size() - header.size() - 4))) {
    return fail("background: its leaves do not fit, learn it again");
  }
  has_background_ = true;
  learning_ = false;
  return {};
}

}  // namespace wagonsight

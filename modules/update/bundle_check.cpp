#include "update/bundle_check.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>

namespace wagonsight {
namespace {

constexpr std::string_view kMagic = "wsbundle";
constexpr std::size_t kKeyAt = 8, kSizeAt = 16, kZeroAt = 20, kSignatureAt = 24;

void put_u32(std::string& out, std::size_t at, std::uint32_t value) {
  for (std::size_t i = 0; i < 4; ++i) out[at + i] = static_cast<char>((value >> (8 * i)) & 0xFFU);
}

std::uint32_t get_u32(std::string_view in, std::size_t at) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < 4; ++i)
    value |= static_cast<std::uint32_t>(static_cast<unsigned char>(in[at + i])) << (8 * i);
  return value;
}

template <std::size_t size>
std::array<std::uint8_t, size> get_bytes(std::string_view in, std::size_t at) {
  std::array<std::uint8_t, size> bytes{};
  std::memcpy(bytes.data(), in.data() + at, size);
  return bytes;
}

std::string_view noun(BundleKind kind) {
  return kind == BundleKind::kUpdate ? "update" : "provisioning";
}

}  // namespace

std::string signed_head(const Manifest& manifest, const SigningSeed& seed) {
  const std::string text = manifest_text(manifest);
  const KeyId id = key_id(public_key_of(seed));
  const Signature signature = sign(text, seed);
  std::string head(kBundleHeaderBytes, '\0');
  std::memcpy(head.data(), kMagic.data(), kMagic.size());
  std::memcpy(head.data() + kKeyAt, id.data(), id.size());
  put_u32(head, kSizeAt, static_cast<std::uint32_t>(text.size()));
  std::memcpy(head.data() + kSignatureAt, signature.data(), signature.size());
  return head + text;
}

Result<void> check_manifest(const Manifest& manifest, const BundleRules& rules) {
  const std::string_view what = noun(manifest.kind);
  if (manifest.kind == BundleKind::kProvision) {
    if (manifest.unit != rules.unit)
      return fail(
          fmt::format("this provisioning is signed for the unit {}, and this one is {}; "
                      "have it signed for this unit",
                      manifest.unit, rules.unit.empty() ? "not named yet" : rules.unit));
    if (manifest.index <= rules.provision_index)
      return fail(
          fmt::format("this {} has the index {}, and the unit took one with {} already; "
                      "have it signed with a higher one",
                      what, manifest.index, rules.provision_index));
    return {};
  }
  if (manifest.architecture != rules.architecture)
    return fail(
        fmt::format("this update is for the architecture {}, and this unit is {}; take the "
                    "bundle of its architecture",
                    manifest.architecture, rules.architecture));
  if (manifest.index < rules.update_index)
    return fail(
        fmt::format("this update ({}) is older than what already ran well here: its "
                    "rollback index is {}, the unit's is {}; take a newer bundle",
                    manifest.version, manifest.index, rules.update_index));
  for (const std::string_view name : {"root", "kernel", "initramfs"})
    if (manifest.part(name) == nullptr)
      return fail(fmt::format("this update has no part {}; make it with scripts/bundle", name));
  return {};
}

BundleCheck::BundleCheck(BundleRules rules, std::uint64_t total_bytes)
    : rules_(std::move(rules)), total_bytes_(total_bytes) {}

std::uint64_t BundleCheck::bundle_bytes() const {
  return manifest_ ? payload_start() + manifest_->payload_bytes() : 0;
}

Result<void> BundleCheck::take(std::span<const std::byte> bytes) {
  if (!refusal_.empty()) return fail(refusal_);
  while (!bytes.empty()) {
    auto taken = take_some(bytes);
    if (taken) continue;
    refusal_ = taken.error().message;
    return taken;
  }
  return {};
}

Result<void> BundleCheck::take_some(std::span<const std::byte>& bytes) {
  const auto cut = [&](std::uint64_t wanted) {
    const auto size = static_cast<std::size_t>(std::min<std::uint64_t>(wanted, bytes.size()));
    const auto piece = bytes.first(size);
    bytes = bytes.subspan(size);
    taken_ += size;
    return piece;
  };
  if (!manifest_) {
    const std::size_t wanted = kBundleHeaderBytes + manifest_bytes_ - head_.size();
    const auto piece = cut(wanted);
    head_.append(reinterpret_cast<const char*>(piece.data()), piece.size());
    if (piece.size() < wanted) return {};
    return manifest_bytes_ == 0 ? read_header() : read_manifest();
  }
  if (part_ == manifest_->parts.size())
    return fail("the file goes on where the bundle ends; fetch it again");
  const std::uint64_t wanted = manifest_->parts[part_].chunk_bytes(chunk_) - chunk_taken_;
  const auto piece = cut(wanted);
  digest_.add(piece);
  chunk_taken_ += piece.size();
  return piece.size() == wanted ? end_chunk() : Result<void>{};
}

Result<void> BundleCheck::read_header() {
  if (!head_.starts_with(kMagic) || get_u32(head_, kZeroAt) != 0)
    return fail("this is no wagonsight bundle; make one with scripts/bundle");
  manifest_bytes_ = get_u32(head_, kSizeAt);
  if (manifest_bytes_ == 0 || manifest_bytes_ > kManifestBytesMax)
    return fail(
        fmt::format("the bundle is damaged: its manifest cannot have {} bytes; fetch it "
                    "again",
                    manifest_bytes_));
  // Which of the unit's keys it names; that it was signed with it shows the signature.
  const KeyId id = get_bytes<8>(head_, kKeyAt);
  const bool is_known = (rules_.update_key && id == key_id(*rules_.update_key)) ||
                        (rules_.provision_key && id == key_id(*rules_.provision_key));
  if (!rules_.update_key && !rules_.provision_key)
    return fail(
        "this unit's image was built without a public key, so it takes no bundle; flash an "
        "image that was made with --key");
  if (!is_known)
    return fail(fmt::format(
        "the bundle is signed with the key {}, which this unit does not trust; "
        "it trusts {}",
        hex_text(id),
        hex_text(key_id(rules_.update_key ? *rules_.update_key : *rules_.provision_key))));
  return {};
}

Result<void> BundleCheck::read_manifest() {
  const std::string_view text = std::string_view(head_).substr(kBundleHeaderBytes);
  const Signature signature = get_bytes<64>(head_, kSignatureAt);
  const KeyId id = get_bytes<8>(head_, kKeyAt);
  const auto fits = [&](const std::optional<PublicKey>& key) {
    return key && id == key_id(*key) && is_signed(text, signature, *key);
  };
  const bool by_update_key = fits(rules_.update_key), by_provision_key = fits(rules_.provision_key);
  if (!by_update_key && !by_provision_key)
    return fail(
        "the bundle is damaged or was changed: its signature does not fit its manifest; "
        "fetch it again");
  auto manifest = parse_manifest(text);
  if (!manifest)
    return fail(fmt::format("the bundle cannot be read: {}", manifest.error().message));
  const bool is_update = manifest->kind == BundleKind::kUpdate;
  if (is_update ? !by_update_key : !by_provision_key)
    return fail(
        fmt::format("the bundle's key {} may not sign {} for this unit; have the right one sign it",
                    hex_text(id), is_update ? "an update" : "a provisioning"));
  if (auto checked = check_manifest(*manifest, rules_); !checked) return checked;
  manifest_ = std::move(*manifest);
  head_ = {};
  if (total_bytes_ != 0 && total_bytes_ < bundle_bytes())
    return fail(
        fmt::format("the file is cut off: it has {} bytes of the bundle's {}; fetch it "
                    "again",
                    total_bytes_, bundle_bytes()));
  skip_empty_parts();
  return {};
}

void BundleCheck::skip_empty_parts() {
  while (part_ < manifest_->parts.size() && chunk_ == manifest_->parts[part_].chunks.size()) {
    ++part_;
    chunk_ = 0;
  }
}

Result<void> BundleCheck::end_chunk() {
  const BundlePart& part = manifest_->parts[part_];
  if (digest_.finish() != part.chunks[chunk_])
    return fail(
        fmt::format("the bundle is damaged: chunk {} of {} in part {} (its bytes from {}) "
                    "is not what was signed; fetch it again",
                    chunk_ + 1, part.chunks.size(), part.name, chunk_ * kChunkBytes));
  chunk_taken_ = 0;
  ++chunk_;
  skip_empty_parts();
  return {};
}

Result<void> BundleCheck::finish() const {
  if (!refusal_.empty()) return fail(refusal_);
  if (is_complete()) return {};
  const std::uint64_t whole = bundle_bytes();
  return fail(whole == 0 ? fmt::format("the file is cut off within its first {} bytes; fetch it "
                                       "again",
                                       taken_)
                         : fmt::format("the file is cut off: it has {} bytes of the bundle's {}; "
                                       "fetch it again",
                                       taken_, whole));
}

}  // namespace wagonsight

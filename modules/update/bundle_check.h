#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "base/result.h"
#include "update/manifest.h"

// A bundle as bytes: a header, the manifest, the parts one behind the other. All numbers are
// little-endian.
//
//     0   8  "wsbundle"
//     8   8  the key it is signed with: the first bytes of the SHA-256 of the public key
//    16   4  the manifest's size in bytes
//    20   4  zero
//    24  64  the Ed25519 signature of the manifest
//    88      the manifest, then the payload
namespace wagonsight {

inline constexpr std::size_t kBundleHeaderBytes = 88;
using BundleHeader = std::array<std::byte, kBundleHeaderBytes>;

// The header and the manifest, signed; the payload follows them.
std::string signed_head(const Manifest& manifest, const SigningSeed& seed);

// What a unit holds a bundle against.
struct BundleRules {
  std::optional<PublicKey> update_key, provision_key;  // nothing: none was built into the image
  std::string architecture;
  std::string unit;                   // its own name
  std::uint64_t update_index = 0;     // of the newest version that was good here
  std::uint64_t provision_index = 0;  // of what it was provisioned with
};

// Whether a manifest that was signed by the right key is for this unit. The Error is the refusal.
Result<void> check_manifest(const Manifest& manifest, const BundleRules& rules);

// Takes a bundle piece by piece, in order, and refuses it at the first byte that tells that it must
// be: the key and the signature as soon as the manifest is there, every chunk at its last byte.
// Holds the manifest and nothing of the payload.
//
//   header --88 bytes--> manifest --signed, for this unit--> payload --last chunk--> complete
//      any Error --> refused (it stays so)
class BundleCheck {
 public:
  // `total_bytes`: of the whole file where that is known, to tell at once that it was cut off;
  // zero: not known.
  explicit BundleCheck(BundleRules rules, std::uint64_t total_bytes = 0);

  Result<void> take(std::span<const std::byte> bytes);
  // To be asked when there is nothing more to come: the Error tells what lacks.
  Result<void> finish() const;

  const Manifest* manifest() const { return manifest_ ? &*manifest_ : nullptr; }
  std::uint64_t taken_bytes() const { return taken_; }
  std::uint64_t payload_start() const { return kBundleHeaderBytes + manifest_bytes_; }
  std::uint64_t bundle_bytes() const;  // zero while it is not known
  bool is_complete() const { return manifest_ && taken_ == bundle_bytes(); }

 private:
  Result<void> take_some(std::span<const std::byte>& bytes);
  Result<void> read_header();
  Result<void> read_manifest();
  Result<void> end_chunk();
  void skip_empty_parts();

  BundleRules rules_;
  std::uint64_t total_bytes_;
  std::string head_;  // header and manifest, as far as they have come
  std::size_t manifest_bytes_ = 0;
  std::optional<Manifest> manifest_;
  std::uint64_t taken_ = 0;
  std::size_t part_ = 0, chunk_ = 0;
  std::uint64_t chunk_taken_ = 0;
  DigestOfPieces digest_;
  std::string refusal_;
};

}  // namespace wagonsight

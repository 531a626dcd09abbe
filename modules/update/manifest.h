#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/result.h"
#include "update/keys.h"

// What a bundle says of itself; its signature is over exactly this text. README.md has the format.
namespace wagonsight {

enum class BundleKind : std::uint8_t {
  kUpdate,     // another root, kernel and initramfs, for every unit of an architecture
  kProvision,  // settings, calibration and the like, for one unit
};
std::string_view to_text(BundleKind kind);  // "update", "provision"

// Of every chunk but a part's last one: large enough that a manifest stays small, small enough that
// what is written again after a power cut, and what one flipped bit condemns, is.
inline constexpr std::uint64_t kChunkBytes = 65'536;
inline constexpr std::uint64_t kPartBytesMax = std::uint64_t{128} << 20U;
inline constexpr std::size_t kPartsMax = 32;
inline constexpr std::size_t kManifestBytesMax = std::size_t{256} << 10U;

struct BundlePart {
  std::string name;
  std::uint64_t bytes = 0;
  std::vector<Digest> chunks;

  std::uint64_t chunk_bytes(std::size_t index) const;  // of the chunk with this index
};

struct Manifest {
  BundleKind kind = BundleKind::kUpdate;
  std::string version;       // for people
  std::uint64_t index = 0;   // rises with every version; older ones are refused
  std::string architecture;  // of an update: "x86_64", "aarch64"
  std::string unit;          // of a provisioning: whom it is for
  std::string boot;          // of an update: the kernel's words, without slot=
  std::vector<BundlePart> parts;

  std::uint64_t payload_bytes() const;
  const BundlePart* part(std::string_view name) const;  // nullptr: none
};

std::size_t chunk_count(std::uint64_t bytes);
// The digests of a part that is wholly in memory.
BundlePart make_part(std::string name, std::span<const std::byte> bytes);

// A name that can stand in a manifest and in a folder: letters, digits and "._-", no leading point.
bool is_part_name(std::string_view name);
bool is_unit_name(std::string_view name);

std::string manifest_text(const Manifest& manifest);
// The Error names the line. Allocates at most a few times the text.
Result<Manifest> parse_manifest(std::string_view text);

}  // namespace wagonsight

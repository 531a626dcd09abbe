#include <cstdint>
#include <cstdlib>
#include <vector>

#include "rig/blob.h"
#include "support/blob_reseal.h"
#include "support/sample_rig.h"

// A calibration blob from anywhere: refused, or a rig that may be used and rays that lie inside.
namespace {

using namespace wagonsight;  // NOLINT(google-build-using-namespace): one short target

void require(bool holds) {
  if (!holds) std::abort();
}

void open_and_use(std::span<const std::byte> bytes) {
  const auto blob = open_blob(bytes);
  if (!blob) return require(!blob.error().message.empty());
  require(check_rig(blob->rig).has_value());
  // Every ray is read, under the address sanitizer's eyes: a fixed-point number has its scale.
  for (const RayTable rays : blob->rays)
    for (const PixelRay ray : rays) require(std::abs(static_cast<float>(ray.x) * kRayScale) <= 2);
  // What was accepted can be packed and opened again.
  require(open_blob(pack_blob(blob->rig)).has_value());
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto input = std::as_bytes(std::span(data, size));
  // Vectors, so that their end is the end of the allocation.
  std::vector<std::byte> raw(input.begin(), input.end());
  open_and_use(raw);
  test::reseal_blob(raw);
  open_and_use(raw);

  // Edits of a good blob, resealed, reach what lies behind the sums: three bytes an edit, where
  // (16 bit) and what.
  static const std::vector<std::byte> good = pack_blob(test::sample_rig(3, 2));
  std::vector<std::byte> edited = good;
  for (std::size_t i = 0; i + 3 <= size; i += 3)
    edited[(data[i] * 256U + data[i + 1]) % edited.size()] = std::byte(data[i + 2]);
  test::reseal_blob(edited);
  open_and_use(edited);
  return 0;
}

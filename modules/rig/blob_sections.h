#pragma once

#include <cstddef>
#include <span>

#include "rig/bytes.h"
#include "rig/rig.h"

// What is inside the blob's sections: one description of each structure's fields, used to write and
// to read them. The container around them is blob.cpp's.
namespace wagonsight {

void write_section(const RigSensor& sensor, ByteWriter& out);
void write_section(const StereoGeometry& lenses, ByteWriter& out);  // all but the baseline
void write_section(const StampDelay& delay, ByteWriter& out);
void write_section(const Georeference& georeference, ByteWriter& out);
void write_section(const Provenance& provenance, ByteWriter& out);

// False when the bytes are too few, too many or no such structure; values are not judged
// (check_rig() does that).
[[nodiscard]] bool read_section(std::span<const std::byte> bytes, RigSensor& sensor);
[[nodiscard]] bool read_section(std::span<const std::byte> bytes, StereoGeometry& lenses);
[[nodiscard]] bool read_section(std::span<const std::byte> bytes, StampDelay& delay);
[[nodiscard]] bool read_section(std::span<const std::byte> bytes, Georeference& georeference);
[[nodiscard]] bool read_section(std::span<const std::byte> bytes, Provenance& provenance);

}  // namespace wagonsight

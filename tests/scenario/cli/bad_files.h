#pragma once

#include <filesystem>

namespace wagonsight::testing {

// Writes into `folder` the broken files that the table in tests/README.md names, and the whole ones
// that they are broken from: sim.mcap (k0, a passenger) and rig.blob are there already.
void write_bad_files(const std::filesystem::path& folder);

}  // namespace wagonsight::testing

#pragma once

#include <cstddef>

namespace wagonsight {

// How often this program has asked for memory by `new`, ever.
std::size_t allocation_count();

}  // namespace wagonsight

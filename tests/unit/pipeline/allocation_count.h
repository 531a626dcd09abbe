#pragma once

#include <cstddef>

namespace wagonsight::testing {

// How often this program has asked for memory so far (every form of operator new).
std::size_t allocation_count();

}  // namespace wagonsight::testing

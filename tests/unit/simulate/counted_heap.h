#pragma once

#include <cstddef>

namespace wagonsight {

// How often this program has asked for memory by `new`, ever.
std::size_t allocation_count();
// False under a sanitizer.
bool allocations_are_counted();
void count_allocation();

}  // namespace wagonsight

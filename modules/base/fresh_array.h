#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <memory>
#include <new>
#include <type_traits>

#include "base/check.h"

namespace wagonsight {

struct FreeMemory {
  void operator()(void* memory) const { std::free(memory); }
};

template <class T>
using FreshArray = std::unique_ptr<T[], FreeMemory>;

// `count` values T{}, as std::make_unique<T[]> gives them, but of memory that the system provides
// when it is first touched. A capacity is a sum for the worst case; what no frame ever needs of it
// is then never resident. Allocates; not for the data path.
template <class T>
FreshArray<T> make_fresh_array(std::size_t count) {
  static_assert(std::is_trivially_copyable_v<T> && std::is_trivially_destructible_v<T>);
  static_assert(alignof(T) <= alignof(std::max_align_t));
  if (count == 0) return nullptr;
  void* memory = std::calloc(count, sizeof(T));
  WS_CHECK(memory != nullptr, "no memory for %zu values of %zu bytes", count, sizeof(T));
  T* items = static_cast<T*>(memory);
  ::new (items) T();
  // Memory from calloc is zero already: where T{} is zero, nothing is left to be written.
  const auto* first = reinterpret_cast<const unsigned char*>(items);
  if (!std::all_of(first, first + sizeof(T), [](unsigned char byte) { return byte == 0; })) {
    std::uninitialized_value_construct_n(items, count);
  }
  return FreshArray<T>(items);
}

}  // namespace wagonsight

#pragma once

#include <array>
#include <cstddef>
#include <type_traits>

#include "base/check.h"

namespace wagonsight {

// At most N values stored in place, for flat structures that may live in shared memory.
// try_push_back says false when full; nothing allocates, nothing throws.
template <class T, std::size_t N>
class FixedVector {
  static_assert(std::is_trivially_destructible_v<T>, "FixedVector holds flat values");

 public:
  using value_type = T;

  constexpr std::size_t size() const { return size_; }
  constexpr bool empty() const { return size_ == 0; }
  constexpr bool full() const { return size_ == N; }
  static constexpr std::size_t capacity() { return N; }

  constexpr T* begin() { return items_.data(); }
  constexpr T* end() { return items_.data() + size_; }
  constexpr const T* begin() const { return items_.data(); }
  constexpr const T* end() const { return items_.data() + size_; }
  constexpr T* data() { return items_.data(); }
  constexpr const T* data() const { return items_.data(); }

  T& operator[](std::size_t index) {
    WS_CHECK(index < size_, "index %zu of %zu", index, size_);
    return items_[index];
  }
  const T& operator[](std::size_t index) const {
    WS_CHECK(index < size_, "index %zu of %zu", index, size_);
    return items_[index];
  }
  T& back() { return (*this)[size_ - 1]; }
  const T& back() const { return (*this)[size_ - 1]; }

  [[nodiscard]] bool try_push_back(const T& value) {
    if (full()) return false;
    items_[size_++] = value;
    return true;
  }
  void push_back(const T& value) { WS_CHECK(try_push_back(value), "capacity %zu", N); }
  void pop_back() {
    WS_CHECK(size_ > 0, "pop of an empty vector");
    --size_;
  }
  void clear() { size_ = 0; }
  // New items are value-initialised.
  void resize(std::size_t size) {
    WS_CHECK(size <= N, "size %zu of capacity %zu", size, N);
    for (std::size_t i = size_; i < size; ++i) items_[i] = T{};
    size_ = size;
  }

 private:
  std::size_t size_ = 0;
  std::array<T, N> items_{};
};

}  // namespace wagonsight

#pragma once

#include <cstddef>
#include <span>
#include <type_traits>

#include "base/check.h"
#include "base/fresh_array.h"

namespace wagonsight {

// A vector whose capacity is chosen once, when it is made; it allocates then and never again.
// Keeps a high-water mark for the metrics. For the working memory of the data path.
template <class T>
class BoundedVector {
  static_assert(std::is_trivially_copyable_v<T>, "BoundedVector holds flat values");

 public:
  BoundedVector() = default;
  explicit BoundedVector(std::size_t capacity)
      : items_(make_fresh_array<T>(capacity)), capacity_(capacity) {}

  std::size_t size() const { return size_; }
  std::size_t capacity() const { return capacity_; }
  std::size_t high_water() const { return high_water_; }
  bool empty() const { return size_ == 0; }
  bool full() const { return size_ == capacity_; }

  T* begin() { return items_.get(); }
  T* end() { return items_.get() + size_; }
  const T* begin() const { return items_.get(); }
  const T* end() const { return items_.get() + size_; }
  T* data() { return items_.get(); }
  const T* data() const { return items_.get(); }
  std::span<T> span() { return {items_.get(), size_}; }
  std::span<const T> span() const { return {items_.get(), size_}; }

  // Unchecked in the inner loops on purpose: callers index within size().
  T& operator[](std::size_t index) { return items_[index]; }
  const T& operator[](std::size_t index) const { return items_[index]; }

  // False when full: the caller counts what it drops.
  [[nodiscard]] bool try_push_back(const T& value) {
    if (size_ == capacity_) return false;
    items_[size_++] = value;
    if (size_ > high_water_) high_water_ = size_;
    return true;
  }
  void clear() { size_ = 0; }
  // Items beyond the old size keep whatever was there before.
  void resize(std::size_t size) {
    WS_CHECK(size <= capacity_, "size %zu of capacity %zu", size, capacity_);
    size_ = size;
    if (size_ > high_water_) high_water_ = size_;
  }

 private:
  FreshArray<T> items_;
  std::size_t capacity_ = 0;
  std::size_t size_ = 0;
  std::size_t high_water_ = 0;
};

}  // namespace wagonsight

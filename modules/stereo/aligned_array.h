#pragma once

#include <algorithm>
#include <cstddef>
#include <memory>
#include <new>

namespace wagonsight {

// Zeroed memory of a size chosen once, aligned to a cache line. For the workspaces of this module.
template <class T>
class AlignedArray {
 public:
  AlignedArray() = default;
  explicit AlignedArray(std::size_t size)
      : items_(static_cast<T*>(::operator new(size * sizeof(T), kAlignment))), size_(size) {
    std::fill_n(items_.get(), size, T{});
  }

  T* data() { return items_.get(); }
  const T* data() const { return items_.get(); }
  std::size_t size() const { return size_; }
  T& operator[](std::size_t index) { return items_.get()[index]; }
  const T& operator[](std::size_t index) const { return items_.get()[index]; }

 private:
  static constexpr std::align_val_t kAlignment{64};
  struct Release {
    void operator()(T* items) const { ::operator delete(items, kAlignment); }
  };
  std::unique_ptr<T, Release> items_;
  std::size_t size_ = 0;
};

}  // namespace wagonsight

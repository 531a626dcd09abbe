#pragma once

#include <atomic>
#include <cstddef>
#include <memory>
#include <type_traits>

#include "base/check.h"

namespace wagonsight {

// A bounded queue between exactly one producer and one consumer thread; lock-free, wait-free,
// allocates only when made. Lamport's ring with cached indices.
template <class T>
class SpscRing {
  static_assert(std::is_trivially_copyable_v<T>, "SpscRing moves flat values");

 public:
  // Holds `capacity` items; a power of two.
  explicit SpscRing(std::size_t capacity)
      : items_(std::make_unique<T[]>(capacity)), capacity_(capacity) {
    WS_CHECK(capacity > 0 && (capacity & (capacity - 1)) == 0, "capacity %zu", capacity);
  }

  // Producer only. False when full.
  [[nodiscard]] bool try_push(const T& item) {
    const std::size_t tail = tail_.load(std::memory_order_relaxed);
    if (tail - head_seen_ == capacity_) {
      head_seen_ = head_.load(std::memory_order_acquire);
      if (tail - head_seen_ == capacity_) return false;
    }
    items_[tail & (capacity_ - 1)] = item;
    tail_.store(tail + 1, std::memory_order_release);
    return true;
  }

  // Consumer only. False when empty.
  [[nodiscard]] bool try_pop(T& item) {
    const std::size_t head = head_.load(std::memory_order_relaxed);
    if (head == tail_seen_) {
      tail_seen_ = tail_.load(std::memory_order_acquire);
      if (head == tail_seen_) return false;
    }
    item = items_[head & (capacity_ - 1)];
    head_.store(head + 1, std::memory_order_release);
    return true;
  }

  // Exact for the calling side, a moment old for the other.
  std::size_t size() const {
    return tail_.load(std::memory_order_acquire) - head_.load(std::memory_order_acquire);
  }
  std::size_t capacity() const { return capacity_; }

 private:
  static constexpr std::size_t kCacheLine = 64;
  std::unique_ptr<T[]> items_;
  std::size_t capacity_;
  alignas(kCacheLine) std::atomic<std::size_t> tail_{0};
  std::size_t head_seen_ = 0;  // producer's copy
  alignas(kCacheLine) std::atomic<std::size_t> head_{0};
  std::size_t tail_seen_ = 0;  // consumer's copy
};

}  // namespace wagonsight

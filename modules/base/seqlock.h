#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <type_traits>

namespace wagonsight {

// One flat value with one writer and any number of readers, none of whom can hold up another; fit
// for memory that processes share, also read-only. The writer never waits. Words are atomics
// between an odd and an even sequence number (Boehm, "Can seqlocks get along with programming
// language memory models?", MSPC 2012), so there is no data race to speak of. Release and acquire
// words instead of Boehm's fences, which the thread sanitizer does not understand: whoever sees a
// word of a store also sees the odd number that went before it.
template <class T>
class Seqlock {
  static_assert(std::is_trivially_copyable_v<T>, "Seqlock shares flat values");
  static_assert(std::atomic<std::uint64_t>::is_always_lock_free);

 public:
  // One writer only.
  void store(const T& value) {
    const std::uint64_t sequence = sequence_.load(std::memory_order_relaxed);
    sequence_.store(sequence + 1, std::memory_order_relaxed);
    const auto* bytes = reinterpret_cast<const std::byte*>(&value);
    for (std::size_t i = 0; i < kWords; ++i) {
      std::uint64_t word = 0;
      std::memcpy(&word, bytes + i * sizeof word, size_of_word(i));
      words_[i].store(word, std::memory_order_release);
    }
    sequence_.store(sequence + 2, std::memory_order_release);
  }

  // Copies the newest whole value. False when nothing was ever stored, or when no whole value was
  // found in `tries` (the writer died while writing, or the memory is not what it should be).
  [[nodiscard]] bool load(T& value, int tries = 64) const {
    auto* bytes = reinterpret_cast<std::byte*>(&value);
    for (int i = 0; i < tries; ++i) {
      const std::uint64_t before = sequence_.load(std::memory_order_acquire);
      if (before == 0) return false;
      if (before % 2 == 1) continue;
      for (std::size_t k = 0; k < kWords; ++k) {
        const std::uint64_t word = words_[k].load(std::memory_order_acquire);
        std::memcpy(bytes + k * sizeof word, &word, size_of_word(k));
      }
      if (sequence_.load(std::memory_order_relaxed) == before) return true;
    }
    return false;
  }

  // How many values were stored; tells a reader cheaply whether there is something new.
  std::uint64_t version() const { return sequence_.load(std::memory_order_acquire) / 2; }

 private:
  static constexpr std::size_t kWordBytes = sizeof(std::uint64_t);
  static constexpr std::size_t kWords = (sizeof(T) + kWordBytes - 1) / kWordBytes;
  static constexpr std::size_t size_of_word(std::size_t i) {
    return i + 1 < kWords ? kWordBytes : sizeof(T) - i * kWordBytes;
  }

  std::atomic<std::uint64_t> sequence_{0};
  std::array<std::atomic<std::uint64_t>, kWords> words_{};
};

}  // namespace wagonsight

#include "frame/frame.h"

#include <new>

#include "base/check.h"

namespace wagonsight {
namespace {

constexpr std::size_t kSlotAlignment = 64;  // a cache line, and any SIMD load

std::size_t rounded_up(std::size_t bytes) {
  return (bytes + kSlotAlignment - 1) / kSlotAlignment * kSlotAlignment;
}

std::byte* aligned_memory(std::size_t bytes) {
  return static_cast<std::byte*>(::operator new (bytes, std::align_val_t{kSlotAlignment}));
}

void free_aligned(std::byte* memory) {
  ::operator delete (memory, std::align_val_t{kSlotAlignment});
}

}  // namespace

FramePool::FramePool(std::size_t slot_count, std::size_t slot_bytes)
    : slot_count_(slot_count),
      slots_(std::make_unique<FrameSlot[]>(slot_count)),
      taken_(std::make_unique<std::atomic<bool>[]>(slot_count)),
      memory_(aligned_memory(slot_count * rounded_up(slot_bytes)), free_aligned) {
  for (std::size_t i = 0; i < slot_count; ++i)
    slots_[i].bytes = {memory_.get() + i * rounded_up(slot_bytes), slot_bytes};
}

FrameSlot* FramePool::acquire() {
  for (std::size_t i = 0; i < slot_count_; ++i) {
    bool expected = false;
    if (!taken_[i].compare_exchange_strong(expected, true, std::memory_order_acquire)) continue;
    const std::size_t used = in_use_.fetch_add(1, std::memory_order_relaxed) + 1;
    std::size_t high = high_water_.load(std::memory_order_relaxed);
    while (used > high && !high_water_.compare_exchange_weak(high, used)) {
    }
    const auto bytes = slots_[i].bytes;
    slots_[i] = FrameSlot{};
    slots_[i].bytes = bytes;
    return &slots_[i];
  }
  return nullptr;
}

void FramePool::release(FrameSlot* slot) {
  if (slot == nullptr) return;
  const auto index = static_cast<std::size_t>(slot - slots_.get());
  WS_CHECK(index < slot_count_, "slot %zu of %zu", index, slot_count_);
  in_use_.fetch_sub(1, std::memory_order_relaxed);
  const bool was_taken = taken_[index].exchange(false, std::memory_order_release);
  WS_CHECK(was_taken, "slot %zu released twice", index);
}

}  // namespace wagonsight

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <deque>
#include <string>
#include <vector>

#include "base/bounded_vector.h"
#include "base/crc32c.h"
#include "base/fixed_string.h"
#include "base/fixed_vector.h"
#include "base/spsc_ring.h"
#include "base/time.h"

namespace wagonsight {
namespace {

// The oracle of the table-driven sum: one bit at a time.
std::uint32_t crc32c_by_bits(const std::vector<std::uint8_t>& bytes) {
  std::uint32_t crc = ~0U;
  for (const std::uint8_t byte : bytes) {
    crc ^= byte;
    for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1) ^ ((crc & 1U) ? 0x82F63B78U : 0U);
  }
  return ~crc;
}

RC_GTEST_PROP(Crc32cProperty, IsTheSumBitByBit, (const std::vector<std::uint8_t>& bytes)) {
  RC_ASSERT(crc32c(std::as_bytes(std::span(bytes))) == crc32c_by_bits(bytes));
}

RC_GTEST_PROP(Crc32cProperty, ContinuesAtAnyCut, (const std::vector<std::uint8_t>& bytes)) {
  const auto all = std::as_bytes(std::span(bytes));
  const std::size_t cut = *rc::gen::inRange<std::size_t>(0, bytes.size() + 1);
  RC_ASSERT(crc32c(all.subspan(cut), crc32c(all.first(cut))) == crc32c(all));
}

RC_GTEST_PROP(FixedStringProperty, IsThePrefixThatFits, (const std::string& text)) {
  FixedString<12> fixed("something longer before");
  fixed.assign(text);
  RC_ASSERT(fixed.view() == std::string_view(text).substr(0, 12));
  RC_ASSERT(fixed == FixedString<12>(text));
}

// Both containers against std::vector under the same random calls.
template <class Container>
void behaves_like_a_vector(Container& container, std::size_t capacity) {
  std::vector<int> model;
  std::size_t high_water = 0;
  const auto calls = *rc::gen::container<std::vector<int>>(rc::gen::inRange(0, 40));
  for (const int call : calls) {
    if (call < 30) {
      const bool fits = model.size() < capacity;
      RC_ASSERT(container.try_push_back(call) == fits);
      if (fits) model.push_back(call);
    } else if (call < 32) {
      container.clear();
      model.clear();
    } else {
      const auto size = static_cast<std::size_t>(call - 32) % (model.size() + 1);
      container.resize(size);
      model.resize(size);
    }
    high_water = std::max(high_water, model.size());
    RC_ASSERT(container.size() == model.size());
    RC_ASSERT(container.full() == (model.size() == capacity));
    RC_ASSERT(std::equal(container.begin(), container.end(), model.begin(), model.end()));
  }
  if constexpr (requires { container.high_water(); })
    RC_ASSERT(container.high_water() == high_water);
}

RC_GTEST_PROP(FixedVectorProperty, BehavesLikeAVector, ()) {
  FixedVector<int, 7> vector;
  behaves_like_a_vector(vector, 7);
}

RC_GTEST_PROP(BoundedVectorProperty, BehavesLikeAVector, ()) {
  const auto capacity = *rc::gen::inRange<std::size_t>(0, 12);
  BoundedVector<int> vector(capacity);
  behaves_like_a_vector(vector, capacity);
}

RC_GTEST_PROP(SpscRingProperty, BehavesLikeABoundedQueue, (const std::vector<int>& calls)) {
  const std::size_t capacity = std::size_t{1} << *rc::gen::inRange(0, 5);
  SpscRing<int> ring(capacity);
  std::deque<int> model;
  for (const int call : calls) {
    if (call % 2 == 0) {
      RC_ASSERT(ring.try_push(call) == (model.size() < capacity));
      if (model.size() < capacity) model.push_back(call);
    } else {
      int item = 0;
      RC_ASSERT(ring.try_pop(item) == !model.empty());
      if (model.empty()) continue;
      RC_ASSERT(item == model.front());
      model.pop_front();
    }
    RC_ASSERT(ring.size() == model.size());
  }
}

RC_GTEST_PROP(TimeProperty, RoundTripsThroughSeconds, ()) {
  // A double has 53 bits: nanoseconds survive for about 100 days.
  const auto ns = *rc::gen::inRange<std::int64_t>(-(1LL << 52), 1LL << 52);
  const std::int64_t back = from_seconds(to_seconds(Duration(ns))).count();
  RC_ASSERT(std::abs(back - ns) <= 1);
}

}  // namespace
}  // namespace wagonsight

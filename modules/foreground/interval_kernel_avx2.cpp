// The only file that is compiled for AVX2; reached only after has_avx2().
#include <immintrin.h>

#include "foreground/interval_kernel.h"

namespace wagonsight {
namespace {

__m256i load(const std::uint16_t* values) {
  return _mm256_loadu_si256(reinterpret_cast<const __m256i*>(values));
}

// All bits of a lane where low <= value <= high, unsigned.
__m256i within(__m256i value, __m256i low, __m256i high) {
  return _mm256_and_si256(_mm256_cmpeq_epi16(_mm256_max_epu16(value, low), value),
                          _mm256_cmpeq_epi16(_mm256_min_epu16(value, high), value));
}

// One bit a lane of two vectors, in order.
std::uint64_t bits_of(__m256i low, __m256i high) {
  const __m256i packed = _mm256_permute4x64_epi64(_mm256_packs_epi16(low, high), 0xD8);
  return static_cast<std::uint32_t>(_mm256_movemask_epi8(packed));
}

}  // namespace

void compare_intervals_avx2(const std::uint16_t* raw, const IntervalArrays& arrays,
                            std::size_t words, std::uint64_t* before, std::uint64_t* beyond) {
  const __m256i zero = _mm256_setzero_si256();
  const __m256i near_all = _mm256_set1_epi16(static_cast<short>(arrays.near_all));
  for (std::size_t word = 0; word < words; ++word) {
    const std::size_t first = word * 64;
    __m256i values[4], open[4];
    __m256i any = zero;
    for (std::size_t i = 0; i < 4; ++i) {
      const std::size_t at = first + i * 16;
      values[i] = load(raw + at);
      // No reading, or the background where it usually is: most pixels of most frames end here.
      const __m256i known = _mm256_or_si256(
          within(values[i], load(arrays.first_near + at), load(arrays.first_far + at)),
          _mm256_cmpeq_epi16(values[i], zero));
      open[i] = _mm256_xor_si256(known, _mm256_set1_epi16(-1));
      any = _mm256_or_si256(any, open[i]);
    }
    if (_mm256_testz_si256(any, any) != 0) {
      before[word] = beyond[word] = 0;
      continue;
    }
    const __m256i far_most = _mm256_set1_epi16(static_cast<short>(arrays.far_most[word]));
    const __m256i far_least = _mm256_set1_epi16(static_cast<short>(arrays.far_least[word]));
    __m256i is_before[4], is_beyond[4];
    for (std::size_t i = 0; i < 4; ++i) {
      const std::size_t at = first + i * 16;
      const __m256i second_far = load(arrays.second_far + at);
      const __m256i second = within(values[i], load(arrays.second_near + at), second_far);
      const __m256i near = arrays.near != nullptr ? load(arrays.near + at) : near_all;
      const __m256i inside = within(values[i], near, far_most);
      const __m256i told = _mm256_andnot_si256(second, _mm256_and_si256(inside, open[i]));
      const __m256i not_beyond =
          _mm256_cmpeq_epi16(_mm256_min_epu16(values[i], second_far), values[i]);
      const __m256i sure = _mm256_cmpeq_epi16(_mm256_min_epu16(values[i], far_least), values[i]);
      const __m256i doubtful = _mm256_andnot_si256(sure, told);
      is_before[i] = _mm256_or_si256(_mm256_and_si256(told, not_beyond), doubtful);
      is_beyond[i] = _mm256_or_si256(_mm256_andnot_si256(not_beyond, told), doubtful);
    }
    before[word] = bits_of(is_before[0], is_before[1]) | bits_of(is_before[2], is_before[3]) << 32;
    beyond[word] = bits_of(is_beyond[0], is_beyond[1]) | bits_of(is_beyond[2], is_beyond[3]) << 32;
  }
}

}  // namespace wagonsight

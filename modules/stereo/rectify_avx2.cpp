#include <immintrin.h>

#include "stereo/rectify_kernels.h"
#include "stereo/resample_pixel.h"

// Compiled with -mavx2; called only where the processor has it.
namespace wagonsight::stereo_kernels {
namespace {

struct Avx2Resample {};

// Eight entries of a table: the index of the upper left pixel and pairs of 16-bit weights.
struct Eight {
  __m256i index, upper, lower, outside;
};

Eight eight_of(const std::uint32_t* table) {
  const __m256i entry = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(table));
  const __m256i low5 = _mm256_set1_epi32(31);
  const __m256i fine_u = _mm256_and_si256(entry, low5);
  const __m256i fine_v = _mm256_and_si256(_mm256_srli_epi32(entry, 5), low5);
  const __m256i full = _mm256_set1_epi32(32);
  // (32 - u) in the low half, u in the high one; the rows' weights in both halves.
  const __m256i across =
      _mm256_or_si256(_mm256_sub_epi32(full, fine_u), _mm256_slli_epi32(fine_u, 16));
  const __m256i down = _mm256_or_si256(fine_v, _mm256_slli_epi32(fine_v, 16));
  const __m256i up = _mm256_sub_epi16(_mm256_set1_epi16(32), down);
  const __m256i outside = _mm256_srai_epi32(entry, 31);
  // Pixels outside read the source's first ones and are cleared afterwards.
  const __m256i index = _mm256_andnot_si256(outside, _mm256_srli_epi32(entry, 10));
  return {index, _mm256_mullo_epi16(across, up), _mm256_mullo_epi16(across, down), outside};
}

__m256i blend_rows(const Eight& e, __m256i upper_pair, __m256i lower_pair) {
  const __m256i sum = _mm256_add_epi32(_mm256_madd_epi16(upper_pair, e.upper),
                                       _mm256_madd_epi16(lower_pair, e.lower));
  const __m256i rounded =
      _mm256_srli_epi32(_mm256_add_epi32(sum, _mm256_set1_epi32(kResampleRound)), kResampleShift);
  return _mm256_andnot_si256(e.outside, rounded);
}

// Two times eight 32-bit values below 2^16 as sixteen words in order.
__m256i packed(__m256i first, __m256i second) {
  return _mm256_permute4x64_epi64(_mm256_packus_epi32(first, second), 0xD8);
}

__m256i eight_words(const std::uint32_t* table, int width, const std::uint16_t* source) {
  const Eight e = eight_of(table);
  const auto* upper = reinterpret_cast<const int*>(source);
  const auto* lower = reinterpret_cast<const int*>(source + width);
  return blend_rows(e, _mm256_i32gather_epi32(upper, e.index, 2),
                    _mm256_i32gather_epi32(lower, e.index, 2));
}

void gray16(const ResampleRun& run, const std::uint16_t* source, std::uint16_t* out) {
  std::size_t i = 0;
  for (; i + 16 <= run.count; i += 16) {
    const __m256i first = eight_words(run.table + i, run.width, source);
    const __m256i second = eight_words(run.table + i + 8, run.width, source);
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(out + i), packed(first, second));
  }
  resample_pixels<Avx2Resample>(run.table, i, run.count, run.width, source, out);
}

// The low two bytes of each 32-bit value as two words.
__m256i two_words(__m256i four_bytes) {
  const __m256i low = _mm256_and_si256(four_bytes, _mm256_set1_epi32(0xFF));
  const __m256i high = _mm256_and_si256(four_bytes, _mm256_set1_epi32(0xFF00));
  return _mm256_or_si256(low, _mm256_slli_epi32(high, 8));
}

// False where a 32-bit read of the lower row would leave the image.
bool gather_is_safe(const Eight& e, int last_index) {
  const __m256i beyond = _mm256_cmpgt_epi32(e.index, _mm256_set1_epi32(last_index));
  return _mm256_testz_si256(beyond, beyond) != 0;
}

void gray8(const ResampleRun& run, const std::uint8_t* source, std::uint8_t* out) {
  const int last_index = static_cast<int>(run.size) - run.width - 4;
  const auto* upper = reinterpret_cast<const int*>(source);
  const auto* lower = reinterpret_cast<const int*>(source + run.width);
  const auto eight = [&](const Eight& e) {
    return blend_rows(e, two_words(_mm256_i32gather_epi32(upper, e.index, 1)),
                      two_words(_mm256_i32gather_epi32(lower, e.index, 1)));
  };
  std::size_t i = 0;
  for (; i + 16 <= run.count; i += 16) {
    const Eight a = eight_of(run.table + i), b = eight_of(run.table + i + 8);
    if (last_index < 0 || !gather_is_safe(a, last_index) || !gather_is_safe(b, last_index)) {
      resample_pixels<Avx2Resample>(run.table, i, i + 16, run.width, source, out);
      continue;
    }
    const __m256i words = packed(eight(a), eight(b));
    const __m128i bytes =
        _mm_packus_epi16(_mm256_castsi256_si128(words), _mm256_extracti128_si256(words, 1));
    _mm_storeu_si128(reinterpret_cast<__m128i*>(out + i), bytes);
  }
  resample_pixels<Avx2Resample>(run.table, i, run.count, run.width, source, out);
}

}  // namespace

const ResampleKernels& avx2_resample();

const ResampleKernels& avx2_resample() {
  static constexpr ResampleKernels kernels{"avx2", gray8, gray16};
  return kernels;
}

}  // namespace wagonsight::stereo_kernels

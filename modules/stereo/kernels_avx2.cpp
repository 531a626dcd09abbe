#include <immintrin.h>

#include <cstdint>

#include "stereo/kernel_body.h"

// Compiled with -mavx2; called only where the processor has it.
namespace wagonsight::stereo_kernels {
namespace {

// The vocabulary of kernel_body.h for AVX2: 32 bytes or 16 words at a time.
struct Avx2 {
  using Bytes = __m256i;
  using Words = __m256i;

  static Bytes load(const std::uint8_t* p) {
    return _mm256_loadu_si256(reinterpret_cast<const __m256i*>(p));
  }
  static void store(std::uint8_t* p, Bytes v) {
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(p), v);
  }
  static Bytes splat(std::uint8_t value) { return _mm256_set1_epi8(static_cast<char>(value)); }
  static Bytes add(Bytes a, Bytes b) { return _mm256_add_epi8(a, b); }
  static Bytes add_saturated(Bytes a, Bytes b) { return _mm256_adds_epu8(a, b); }
  static Bytes sub_saturated(Bytes a, Bytes b) { return _mm256_subs_epu8(a, b); }
  static Bytes least(Bytes a, Bytes b) { return _mm256_min_epu8(a, b); }
  // (a + b + 1) / 2
  static Bytes average(Bytes a, Bytes b) { return _mm256_avg_epu8(a, b); }
  static Bytes exclusive_or(Bytes a, Bytes b) { return _mm256_xor_si256(a, b); }
  static Bytes either(Bytes a, Bytes b) { return _mm256_or_si256(a, b); }
  // 255 where equal, else 0
  static Bytes equal(Bytes a, Bytes b) { return _mm256_cmpeq_epi8(a, b); }
  // b where mask is 255, else a
  static Bytes select(Bytes mask, Bytes a, Bytes b) { return _mm256_blendv_epi8(a, b, mask); }
  static Bytes lane_numbers() {
    return _mm256_setr_epi8(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19,
                            20, 21, 22, 23, 24, 25, 26, 27, 28, 29, 30, 31);
  }
  // Of bytes below 16.
  static Bytes bit_count(Bytes v) {
    const __m256i table = _mm256_setr_epi8(0, 1, 1, 2, 1, 2, 2, 3, 1, 2, 2, 3, 2, 3, 3, 4, 0, 1, 1,
                                           2, 1, 2, 2, 3, 1, 2, 2, 3, 2, 3, 3, 4);
    return _mm256_shuffle_epi8(table, v);
  }
  // Lane i of the result is lane i - 1 of v; lane 0 is the last one of `before`.
  static Bytes shift_up(Bytes before, Bytes v) {
    return _mm256_alignr_epi8(v, _mm256_permute2x128_si256(before, v, 0x21), 15);
  }
  // Lane i of the result is lane i + 1 of v; the last is lane 0 of `after`.
  static Bytes shift_down(Bytes v, Bytes after) {
    return _mm256_alignr_epi8(_mm256_permute2x128_si256(v, after, 0x21), v, 1);
  }
  // The least lane, in every lane.
  static Bytes least_everywhere(Bytes v) {
    __m128i m = _mm_min_epu8(_mm256_castsi256_si128(v), _mm256_extracti128_si256(v, 1));
    // Even bytes take the smaller of each pair; the odd ones become zero for the word minimum.
    m = _mm_min_epu8(m, _mm_srli_epi16(m, 8));
    m = _mm_minpos_epu16(_mm_and_si128(m, _mm_set1_epi16(255)));
    return _mm256_broadcastb_epi8(m);
  }
  static std::uint8_t first(Bytes v) {
    return static_cast<std::uint8_t>(_mm_cvtsi128_si32(_mm256_castsi256_si128(v)));
  }
  // Bit i is set where lane i is 255.
  static std::uint32_t bits(Bytes mask) {
    return static_cast<std::uint32_t>(_mm256_movemask_epi8(mask));
  }

  static Words load_words(const std::uint16_t* p) {
    return _mm256_loadu_si256(reinterpret_cast<const __m256i*>(p));
  }
  static Words load_signed(const std::int16_t* p) {
    return _mm256_loadu_si256(reinterpret_cast<const __m256i*>(p));
  }
  static void store_signed(std::int16_t* p, Words v) {
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(p), v);
  }
  static Words least_signed(Words a, Words b) { return _mm256_min_epi16(a, b); }
  static Words most_signed(Words a, Words b) { return _mm256_max_epi16(a, b); }
  // `value` where v >= 0, else -1.
  static Words where_not_negative(Words v, Words value) {
    return _mm256_or_si256(value, _mm256_srai_epi16(v, 15));
  }
  // 1 in each byte where a < b (words below 2^15), of 32 words; lanes in an order of its own.
  static Bytes below(Words a0, Words b0, Words a1, Words b1) {
    const __m256i both = _mm256_packs_epi16(_mm256_cmpgt_epi16(b0, a0), _mm256_cmpgt_epi16(b1, a1));
    return _mm256_sub_epi8(_mm256_setzero_si256(), both);
  }
  // The lanes of below() in the order of the pixels.
  static Bytes in_order(Bytes v) { return _mm256_permute4x64_epi64(v, 0xD8); }
};

}  // namespace

const Kernels& avx2_kernels();

const Kernels& avx2_kernels() {
  static constexpr Kernels kernels = KernelSet<Avx2>::named("avx2");
  return kernels;
}

}  // namespace wagonsight::stereo_kernels

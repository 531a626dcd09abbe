#include <arm_neon.h>

#include <cstdint>

#include "stereo/kernel_body.h"

// NEON is part of every aarch64.
namespace wagonsight::stereo_kernels {
namespace {

// The vocabulary of kernel_body.h: a pair of 16-byte registers stands for the 32 lanes.
struct Neon {
  struct Bytes {
    uint8x16_t a, b;
  };
  struct Words {
    int16x8_t a, b;
  };

  static Bytes load(const std::uint8_t* p) { return {vld1q_u8(p), vld1q_u8(p + 16)}; }
  static void store(std::uint8_t* p, Bytes v) {
    vst1q_u8(p, v.a);
    vst1q_u8(p + 16, v.b);
  }
  static Bytes splat(std::uint8_t value) { return {vdupq_n_u8(value), vdupq_n_u8(value)}; }
  static Bytes add(Bytes x, Bytes y) { return {vaddq_u8(x.a, y.a), vaddq_u8(x.b, y.b)}; }
  static Bytes add_saturated(Bytes x, Bytes y) {
    return {vqaddq_u8(x.a, y.a), vqaddq_u8(x.b, y.b)};
  }
  static Bytes sub_saturated(Bytes x, Bytes y) {
    return {vqsubq_u8(x.a, y.a), vqsubq_u8(x.b, y.b)};
  }
  static Bytes least(Bytes x, Bytes y) { return {vminq_u8(x.a, y.a), vminq_u8(x.b, y.b)}; }
  static Bytes average(Bytes x, Bytes y) { return {vrhaddq_u8(x.a, y.a), vrhaddq_u8(x.b, y.b)}; }
  static Bytes exclusive_or(Bytes x, Bytes y) { return {veorq_u8(x.a, y.a), veorq_u8(x.b, y.b)}; }
  static Bytes either(Bytes x, Bytes y) { return {vorrq_u8(x.a, y.a), vorrq_u8(x.b, y.b)}; }
  static Bytes equal(Bytes x, Bytes y) { return {vceqq_u8(x.a, y.a), vceqq_u8(x.b, y.b)}; }
  static Bytes select(Bytes mask, Bytes x, Bytes y) {
    return {vbslq_u8(mask.a, y.a, x.a), vbslq_u8(mask.b, y.b, x.b)};
  }
  static Bytes lane_numbers() {
    static constexpr std::uint8_t numbers[32] = {0,  1,  2,  3,  4,  5,  6,  7,  8,  9,  10,
                                                 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21,
                                                 22, 23, 24, 25, 26, 27, 28, 29, 30, 31};
    return load(numbers);
  }
  static Bytes bit_count(Bytes v) { return {vcntq_u8(v.a), vcntq_u8(v.b)}; }
  static Bytes shift_up(Bytes before, Bytes v) {
    return {vextq_u8(before.b, v.a, 15), vextq_u8(v.a, v.b, 15)};
  }
  static Bytes shift_down(Bytes v, Bytes after) {
    return {vextq_u8(v.a, v.b, 1), vextq_u8(v.b, after.a, 1)};
  }
  static Bytes least_everywhere(Bytes v) { return splat(vminvq_u8(vminq_u8(v.a, v.b))); }
  static std::uint8_t first(Bytes v) { return vgetq_lane_u8(v.a, 0); }
  static std::uint32_t bits(Bytes mask) {
    static constexpr std::uint8_t weights[16] = {1, 2, 4, 8, 16, 32, 64, 128,
                                                 1, 2, 4, 8, 16, 32, 64, 128};
    const uint8x16_t weight = vld1q_u8(weights);
    const auto sixteen = [&](uint8x16_t m) {
      const uint8x16_t picked = vandq_u8(m, weight);
      return static_cast<std::uint32_t>(vaddv_u8(vget_low_u8(picked))) |
             static_cast<std::uint32_t>(vaddv_u8(vget_high_u8(picked))) << 8;
    };
    return sixteen(mask.a) | sixteen(mask.b) << 16;
  }

  static Words load_words(const std::uint16_t* p) {
    return {vreinterpretq_s16_u16(vld1q_u16(p)), vreinterpretq_s16_u16(vld1q_u16(p + 8))};
  }
  static Words load_signed(const std::int16_t* p) { return {vld1q_s16(p), vld1q_s16(p + 8)}; }
  static void store_signed(std::int16_t* p, Words v) {
    vst1q_s16(p, v.a);
    vst1q_s16(p + 8, v.b);
  }
  static Words least_signed(Words x, Words y) { return {vminq_s16(x.a, y.a), vminq_s16(x.b, y.b)}; }
  static Words most_signed(Words x, Words y) { return {vmaxq_s16(x.a, y.a), vmaxq_s16(x.b, y.b)}; }
  static Words where_not_negative(Words v, Words value) {
    return {vorrq_s16(value.a, vshrq_n_s16(v.a, 15)), vorrq_s16(value.b, vshrq_n_s16(v.b, 15))};
  }
  static Bytes below(Words a0, Words b0, Words a1, Words b1) {
    const auto narrowed = [](Words x, Words y) {
      const uint8x16_t mask =
          vcombine_u8(vmovn_u16(vcltq_s16(x.a, y.a)), vmovn_u16(vcltq_s16(x.b, y.b)));
      return vandq_u8(mask, vdupq_n_u8(1));
    };
    return {narrowed(a0, b0), narrowed(a1, b1)};
  }
  static Bytes in_order(Bytes v) { return v; }
};

}  // namespace

const Kernels& neon_kernels();

const Kernels& neon_kernels() {
  static constexpr Kernels kernels = KernelSet<Neon>::named("neon");
  return kernels;
}

}  // namespace wagonsight::stereo_kernels

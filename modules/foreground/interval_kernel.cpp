#include "foreground/interval_kernel.h"

namespace wagonsight {

void compare_intervals_scalar(const std::uint16_t* raw, const IntervalArrays& arrays,
                              std::size_t words, std::uint64_t* before, std::uint64_t* beyond) {
  for (std::size_t word = 0; word < words; ++word) {
    std::uint64_t is_before = 0, is_beyond = 0;
    for (std::size_t place = 0; place < 64; ++place) {
      const std::size_t i = word * 64 + place;
      const bool background = (raw[i] >= arrays.first_near[i] && raw[i] <= arrays.first_far[i]) ||
                              (raw[i] >= arrays.second_near[i] && raw[i] <= arrays.second_far[i]);
      const std::uint16_t near = arrays.near != nullptr ? arrays.near[i] : arrays.near_all;
      const bool inside = raw[i] >= near && raw[i] <= arrays.far_most[word];
      if (background || !inside) continue;
      const std::uint64_t bit = std::uint64_t{1} << place;
      const bool doubtful = raw[i] > arrays.far_least[word];
      if (doubtful || raw[i] <= arrays.second_far[i]) is_before |= bit;
      if (doubtful || raw[i] > arrays.second_far[i]) is_beyond |= bit;
    }
    before[word] = is_before;
    beyond[word] = is_beyond;
  }
}

#if !defined(__x86_64__)
void compare_intervals_avx2(const std::uint16_t* raw, const IntervalArrays& arrays,
                            std::size_t words, std::uint64_t* before, std::uint64_t* beyond) {
  compare_intervals_scalar(raw, arrays, words, before, beyond);
}
bool has_avx2() {
  return false;
}
#else
bool has_avx2() {
  return __builtin_cpu_supports("avx2") != 0;
}
#endif

IntervalKernel best_interval_kernel() {
  return has_avx2() ? compare_intervals_avx2 : compare_intervals_scalar;
}

}  // namespace wagonsight

#pragma once

#include <cstdint>

namespace wagonsight {

// Counter-based random numbers: a hash of what they are for. The same on every platform, in any
// order, and without state. (Mixing steps of splitmix64, Steele et al. 2014.)
constexpr std::uint64_t mixed(std::uint64_t x) {
  x += 0x9E3779B97F4A7C15U;
  x = (x ^ (x >> 30U)) * 0xBF58476D1CE4E5B9U;
  x = (x ^ (x >> 27U)) * 0x94D049BB133111EBU;
  return x ^ (x >> 31U);
}
constexpr std::uint64_t mixed(std::uint64_t a, std::uint64_t b) {
  return mixed(mixed(a) ^ b);
}
constexpr std::uint64_t mixed(std::uint64_t a, std::uint64_t b, std::uint64_t c) {
  return mixed(mixed(a, b), c);
}
// Uniform in [0, 1).
constexpr double uniform(std::uint64_t bits) {
  return static_cast<double>(bits >> 11U) * (1.0 / 9007199254740992.0);
}

}  // namespace wagonsight

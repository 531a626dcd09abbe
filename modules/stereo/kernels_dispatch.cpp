#include "stereo/matcher_kernels.h"

namespace wagonsight::stereo_kernels {

#if defined(__x86_64__)
const Kernels& avx2_kernels();

const Kernels& best_kernels() {
  return __builtin_cpu_supports("avx2") ? avx2_kernels() : scalar_kernels();
}
#elif defined(__aarch64__)
const Kernels& neon_kernels();

const Kernels& best_kernels() {
  return neon_kernels();
}
#else
const Kernels& best_kernels() {
  return scalar_kernels();
}
#endif

}  // namespace wagonsight::stereo_kernels

#include "stereo/rectify_kernels.h"
#include "stereo/resample_pixel.h"

namespace wagonsight::stereo_kernels {
namespace {

struct Scalar {};

template <class Pixel>
void resample(const ResampleRun& run, const Pixel* source, Pixel* out) {
  resample_pixels<Scalar>(run.table, 0, run.count, run.width, source, out);
}

}  // namespace

const ResampleKernels& scalar_resample() {
  static constexpr ResampleKernels kernels{"scalar", resample<std::uint8_t>,
                                           resample<std::uint16_t>};
  return kernels;
}

#if defined(__x86_64__)
const ResampleKernels& avx2_resample();

const ResampleKernels& best_resample() {
  return __builtin_cpu_supports("avx2") ? avx2_resample() : scalar_resample();
}
#else
// Without a gather there is nothing to win over the compiler's own loop.
const ResampleKernels& best_resample() {
  return scalar_resample();
}
#endif

}  // namespace wagonsight::stereo_kernels

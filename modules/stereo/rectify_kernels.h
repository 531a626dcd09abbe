#pragma once

#include <cstddef>
#include <cstdint>

// The inner loop of rectify() in its builds; the scalar one is the specification.
namespace wagonsight::stereo_kernels {

struct ResampleRun {
  const std::uint32_t* table;
  std::size_t count;
  int width;         // of the source
  std::size_t size;  // of the source, pixels
};

struct ResampleKernels {
  const char* name;
  void (*gray8)(const ResampleRun&, const std::uint8_t* source, std::uint8_t* out);
  void (*gray16)(const ResampleRun&, const std::uint16_t* source, std::uint16_t* out);
};

const ResampleKernels& scalar_resample();
const ResampleKernels& best_resample();

}  // namespace wagonsight::stereo_kernels

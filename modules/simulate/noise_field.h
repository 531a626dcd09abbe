#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace wagonsight {

// Random numbers over an image that are alike in neighbouring pixels, as the correlation window of
// a Kinect makes its errors: normal values on a lattice of 8 pixels, linear in between, and the
// lattice lies elsewhere in every frame. Standard deviation over all pixels and frames is 1; the
// correlation falls to 0.5 at 5 pixels.
class NoiseField {
 public:
  static constexpr int kCell = 8;

  // For images of at most width x height. `coarse_share` of the variance is common to areas of
  // about 64 pixels. `every` is 1, or 4 to have values for every fourth
  // pixel of a row only.
  // Allocates.
  NoiseField(int width, int height, double coarse_share, int every = 1);

  // New values; the same for the same seed. Does not allocate.
  void draw(std::uint64_t seed);
  // The values of row v, `width` over `every` of them. Valid until the next call.
  std::span<const float> row(int v);

 private:
  int width_, per_cell_, columns_, rows_;
  float fine_weight_, coarse_weight_;
  int shift_u_ = 0, shift_v_ = 0;
  std::vector<float> nodes_, line_, values_;
};

}  // namespace wagonsight

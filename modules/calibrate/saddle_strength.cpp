#include "calibrate/saddle_strength.h"

#include <algorithm>
#include <cmath>

namespace wagonsight {

cv::Mat saddle_strength(const cv::Mat& pixels) {
  cv::Mat strength(pixels.size(), CV_32F, cv::Scalar(0));
  for (int v = 1; v + 1 < pixels.rows; ++v) {
    const float* up = pixels.ptr<float>(v - 1);
    const float* here = pixels.ptr<float>(v);
    const float* down = pixels.ptr<float>(v + 1);
    float* out = strength.ptr<float>(v);
    for (int u = 1; u + 1 < pixels.cols; ++u) {
      const float xx = here[u - 1] - 2 * here[u] + here[u + 1];
      const float yy = up[u] - 2 * here[u] + down[u];
      const float xy = (down[u + 1] - down[u - 1] - up[u + 1] + up[u - 1]) / 4;
      const float half = (xx - yy) / 2;
      out[u] = std::max(0.0F, std::sqrt(half * half + xy * xy) - std::abs(xx + yy) / 2);
    }
  }
  return strength;
}

}  // namespace wagonsight

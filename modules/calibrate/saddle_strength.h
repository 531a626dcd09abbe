#pragma once

#include <opencv2/core/mat.hpp>

namespace wagonsight {

// Of every pixel of a CV_32F image the smaller of the Hessian's two eigenvalues where their signs
// differ, else 0; 0 along the border. For an ideal corner of contrast C behind a blur s both are
// C / (pi s^2); an edge has only one, a spot none. Allocates the result.
cv::Mat saddle_strength(const cv::Mat& pixels);

}  // namespace wagonsight

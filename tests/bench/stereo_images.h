#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

// Pairs with truth for the comparison of matchers.
namespace wagonsight::bench {

struct TruthPair {
  std::string name;
  cv::Mat left, right;   // CV_8U
  cv::Mat truth;         // CV_32F disparities of the left image, 0 unknown
  cv::Mat seen_by_both;  // CV_8U, 1 where the right image sees the point too
  int disparities = 64;
};

// Middlebury's cone pair (im2, im6, disp2, disp6; quarter pixels), and the same with another gain
// and gamma on the right and noise on both. Empty when the folder has no such files.
std::vector<TruthPair> cone_pairs(const std::string& folder);
// The aloe pair of OpenCV's samples at a half and a quarter of its size. Empty when absent.
std::vector<TruthPair> aloe_pairs(const std::string& folder);
// One stereo camera's pairs of the simulated wagon with passengers, by day and in a tunnel, from
// config/. Empty when absent.
std::vector<TruthPair> simulated_pairs(const std::string& config_folder);
// A room of textured boards at several depths, drawn from a seed; for speed at any size.
TruthPair generated_pair(int width, int height, int disparities);

}  // namespace wagonsight::bench

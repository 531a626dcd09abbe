#include "stereo_images.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <random>

namespace wagonsight::bench {
namespace {

using cv::Mat;

// Seen by both where the two disparity images agree to a pixel.
Mat agreeing(const Mat& left, const Mat& right) {
  Mat mask(left.size(), CV_8U, cv::Scalar(0));
  for (int y = 0; y < left.rows; ++y)
    for (int x = 0; x < left.cols; ++x) {
      const float d = left.at<float>(y, x);
      const int xr = cvRound(static_cast<float>(x) - d);
      if (d > 0 && xr >= 0 && right.at<float>(y, xr) > 0 &&
          std::fabs(right.at<float>(y, xr) - d) <= 1)
        mask.at<uchar>(y, x) = 1;
    }
  return mask;
}

// The same from the left disparities alone: hidden is what a nearer surface covers in the right.
Mat not_covered(const Mat& truth) {
  Mat mask(truth.size(), CV_8U, cv::Scalar(0));
  std::vector<float> nearest(static_cast<std::size_t>(truth.cols) + 2);
  for (int y = 0; y < truth.rows; ++y) {
    std::fill(nearest.begin(), nearest.end(), 0.0F);
    const auto place = [&](int x) {
      return cvRound(static_cast<float>(x) - truth.at<float>(y, x));
    };
    for (int x = 0; x < truth.cols; ++x)
      if (truth.at<float>(y, x) > 0 && place(x) >= 0) {
        float& slot = nearest[static_cast<std::size_t>(place(x)) + 1];
        slot = std::max(slot, truth.at<float>(y, x));
      }
    for (int x = 0; x < truth.cols; ++x) {
      const float d = truth.at<float>(y, x);
      if (d <= 0 || place(x) < 0) continue;
      const auto at = static_cast<std::size_t>(place(x)) + 1;
      if (std::max({nearest[at - 1], nearest[at], nearest[at + 1]}) <= d + 1)
        mask.at<uchar>(y, x) = 1;
    }
  }
  return mask;
}

Mat as_float(const Mat& image, double scale) {
  Mat out;
  image.convertTo(out, CV_32F, scale);
  return out;
}

void add_noise(Mat& image, cv::RNG& random, double sigma) {
  Mat noise(image.size(), CV_32F);
  random.fill(noise, cv::RNG::NORMAL, 0, sigma);
  image += noise;
}

}  // namespace

std::vector<TruthPair> cone_pairs(const std::string& folder) {
  TruthPair pair;
  pair.name = "cone";
  pair.left = cv::imread(folder + "/im2.png", cv::IMREAD_GRAYSCALE);
  pair.right = cv::imread(folder + "/im6.png", cv::IMREAD_GRAYSCALE);
  const Mat left = cv::imread(folder + "/disp2.png", cv::IMREAD_GRAYSCALE);
  const Mat right = cv::imread(folder + "/disp6.png", cv::IMREAD_GRAYSCALE);
  if (pair.left.empty() || pair.right.empty() || left.empty() || right.empty()) return {};
  pair.truth = as_float(left, 0.25);
  pair.seen_by_both = agreeing(pair.truth, as_float(right, 0.25));

  TruthPair uneven = pair;  // gamma 1.3 and gain 0.8 on the right, sigma 2 of 255 on both
  uneven.name = "cone_uneven";
  cv::RNG random(7);
  Mat dim;
  cv::pow(as_float(pair.right, 1.0 / 255), 1.3, dim);
  dim = dim * 255 * 0.8 + 10;
  Mat noisy = as_float(pair.left, 1.0);
  add_noise(noisy, random, 2);
  add_noise(dim, random, 2);
  uneven.left = Mat();
  uneven.right = Mat();
  noisy.convertTo(uneven.left, CV_8U);
  dim.convertTo(uneven.right, CV_8U);
  return {pair, uneven};
}

std::vector<TruthPair> aloe_pairs(const std::string& folder) {
  const Mat left = cv::imread(folder + "/aloeL.jpg", cv::IMREAD_GRAYSCALE);
  const Mat right = cv::imread(folder + "/aloeR.jpg", cv::IMREAD_GRAYSCALE);
  const Mat truth = cv::imread(folder + "/aloeGT.png", cv::IMREAD_GRAYSCALE);
  if (left.empty() || right.empty() || truth.empty()) return {};
  std::vector<TruthPair> pairs;
  for (const int scale : {2, 4}) {
    TruthPair pair;
    pair.name = "aloe/" + std::to_string(scale);
    const cv::Size size(left.cols / scale, left.rows / scale);
    cv::resize(left, pair.left, size, 0, 0, cv::INTER_AREA);
    cv::resize(right, pair.right, size, 0, 0, cv::INTER_AREA);
    pair.truth.create(size, CV_32F);
    for (int y = 0; y < size.height; ++y)
      for (int x = 0; x < size.width; ++x)
        pair.truth.at<float>(y, x) =
            static_cast<float>(truth.at<uchar>(std::min(y * scale + scale / 2, truth.rows - 1),
                                               std::min(x * scale + scale / 2, truth.cols - 1))) /
            static_cast<float>(scale);
    pair.seen_by_both = not_covered(pair.truth);
    pair.disparities = 256 / scale;
    pairs.push_back(pair);
  }
  return pairs;
}

TruthPair generated_pair(int width, int height, int disparities) {
  TruthPair pair;
  pair.name = "generated";
  pair.disparities = disparities;
  std::mt19937 random(11);
  Mat coarse(height / 4 + 2, width / 4 + 2, CV_8U), fine(height, width, CV_8U), texture;
  for (Mat* m : {&coarse, &fine})
    for (int k = 0; k < static_cast<int>(m->total()); ++k)
      m->data[k] = static_cast<uchar>(40 + random() % 160);
  cv::resize(coarse, texture, fine.size(), 0, 0, cv::INTER_CUBIC);
  cv::addWeighted(texture, 0.8, fine, 0.2, 0, pair.right);
  pair.left = pair.right.clone();
  pair.truth = Mat(height, width, CV_32F, cv::Scalar(8));
  for (int board = 0; board < 5; ++board) {
    const int x = width / 6 + board * width / 6, y = height / 8 + board * height / 10;
    pair.truth(cv::Rect(x, y, width / 7, height / 3)) = cv::Scalar(disparities * (board + 2) / 8.0);
  }
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const int xr = x - static_cast<int>(pair.truth.at<float>(y, x));
      if (xr >= 0) pair.left.at<uchar>(y, x) = pair.right.at<uchar>(y, xr);
    }
  pair.seen_by_both = not_covered(pair.truth);
  return pair;
}

}  // namespace wagonsight::bench

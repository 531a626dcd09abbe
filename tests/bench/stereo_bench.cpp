#include <benchmark/benchmark.h>

#include <Eigen/Geometry>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>
#include <opencv2/imgproc.hpp>

#include "stereo/change_gate.h"
#include "stereo/matcher.h"
#include "stereo/rectify.h"
#include "stereo/stereo_to_depth.h"
#include "stereo_images.h"

// Stereo at the paper's size, 769 x 448 with 64 disparities, one thread.
namespace wagonsight::bench {
namespace {

constexpr int kWidth = 769, kHeight = 448, kDisparities = 64;

const TruthPair& pair() {
  static const TruthPair made = generated_pair(kWidth, kHeight, kDisparities);
  return made;
}
// The same as a 12-bit camera gives it.
cv::Mat twelve_bits(const cv::Mat& image) {
  cv::Mat out;
  image.convertTo(out, CV_16U, 16);
  return out;
}
GrayImage gray(const cv::Mat& image) {
  return {image.data, image.type() == CV_8U ? PixelFormat::kGray8 : PixelFormat::kGray16,
          image.cols, image.rows};
}

void match_whole(benchmark::State& state, MatcherMode mode) {
  auto matcher = StereoMatcher::create(kWidth, kHeight, {.mode = mode});
  const cv::Mat left = twelve_bits(pair().left), right = twelve_bits(pair().right);
  std::vector<std::int16_t> out(static_cast<std::size_t>(kWidth) * kHeight);
  for (auto _ : state) matcher->match(gray(left), gray(right), {out.data(), kWidth, kHeight});
  state.counters["workspace_bytes"] = static_cast<double>(matcher->workspace_bytes());
}
BENCHMARK_CAPTURE(match_whole, fast, MatcherMode::kFast)
    ->Name("stereo_full/wagonsight/generated")
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(match_whole, accurate, MatcherMode::kAccurate)
    ->Name("stereo_full/wagonsight_accurate/generated")
    ->Unit(benchmark::kMillisecond);

void opencv_sgbm(benchmark::State& state, int mode) {
  cv::setNumThreads(1);
  auto matcher = cv::StereoSGBM::create(0, kDisparities, 5, 200, 800, 1, 31, 10, 100, 2, mode);
  cv::Mat out;
  for (auto _ : state) matcher->compute(pair().left, pair().right, out);
}
BENCHMARK_CAPTURE(opencv_sgbm, 3way, cv::StereoSGBM::MODE_SGBM_3WAY)
    ->Name("stereo_full/opencv_sgbm_3way/generated")
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(opencv_sgbm, sgbm, cv::StereoSGBM::MODE_SGBM)
    ->Name("stereo_full/opencv_sgbm/generated")
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(opencv_sgbm, hh, cv::StereoSGBM::MODE_HH)
    ->Name("stereo_full/opencv_sgbm_hh/generated")
    ->Unit(benchmark::kMillisecond);

void opencv_bm(benchmark::State& state) {
  cv::setNumThreads(1);
  auto matcher = cv::StereoBM::create(kDisparities, 15);
  matcher->setUniquenessRatio(10);
  matcher->setSpeckleWindowSize(100);
  matcher->setSpeckleRange(2);
  matcher->setDisp12MaxDiff(1);
  cv::Mat out;
  for (auto _ : state) matcher->compute(pair().left, pair().right, out);
}
BENCHMARK(opencv_bm)->Name("stereo_full/opencv_bm/generated")->Unit(benchmark::kMillisecond);

// Fifteen percent of the image moves every frame: the gate finds it, the matcher matches it.
void match_gated(benchmark::State& state) {
  auto matcher = StereoMatcher::create(kWidth, kHeight, {});
  ChangeGate gate(kWidth, kHeight);
  const cv::Mat left = twelve_bits(pair().left), right = twelve_bits(pair().right);
  cv::Mat moved = left.clone();
  const cv::Rect person(260, 80, 190, 272);  // 15.0% of the image
  cv::Mat patch = moved(person);
  cv::flip(left(person), patch, 0);
  std::vector<std::int16_t> out(static_cast<std::size_t>(kWidth) * kHeight);
  const ImageView<std::int16_t> disparity{out.data(), kWidth, kHeight};
  gate.regions(gray(left), true, {});
  bool there = false;
  double share = 0, frames = 0;
  for (auto _ : state) {
    there = !there;
    const cv::Mat& now = there ? moved : left;
    const auto regions = gate.regions(gray(now), false, {});
    matcher->match_regions(gray(now), gray(right), regions, disparity);
    for (const PixelRect& r : regions)
      share += static_cast<double>((r.x1 - r.x0) * (r.y1 - r.y0)) / (kWidth * kHeight);
    ++frames;
  }
  state.counters["matched_share"] = share / frames;
}
BENCHMARK(match_gated)->Name("stereo_gated/wagonsight/generated")->Unit(benchmark::kMillisecond);

StereoRectification rectification() {
  Camera left{kWidth, kHeight, 520, 520, 384.5, 224, {-0.21, 0.08, 0.001, -0.0007, 0}};
  Camera right = left;
  right.fx = right.fy = 523;
  const Rigid X_LR{Eigen::Quaterniond(
                       Eigen::AngleAxisd(0.0269, Eigen::Vector3d(0.37, -0.74, 0.56).normalized())),
                   Eigen::Vector3d(0.08, 0.001, -0.002)};
  return *make_rectification(left, right, X_LR);
}

void rectify_pair(benchmark::State& state, bool wide) {
  const StereoRectification r = rectification();
  const cv::Mat left = wide ? twelve_bits(pair().left) : pair().left;
  const cv::Mat right = wide ? twelve_bits(pair().right) : pair().right;
  cv::Mat out(left.size(), left.type());
  for (auto _ : state) {
    rectify(gray(left), r.left, out.data);
    rectify(gray(right), r.right, out.data);
    benchmark::ClobberMemory();
  }
}
BENCHMARK_CAPTURE(rectify_pair, 12_bit, true)
    ->Name("rectify/wagonsight/12_bit")
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(rectify_pair, 8_bit, false)
    ->Name("rectify/wagonsight/8_bit")
    ->Unit(benchmark::kMillisecond);

// The same maps for OpenCV, in its fixed-point form, the fastest it has.
void opencv_remap(benchmark::State& state, bool wide) {
  cv::setNumThreads(1);
  const StereoRectification r = rectification();
  const cv::Mat K = (cv::Mat_<double>(3, 3) << 520, 0, 384.5, 0, 520, 224, 0, 0, 1);
  const cv::Mat D = (cv::Mat_<double>(1, 5) << -0.21, 0.08, 0.001, -0.0007, 0);
  const cv::Mat P =
      (cv::Mat_<double>(3, 3) << r.camera.fx, 0, r.camera.cx, 0, r.camera.fy, r.camera.cy, 0, 0, 1);
  cv::Mat R, map_1, map_2, out;
  cv::eigen2cv(Eigen::Matrix3d(r.X_LS.rotation.toRotationMatrix().transpose()), R);
  cv::initUndistortRectifyMap(K, D, R, P, {kWidth, kHeight}, CV_16SC2, map_1, map_2);
  const cv::Mat left = wide ? twelve_bits(pair().left) : pair().left;
  const cv::Mat right = wide ? twelve_bits(pair().right) : pair().right;
  for (auto _ : state) {
    cv::remap(left, out, map_1, map_2, cv::INTER_LINEAR);
    cv::remap(right, out, map_1, map_2, cv::INTER_LINEAR);
  }
}
BENCHMARK_CAPTURE(opencv_remap, 12_bit, true)
    ->Name("rectify/opencv_remap/12_bit")
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(opencv_remap, 8_bit, false)
    ->Name("rectify/opencv_remap/8_bit")
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace wagonsight::bench

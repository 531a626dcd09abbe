#include <cmath>
#include <fstream>
#include <sstream>

#include "exposure_step.h"
#include "simulate/simulation.h"
#include "stereo/rectify.h"
#include "stereo_images.h"

// Pairs of the simulated wagon, with the truth of its geometry.
namespace wagonsight::bench {
namespace {

// What the right image sees too: of all points that fall on one of its pixels, the nearest.
cv::Mat seen_by_both_of(const cv::Mat& truth) {
  cv::Mat seen(truth.size(), CV_8U, cv::Scalar(0));
  std::vector<float> nearest(static_cast<std::size_t>(truth.cols));
  for (int y = 0; y < truth.rows; ++y) {
    std::fill(nearest.begin(), nearest.end(), 0.0F);
    const auto column = [&](int x) {
      return static_cast<int>(std::lround(static_cast<float>(x) - truth.at<float>(y, x)));
    };
    for (int x = 0; x < truth.cols; ++x)
      if (const int u = column(x); truth.at<float>(y, x) > 0 && u >= 0)
        nearest[static_cast<std::size_t>(u)] =
            std::max(nearest[static_cast<std::size_t>(u)], truth.at<float>(y, x));
    for (int x = 0; x < truth.cols; ++x)
      if (const int u = column(x); truth.at<float>(y, x) > 0 && u >= 0)
        seen.at<uchar>(y, x) =
            truth.at<float>(y, x) > nearest[static_cast<std::size_t>(u)] - 1.0F ? 1 : 0;
  }
  return seen;
}

cv::Mat eight_bits(std::vector<std::uint16_t>& pixels, int width, int height) {
  cv::Mat out;
  cv::Mat(height, width, CV_16U, pixels.data()).convertTo(out, CV_8U, 1.0 / 16);
  return out;
}

TruthPair pair_at(SimulatedDevice& device, const std::string& name, double seconds) {
  StereoModel& model = *device.stereo();
  std::vector<std::byte> bytes(device.slot_bytes());
  FrameSlot slot;
  slot.bytes = bytes;
  HostTime instant{};
  while (to_seconds(device.upcoming().instant.time_since_epoch()) < seconds) {
    // The exposure law has its way for the last second.
    if (to_seconds(device.upcoming().instant.time_since_epoch()) < seconds - 1) {
      device.skip();
      continue;
    }
    instant = device.upcoming().instant;
    draw_and_expose(device, slot);
  }
  const int width = model.width(), height = model.height();
  const auto& lenses = model.imagers();
  const auto tables = make_rectification(lenses.left, lenses.right, lenses.X_LR);
  const std::size_t pixels = slot.image_bytes() / 2;
  std::vector<std::uint16_t> left(pixels), right(pixels);
  rectify({slot.bytes.data(), slot.format, width, height}, tables->left, left.data());
  rectify({slot.bytes.data() + slot.image_bytes(), slot.format, width, height}, tables->right,
          right.data());
  std::vector<float> w(pixels);
  model.truth(device.world(), instant, w);
  TruthPair pair;
  pair.name = name;
  pair.left = eight_bits(left, width, height);
  pair.right = eight_bits(right, width, height);
  pair.truth = cv::Mat(height, width, CV_32F, w.data()).clone() *
               (model.rectified().camera.fx * model.rectified().baseline);
  pair.seen_by_both = seen_by_both_of(pair.truth);
  return pair;
}

}  // namespace

std::vector<TruthPair> simulated_pairs(const std::string& config_folder) {
  std::stringstream text;
  for (const char* part : {"/scenes/walk.toml", "/rigs/six_stereo.toml"})
    text << std::ifstream(config_folder + part).rdbuf() << "\n";
  text << "[[light]]\nat = 30\nstate = \"tunnel\"\n";
  auto scene = parse_scene(text.str(), "walk");
  if (!scene) return {};
  std::vector<TruthPair> pairs;
  for (std::size_t i = 0; i < scene->sensors.size(); ++i) {
    if (scene->sensors[i].name != "s1") continue;
    SimulatedDevice device(*scene, i, 1);
    pairs.push_back(pair_at(device, "simulated wagon by day", 26));
    pairs.push_back(pair_at(device, "simulated wagon in a tunnel", 33));
  }
  return pairs;
}

}  // namespace wagonsight::bench

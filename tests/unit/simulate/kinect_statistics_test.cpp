// The simulated Kinect against a real one: the figures of a still class room's recording, and the
// same figures of a simulated room of that kind.
#include <gmock/gmock.h>
#include <png.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>

#include "simulate/simulation.h"

namespace wagonsight {
namespace {

constexpr int kWidth = 640, kHeight = 480;
constexpr std::size_t kPixels = std::size_t{kWidth} * kHeight;
using Depth = std::vector<std::uint16_t>;

struct Figures {
  double always = 0, never = 0, flicker = 0;  // shares of all pixels
  std::array<double, 4> step{}, sigma{};      // millimetres, by range
};
constexpr std::array<std::array<double, 2>, 4> kRanges{
    {{2000, 2500}, {3000, 3500}, {3500, 4500}, {4500, 6000}}};

double median(std::vector<double>& values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// How far apart the values are that a reading can take, by range: the median over the values.
std::array<double, 4> steps_of(const std::vector<Depth>& frames) {
  std::map<std::uint16_t, int> values;
  for (const Depth& frame : frames)
    for (const std::uint16_t z : frame)
      if (z > 0) ++values[z];
  std::array<std::vector<double>, 4> gaps;
  for (auto it = values.begin(); it != values.end() && std::next(it) != values.end(); ++it)
    for (std::size_t r = 0; r < kRanges.size(); ++r)
      if (it->first >= kRanges[r][0] && it->first < kRanges[r][1])
        gaps[r].push_back(std::next(it)->first - it->first);
  std::array<double, 4> steps{};
  for (std::size_t r = 0; r < steps.size(); ++r) steps[r] = median(gaps[r]);
  return steps;
}

Figures figures_of(const std::vector<Depth>& frames) {
  Figures figures;
  std::array<std::vector<double>, 4> sigmas;
  const double n = static_cast<double>(frames.size());
  for (std::size_t i = 0; i < kPixels; ++i) {
    double count = 0, sum = 0, squares = 0;
    for (const Depth& frame : frames) {
      const double z = frame[i];
      count += z > 0 ? 1 : 0;
      sum += z;
      squares += z * z;
    }
    const double share = 1.0 / static_cast<double>(kPixels);
    if (count == 0) figures.never += share;
    if (count > 0 && count < n) figures.flicker += share;
    if (count < n) continue;
    figures.always += share;
    const double mean = sum / n;
    const double sigma = std::sqrt(std::max(0.0, (squares - n * mean * mean) / (n - 1)));
    for (std::size_t r = 0; r < kRanges.size(); ++r)
      if (mean >= kRanges[r][0] && mean < kRanges[r][1]) sigmas[r].push_back(sigma);
  }
  figures.step = steps_of(frames);
  for (std::size_t r = 0; r < sigmas.size(); ++r) figures.sigma[r] = median(sigmas[r]);
  return figures;
}

std::string told(const Figures& f) {
  std::ostringstream out;
  out << "always " << f.always << " never " << f.never << " flicker " << f.flicker;
  for (std::size_t r = 0; r < f.step.size(); ++r)
    out << " | " << kRanges[r][0] << " mm: step " << f.step[r] << " sigma " << f.sigma[r];
  return out.str();
}

bool read_png(const std::filesystem::path& path, Depth& depth) {
  std::FILE* file = std::fopen(path.c_str(), "rb");
  if (file == nullptr) return false;
  png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  png_infop info = png_create_info_struct(png);
  png_init_io(png, file);
  png_read_info(png, info);
  const bool fits = png_get_image_width(png, info) == kWidth &&
                    png_get_image_height(png, info) == kHeight &&
                    png_get_bit_depth(png, info) == 16;
  if (fits) {
    png_set_swap(png);
    depth.resize(kPixels);
    for (int v = 0; v < kHeight; ++v)
      png_read_row(png, reinterpret_cast<png_bytep>(depth.data() + std::ptrdiff_t{v} * kWidth),
                   nullptr);
  }
  png_destroy_read_struct(&png, &info, nullptr);
  std::fclose(file);
  return fits;
}

std::vector<Depth> simulated_frames(std::size_t count, double noise) {
  std::ifstream file(WAGONSIGHT_SOURCE_DIR "/tests/unit/simulate/class_room.toml");
  std::stringstream text;
  text << file.rdbuf();
  auto scene = parse_scene(text.str(), "class_room.toml");
  EXPECT_TRUE(scene.has_value()) << (scene ? "" : scene.error().message);
  scene->sensors[0].noise = noise;
  SimulatedDevice device(*scene, 0, 1);
  std::vector<std::byte> memory(kPixels * 2);
  FrameSlot slot;
  slot.bytes = memory;
  std::vector<Depth> frames;
  for (std::size_t i = 0; i < count; ++i) {
    device.next(slot);
    const auto pixels = slot.depth_pixels();
    frames.emplace_back(pixels.begin(), pixels.end());
  }
  return frames;
}

constexpr std::size_t kFrames = 19;

void expect_alike(const Figures& simulated, const Figures& real) {
  const auto within = [](double value, double reference) {
    return std::abs(value / reference - 1) <= 0.25;
  };
  EXPECT_PRED2(within, simulated.always, real.always);
  EXPECT_PRED2(within, simulated.never, real.never);
  EXPECT_PRED2(within, simulated.flicker, real.flicker);
  for (std::size_t r = 0; r < kRanges.size(); ++r) {
    EXPECT_PRED2(within, simulated.step[r], real.step[r]) << "from " << kRanges[r][0] << " mm";
    EXPECT_PRED2(within, simulated.sigma[r], real.sigma[r]) << "from " << kRanges[r][0] << " mm";
  }
}

// The recording's own figures, so that the model is held even where the recording is not at hand.
TEST(KinectStatisticsTest, AgreeWithTheFiguresOfARealKinect) {
  const Figures real{0.67, 0.13, 0.20, {14, 30, 45, 77}, {10, 17, 26, 51}};
  const Figures simulated = figures_of(simulated_frames(kFrames, 1.0));
  expect_alike(simulated, real);
  RecordProperty("figures", told(simulated));
  std::printf("simulated: %s\n", told(simulated).c_str());
}

TEST(KinectStatisticsTest, AgreeWithARealRecording) {
  const std::filesystem::path folder = WAGONSIGHT_SOURCE_DIR "/../shared/data/depth_queue/depth";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "the recording depth_queue is not here";
  std::vector<Depth> frames;
  for (int i = 8; i <= 26; ++i) {
    std::ostringstream name;
    name << "00" << (i < 10 ? "0" : "") << i << ".png";
    frames.emplace_back();
    ASSERT_TRUE(read_png(folder / name.str(), frames.back())) << name.str();
  }
  const Figures real = figures_of(frames);
  std::printf("recorded:  %s\n", told(real).c_str());
  expect_alike(figures_of(simulated_frames(kFrames, 1.0)), real);
}

TEST(KinectStatisticsTest, NoiseGrowsWithItsSettingAndIsNothingAtZero) {
  const Figures none = figures_of(simulated_frames(kFrames, 0.0));
  const Figures normal = figures_of(simulated_frames(kFrames, 1.0));
  const Figures strong = figures_of(simulated_frames(kFrames, 2.0));
  EXPECT_EQ(none.flicker, 0);
  for (std::size_t r = 0; r < kRanges.size(); ++r) {
    EXPECT_EQ(none.sigma[r], 0);
    EXPECT_GT(strong.sigma[r], 1.4 * normal.sigma[r]);
  }
}

}  // namespace
}  // namespace wagonsight

#pragma once

#include <cstdint>
#include <deque>
#include <string>
#include <vector>

#include "base/result.h"
#include "calibrate/corner_snap.h"

// The images of a calibration: one folder per sensor, the same file stem in several folders is the
// same instant.
namespace wagonsight {

struct ListedImage {
  std::string sensor;  // the folder
  std::string name;    // "k0/0001.png", as in OBS.json
  std::string stem;    // "0001"
  std::string path;
};

// Sorted by sensor, then by file. The Error says what the folder should hold.
Result<std::vector<ListedImage>> list_images(const std::string& folder);

// An image as eight bits of grey. Deeper images (a Kinect's infrared) are stretched to what 99.5%
// of their pixels fill.
struct LoadedImage {
  std::vector<std::uint8_t> pixels;
  int width = 0, height = 0;
  GrayImage view() const { return {pixels.data(), width, height}; }
};
Result<LoadedImage> load_image(const std::string& path);

// As PNG (lossless, for clicking), or as JPEG at most `width_max` pixels wide (for a report).
std::string to_png(const LoadedImage& image);
std::string to_small_jpeg(const LoadedImage& image, int width_max, int quality);

// Keeps the images that were looked at last.
class ImageCache {
 public:
  Result<const LoadedImage*> get(const ListedImage& image);

 private:
  static constexpr std::size_t kKept = 8;
  std::deque<std::pair<std::string, LoadedImage>> kept_;
};

}  // namespace wagonsight

#include "image_folder.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <set>

namespace wagonsight {
namespace {

namespace fs = std::filesystem;

std::vector<fs::path> sorted_entries(const fs::path& folder, bool folders) {
  std::vector<fs::path> entries;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error))
    if (entry.is_directory() == folders) entries.push_back(entry.path());
  std::sort(entries.begin(), entries.end());
  return entries;
}

bool is_image(const fs::path& path) {
  static const std::set<std::string> kEndings = {".png", ".jpg", ".jpeg", ".pgm",
                                                 ".bmp", ".tif", ".tiff"};
  std::string ending = path.extension().string();
  std::transform(ending.begin(), ending.end(), ending.begin(),
                 [](unsigned char c) { return std::tolower(c); });
  return kEndings.contains(ending);
}

// The value that 99.5% of a deep image's pixels do not exceed.
double bright_end(const cv::Mat& deep) {
  std::vector<float> values;
  cv::Mat flat;
  deep.convertTo(flat, CV_32F);
  values.assign(flat.begin<float>(), flat.end<float>());
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(values.size() * 199 / 200);
  std::nth_element(values.begin(), at, values.end());
  return std::max(1.0, static_cast<double>(*at));
}

cv::Mat as_matrix(const LoadedImage& image) {
  return {image.height, image.width, CV_8U, const_cast<std::uint8_t*>(image.pixels.data())};
}

std::string encode(const cv::Mat& image, const char* ending, const std::vector<int>& how) {
  std::vector<unsigned char> bytes;
  cv::imencode(ending, image, bytes, how);
  return {bytes.begin(), bytes.end()};
}

}  // namespace

Result<std::vector<ListedImage>> list_images(const std::string& folder) {
  std::vector<ListedImage> images;
  for (const fs::path& sensor : sorted_entries(folder, true)) {
    if (sensor.extension() == ".depth") continue;  // depth images, beside those of the board
    for (const fs::path& file : sorted_entries(sensor, false))
      if (is_image(file)) {
        const std::string name = sensor.filename().string();
        images.push_back(
            {name, name + "/" + file.filename().string(), file.stem().string(), file.string()});
      }
  }
  if (images.empty())
    return fail(
        fmt::format("{}: no images; put those of each sensor into a folder of the sensor's "
                    "name, for example {}/k0/0001.png",
                    folder, folder));
  return images;
}

Result<LoadedImage> load_image(const std::string& path) {
  cv::Mat read = cv::imread(path, cv::IMREAD_GRAYSCALE | cv::IMREAD_ANYDEPTH);
  if (read.empty()) return fail(fmt::format("{}: this is not an image that can be read", path));
  if (read.depth() != CV_8U) read.convertTo(read, CV_8U, 255.0 / bright_end(read));
  LoadedImage image;
  image.width = read.cols;
  image.height = read.rows;
  image.pixels.assign(read.begin<std::uint8_t>(), read.end<std::uint8_t>());
  return image;
}

std::string to_png(const LoadedImage& image) {
  return encode(as_matrix(image), ".png", {cv::IMWRITE_PNG_COMPRESSION, 1});
}

std::string to_small_jpeg(const LoadedImage& image, int width_max, int quality) {
  cv::Mat small = as_matrix(image);
  if (image.width > width_max) {
    const int height = std::max(1, image.height * width_max / image.width);
    cv::Mat shrunk;
    cv::resize(small, shrunk, {width_max, height}, 0, 0, cv::INTER_AREA);
    small = shrunk;
  }
  return encode(small, ".jpg", {cv::IMWRITE_JPEG_QUALITY, quality});
}

Result<const LoadedImage*> ImageCache::get(const ListedImage& image) {
  for (auto& [path, loaded] : kept_)
    if (path == image.path) return &loaded;
  auto loaded = load_image(image.path);
  if (!loaded) return fail(loaded.error().message);
  if (kept_.size() == kKept) kept_.pop_front();
  kept_.emplace_back(image.path, std::move(*loaded));
  return &kept_.back().second;
}

}  // namespace wagonsight

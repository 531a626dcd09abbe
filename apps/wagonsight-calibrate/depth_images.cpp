#include "depth_images.h"

#include <fmt/format.h>

#include <filesystem>
#include <opencv2/imgcodecs.hpp>

namespace wagonsight {
namespace {

namespace fs = std::filesystem;

// Beside the images of an imager; empty when there is none.
fs::path depth_file(const fs::path& folder, const std::string& imager, const std::string& stem) {
  for (const char* ending : {".png", ".pgm"}) {
    fs::path file = folder / (imager + ".depth") / (stem + ending);
    std::error_code error;
    if (fs::is_regular_file(file, error)) return file;
  }
  return {};
}

Result<DepthView> read_depth(const fs::path& file, const std::string& imager,
                             const std::string& pose) {
  const cv::Mat image = cv::imread(file.string(), cv::IMREAD_UNCHANGED);
  if (image.empty() || image.type() != CV_16UC1)
    return fail(fmt::format("{}: a depth image is a PNG or PGM of 16 bits, millimetres; this is {}",
                            file.string(), image.empty() ? "none that can be read" : "another"));
  DepthView depth{imager, pose, file.filename().string(), image.cols, image.rows, {}};
  depth.raw_mm.reserve(image.total());
  for (int v = 0; v < image.rows; ++v) {
    const auto* row = image.ptr<std::uint16_t>(v);
    depth.raw_mm.insert(depth.raw_mm.end(), row, row + image.cols);
  }
  return depth;
}

std::string stem_of(const ViewSolution& view) {
  return view.image.empty() ? view.pose : fs::path(view.image).stem().string();
}

}  // namespace

Result<std::vector<DepthView>> read_depth_images(const std::string& folder,
                                                 const std::vector<SensorSpec>& sensors,
                                                 const Solution& solution) {
  constexpr std::size_t kImagesMax = 100;
  std::vector<DepthView> images;
  for (const SensorSpec& sensor : sensors) {
    if (!sensor.depth) continue;
    std::vector<std::pair<fs::path, const ViewSolution*>> files;
    for (const ViewSolution& view : solution.views)
      if (view.imager == sensor.name)
        if (auto file = depth_file(folder, view.imager, stem_of(view)); !file.empty())
          files.emplace_back(std::move(file), &view);
    const std::size_t taken = std::min(files.size(), kImagesMax);
    for (std::size_t i = 0; i < taken; ++i) {
      const auto& [file, view] = files[i * files.size() / taken];
      auto image = read_depth(file, view->imager, view->pose);
      if (!image) return fail(image.error().message);
      images.push_back(std::move(*image));
    }
  }
  return images;
}

Result<std::optional<DepthView>> read_depth_beside(const std::string& folder,
                                                   const std::string& imager,
                                                   const std::string& image) {
  const fs::path file = depth_file(folder, imager, fs::path(image).stem().string());
  if (file.empty()) return std::optional<DepthView>();
  auto depth = read_depth(file, imager, {});
  if (!depth) return fail(depth.error().message);
  return std::optional<DepthView>(std::move(*depth));
}

}  // namespace wagonsight

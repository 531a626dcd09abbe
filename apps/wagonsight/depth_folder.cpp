#include "depth_folder.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <filesystem>

#include "files.h"

namespace wagonsight {
namespace {

bool is_digit(char c) {
  return c >= '0' && c <= '9';
}

// Takes a run of digits off the front, without its leading zeros.
std::string_view take_digits(std::string_view& text) {
  const std::size_t count =
      static_cast<std::size_t>(std::find_if_not(text.begin(), text.end(), is_digit) - text.begin());
  std::string_view digits = text.substr(0, count);
  text.remove_prefix(count);
  digits.remove_prefix(std::min(digits.find_first_not_of('0'), digits.size()));
  return digits;
}

bool comes_before(std::string_view a, std::string_view b) {
  const std::string_view whole_a = a;
  const std::string_view whole_b = b;
  while (!a.empty() && !b.empty()) {
    if (is_digit(a.front()) && is_digit(b.front())) {
      const std::string_view digits_a = take_digits(a);
      const std::string_view digits_b = take_digits(b);
      if (digits_a.size() != digits_b.size()) return digits_a.size() < digits_b.size();
      if (digits_a != digits_b) return digits_a < digits_b;
      continue;
    }
    if (a.front() != b.front()) return a.front() < b.front();
    a.remove_prefix(1);
    b.remove_prefix(1);
  }
  return a.size() != b.size() ? a.size() < b.size() : whole_a < whole_b;
}

std::string extension_of(const std::string& path) {
  std::string extension = std::filesystem::path(path).extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return extension;
}

bool is_depth_file(const std::string& path) {
  const std::string extension = extension_of(path);
  return extension == ".png" || extension == ".pgm" || extension == ".pcd";
}

// 0, no reading, for what is not finite or does not fit 16 bits.
std::uint16_t to_millimetres(double metres) {
  const double mm = metres * 1000 + 0.5;
  return mm >= 1 && mm < 65'536 ? static_cast<std::uint16_t>(mm) : std::uint16_t{0};
}

// How far the cloud's points lie off the rays of the camera, in pixels: the median over a sample.
double median_ray_error(const OrganisedCloud& cloud, const Camera& camera) {
  constexpr int kEvery = 16;
  std::vector<double> errors;
  for (int v = 0; v < cloud.height; v += kEvery) {
    for (int u = 0; u < cloud.width; u += kEvery) {
      const auto& p =
          cloud.points[static_cast<std::size_t>(v) * static_cast<std::size_t>(cloud.width) +
                       static_cast<std::size_t>(u)];
      if (!(p[2] > 0)) continue;
      const auto pixel = project(camera, {p[0], p[1], p[2]});
      if (pixel) errors.push_back(std::hypot(pixel->x() - u, pixel->y() - v));
    }
  }
  if (errors.empty()) return 0;
  const auto middle = errors.begin() + static_cast<std::ptrdiff_t>(errors.size() / 2);
  std::nth_element(errors.begin(), middle, errors.end());
  return *middle;
}

}  // namespace

Result<DepthFolder> DepthFolder::open(const std::string& folder, const CameraFile& camera) {
  std::error_code trouble;
  std::filesystem::directory_iterator entries(folder, trouble);
  if (trouble)
    return fail(fmt::format("{} is not a folder that can be read: {}", folder, trouble.message()));
  std::vector<std::string> paths;
  for (const auto& entry : entries)
    if (entry.is_regular_file(trouble) && is_depth_file(entry.path().string()))
      paths.push_back(entry.path().string());
  if (paths.empty())
    return fail(
        fmt::format("{} holds no .png, .pgm or .pcd file; give the folder that holds the "
                    "depth images themselves",
                    folder));
  std::sort(paths.begin(), paths.end(),
            [](const std::string& a, const std::string& b) { return comes_before(a, b); });
  for (const std::string& path : paths)
    if (extension_of(path) != extension_of(paths.front()))
      return fail(
          fmt::format("{} and {} are of different kinds; a folder must hold frames of one "
                      "kind",
                      paths.front(), path));
  return DepthFolder(std::move(paths), camera);
}

Result<void> DepthFolder::check_size(const std::string& path, int width, int height) const {
  const Camera& camera = camera_.sensor.camera;
  if (width == camera.width && height == camera.height) return {};
  return fail(fmt::format("{} is {} x {} pixels, but the camera file says {} x {}", path, width,
                          height, camera.width, camera.height));
}

Result<void> DepthFolder::read_image(const std::string& path, bool is_png,
                                     std::span<const std::byte> file,
                                     std::span<std::uint16_t> out) {
  if (auto done = is_png ? read_png16(file, path, image_) : read_pgm16(file, path, image_); !done)
    return done;
  if (auto done = check_size(path, image_.width, image_.height); !done) return done;
  const double unit_m = camera_.depth_unit_m;
  if (unit_m == 0.001)
    std::copy(image_.pixels.begin(), image_.pixels.end(), out.begin());
  else
    std::transform(image_.pixels.begin(), image_.pixels.end(), out.begin(),
                   [&](std::uint16_t raw) { return to_millimetres(raw * unit_m); });
  return {};
}

Result<void> DepthFolder::read_cloud(const std::string& path, std::span<const std::byte> file,
                                     std::span<std::uint16_t> out) {
  if (auto done = read_pcd(file, path, cloud_); !done) return done;
  if (auto done = check_size(path, cloud_.width, cloud_.height); !done) return done;
  // Only z is kept, so the camera must be the one that made the points.
  constexpr double kRayErrorMax_px = 5;
  const double error = median_ray_error(cloud_, camera_.sensor.camera);
  if (error > kRayErrorMax_px)
    return fail(
        fmt::format("{} does not belong to this camera: its points lie {:.1f} pixels off "
                    "the camera's rays; correct fx, fy, cx, cy (x right, y down, z "
                    "forward, metres)",
                    path, error));
  std::transform(cloud_.points.begin(), cloud_.points.end(), out.begin(),
                 [](const auto& point) { return to_millimetres(static_cast<double>(point[2])); });
  return {};
}

Result<void> DepthFolder::read(std::size_t index, std::span<std::uint16_t> out) {
  const std::string& path = paths_[index];
  const auto file = open_input(path);
  if (!file) return tl::unexpected(file.error());
  const std::string extension = extension_of(path);
  if (extension == ".pcd") return read_cloud(path, file->bytes(), out);
  return read_image(path, extension == ".png", file->bytes(), out);
}

}  // namespace wagonsight

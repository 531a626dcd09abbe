#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "base/result.h"
#include "camera_file.h"
#include "depth_images.h"
#include "pcd_reader.h"

namespace wagonsight {

// A folder of depth images (16-bit PNG, PGM) or organised clouds (PCD), one file a frame, in the
// order of their names; runs of digits count as numbers, so that 10 follows 9.
class DepthFolder {
 public:
  static Result<DepthFolder> open(const std::string& folder, const CameraFile& camera);

  std::size_t frame_count() const { return paths_.size(); }
  // Millimetres, row by row, 0 for no reading; `out` has width x height pixels of the camera. The
  // Error names the file.
  Result<void> read(std::size_t index, std::span<std::uint16_t> out);

 private:
  DepthFolder(std::vector<std::string> paths, const CameraFile& camera)
      : paths_(std::move(paths)), camera_(camera) {}
  Result<void> read_image(const std::string& path, bool is_png, std::span<const std::byte> file,
                          std::span<std::uint16_t> out);
  Result<void> read_cloud(const std::string& path, std::span<const std::byte> file,
                          std::span<std::uint16_t> out);
  Result<void> check_size(const std::string& path, int width, int height) const;

  std::vector<std::string> paths_;
  CameraFile camera_;
  RawImage image_;        // reused
  OrganisedCloud cloud_;  // reused
};

}  // namespace wagonsight

#include "cloud_files.h"

#include <fmt/format.h>

#include "files.h"

namespace wagonsight {
namespace {

Result<void> write_with_header(const std::string& path, std::string_view header,
                               std::span<const CloudPoint> points) {
  auto file = OutputFile::create(path);
  if (!file) return tl::unexpected(file.error());
  if (auto done = (*file)->write(header); !done) return done;
  if (auto done = (*file)->write(std::as_bytes(points)); !done) return done;
  return (*file)->close();
}

}  // namespace

Result<void> write_ply(const std::string& path, std::span<const CloudPoint> points) {
  const std::string header = fmt::format(
      "ply\nformat binary_little_endian 1.0\ncomment made by wagonsight, metres\n"
      "element vertex {}\nproperty float x\nproperty float y\nproperty float z\nend_header\n",
      points.size());
  return write_with_header(path, header, points);
}

Result<void> write_pcd(const std::string& path, std::span<const CloudPoint> points,
                       std::size_t width, std::size_t height) {
  const std::string header = fmt::format(
      "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\n"
      "TYPE F F F\nCOUNT 1 1 1\nWIDTH {}\nHEIGHT {}\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {}\n"
      "DATA binary\n",
      width, height, points.size());
  return write_with_header(path, header, points);
}

}  // namespace wagonsight

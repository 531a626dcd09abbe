#include "files.h"

#include <fmt/format.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>

namespace wagonsight {

Result<std::string> read_text(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) return fail(fmt::format("{}: cannot be read: {}", path, std::strerror(errno)));
  std::ostringstream text;
  text << file.rdbuf();
  if (file.bad()) return fail(fmt::format("{}: reading it failed: {}", path, std::strerror(errno)));
  return text.str();
}

Result<void> write_bytes(const std::string& path, std::span<const std::byte> bytes) {
  const std::string part = path + ".part";
  {
    std::ofstream file(part, std::ios::binary | std::ios::trunc);
    file.write(reinterpret_cast<const char*>(bytes.data()),
               static_cast<std::streamsize>(bytes.size()));
    file.flush();
    if (!file) return fail(fmt::format("{}: cannot be written: {}", part, std::strerror(errno)));
  }
  std::error_code error;
  std::filesystem::rename(part, path, error);
  if (error) return fail(fmt::format("{}: cannot be written: {}", path, error.message()));
  return {};
}

Result<void> write_text(const std::string& path, std::string_view text) {
  return write_bytes(path, std::as_bytes(std::span(text.data(), text.size())));
}

}  // namespace wagonsight

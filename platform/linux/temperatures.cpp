#include "linux/temperatures.h"

#include <dirent.h>
#include <fcntl.h>
#include <unistd.h>

#include <array>
#include <charconv>

namespace wagonsight {
namespace {

constexpr double kLeast_c = -40, kMost_c = 150;

// The first line of a file of the kernel, which has no size; empty when it cannot be read.
std::string first_line(const std::string& path) {
  const int fd = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) return {};
  std::array<char, 128> bytes{};
  const ssize_t size = read(fd, bytes.data(), bytes.size());
  close(fd);
  const std::string text(bytes.data(), static_cast<std::size_t>(size > 0 ? size : 0));
  return text.substr(0, text.find('\n'));
}

}  // namespace

void read_temperatures(const std::string& folder,
                       const std::function<void(std::string_view, double)>& tell) {
  DIR* zones = opendir(folder.c_str());
  if (zones == nullptr) return;
  while (const dirent* entry = readdir(zones)) {  // of this thread alone
    const std::string zone(static_cast<const char*>(entry->d_name));
    if (!zone.starts_with("thermal_zone")) continue;
    std::string path = folder;
    path.append("/").append(zone);
    const std::string text = first_line(path + "/temp");
    long thousandths = 0;
    const auto number = std::from_chars(text.data(), text.data() + text.size(), thousandths);
    const double celsius = 1e-3 * static_cast<double>(thousandths);
    if (number.ec != std::errc{} || celsius < kLeast_c || celsius > kMost_c) continue;
    const std::string type = first_line(path + "/type");
    tell(type.empty() ? zone : type, celsius);
  }
  closedir(zones);
}

}  // namespace wagonsight

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <map>

#include "calibrate/report.h"
#include "commands.h"
#include "image_folder.h"
#include "linux/files.h"

namespace wagonsight {

// The report with the views' images at a third of their size, the worst views first until the page
// would grow past what a browser opens at once.
Result<void> write_report(const Solution& solution, const std::string& folder,
                          const std::string& title, const std::string& path) {
  constexpr std::size_t kBytesMax = 12'000'000;
  constexpr int kWidth = 480, kQuality = 70;
  std::map<std::string, std::string> jpegs;
  if (!folder.empty()) {
    std::vector<const ViewSolution*> views;
    for (const ViewSolution& view : solution.views) views.push_back(&view);
    std::stable_sort(views.begin(), views.end(),
                     [](const auto* a, const auto* b) { return a->rms_px > b->rms_px; });
    std::size_t bytes = 0, missing = 0;
    for (const ViewSolution* view : views) {
      if (view->image.empty() || bytes > kBytesMax) continue;
      const auto image = load_image((std::filesystem::path(folder) / view->image).string());
      if (!image) {
        ++missing;
        continue;
      }
      std::string jpeg = to_small_jpeg(*image, kWidth, kQuality);
      bytes += jpeg.size();
      jpegs[view->image] = std::move(jpeg);
    }
    if (missing > 0) fmt::print("{} images of the report are not in {}\n", missing, folder);
  }
  return write_file_durably(path, bytes_of(format_report(solution, jpegs, title)));
}

Result<void> run_report(const ReportArguments& arguments) {
  const auto solution = read_solution(arguments.solution);
  if (!solution) return fail(solution.error().message);
  return write_report(*solution, arguments.images, arguments.solution, arguments.out);
}

}  // namespace wagonsight

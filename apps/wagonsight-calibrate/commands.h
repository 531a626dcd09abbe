#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "base/result.h"
#include "calibrate/solution.h"

// The commands of wagonsight-calibrate, one function each: it reads its files, calls the calibrate
// module, writes its files and prints what a person wants to know.
namespace wagonsight {

// Ten thousand views of a hundred corners are 60 MB of JSON.
inline constexpr std::size_t kFileBytesMax = std::size_t{256} << 20;

inline std::span<const std::byte> bytes_of(std::string_view text) {
  return std::as_bytes(std::span(text.data(), text.size()));
}

Result<Solution> read_solution(const std::string& path);

struct DetectArguments {
  std::string images, board, out;
};
Result<void> run_detect(const DetectArguments& arguments);

struct ClickArguments {
  std::string images, board, observations, targets, sensors, solution;
  std::uint16_t port = 8090;
};
Result<void> run_click(const ClickArguments& arguments);

struct SolveArguments {
  std::string observations, sensors, out, report, images;
  bool keep_all = false;
};
Result<void> run_solve(const SolveArguments& arguments);

// The HTML page of a solution. `images` may be empty: then it is drawn without photographs.
struct ReportArguments {
  std::string solution, images, out;
};
Result<void> run_report(const ReportArguments& arguments);

// The same, of a solution at hand; `title` is told at its top.
Result<void> write_report(const Solution& solution, const std::string& images,
                          const std::string& title, const std::string& path);

struct GeoreferenceArguments {
  std::string solution, targets, markers, out;
  std::string images;      // the Kinects' depth images are beside them; may be empty
  double ball_radius = 0;  // metres, of targets that state none; 0: unknown
};
Result<void> run_georeference(const GeoreferenceArguments& arguments);

struct PackArguments {
  std::string solution, out;
};
Result<void> run_pack(const PackArguments& arguments);

struct LatencyArguments {
  std::string recording, rig, out;
  double ball_radius = 0;  // metres
};
Result<void> run_latency(const LatencyArguments& arguments);

}  // namespace wagonsight

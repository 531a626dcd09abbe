#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <string_view>

#include "base/result.h"

// The commands of wagonsight-calibrate, one function each: it reads its files, calls the calibrate
// module, writes its files and prints what a person wants to know.
namespace wagonsight {

// Ten thousand views of a hundred corners are 60 MB of JSON.
inline constexpr std::size_t kFileBytesMax = std::size_t{256} << 20;

inline std::span<const std::byte> bytes_of(std::string_view text) {
  return std::as_bytes(std::span(text.data(), text.size()));
}

struct DetectArguments {
  std::string images, board, out;
};
Result<void> run_detect(const DetectArguments& arguments);

struct SolveArguments {
  std::string observations, sensors, out, images;
  bool keep_all = false;
};
Result<void> run_solve(const SolveArguments& arguments);

struct GeoreferenceArguments {
  std::string solution, targets, markers, out;
};
Result<void> run_georeference(const GeoreferenceArguments& arguments);

struct PackArguments {
  std::string solution, out;
};
Result<void> run_pack(const PackArguments& arguments);

}  // namespace wagonsight

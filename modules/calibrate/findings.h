#pragma once

#include <string>
#include <vector>

#include "calibrate/solution.h"
#include "calibrate/uncertainty_map.h"

// What a report tells of a solution before any table: is it good, and what would make it better.
namespace wagonsight {

enum class Grade { kGood, kUsable, kPoor };

struct Finding {
  Grade grade = Grade::kGood;  // kGood: worth knowing; kUsable: better to do; kPoor: must be done
  std::string what, what_to_do;
};

struct Findings {
  Grade grade = Grade::kGood;
  std::string headline, sentence;  // plain words
  std::vector<Finding> list;       // the worst first
};

// How the corners of an imager cover its image: shares of an 8 x 6 grid.
struct Coverage {
  static constexpr int kColumns = 8, kRows = 6;
  std::string imager;
  int counts[kRows][kColumns] = {};
  double share = 0;      // of the cells that hold a corner
  std::string emptiest;  // "upper left": the third of the image with the fewest, or empty
};
std::vector<Coverage> coverage_of(const Solution& solution);

// Board poses that two imagers see at once, by imager.
std::vector<std::vector<int>> overlap_of(const Solution& solution);

// Between the line of sight to the board's middle and its normal, degrees: 0 is straight on, 90
// edge on.
double tilt_deg(const Solution& solution, const ViewSolution& view);

Findings judge(const Solution& solution, const UncertaintyMap& map);

}  // namespace wagonsight

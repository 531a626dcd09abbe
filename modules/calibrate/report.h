#pragma once

#include <map>
#include <string>
#include <string_view>

#include "calibrate/solution.h"

namespace wagonsight {

// One self-contained page, light and dark, without scripts: the verdict in plain words and what to
// do better, cameras and views worst first (the paper's Tables 1 and 2), residual vectors on the
// images, coverage and overlap, the uncertainty map, the georeference (its Table 3). `jpegs` are
// the views' images, downscaled at will, by View::image; views without one are drawn without.
std::string format_report(const Solution& solution, const std::map<std::string, std::string>& jpegs,
                          std::string_view title);

}  // namespace wagonsight

#pragma once

#include <string>
#include <string_view>

#include "calibrate/findings.h"
#include "calibrate/solution.h"
#include "calibrate/uncertainty_map.h"
#include "rig/rig.h"

// The report's drawings as SVG, and its text made safe for HTML. Inside of the report.
namespace wagonsight::report {

std::string escape(std::string_view text);

// Residual vectors, `enlarged` times, over the image when there is one.
std::string residual_figure(const ViewSolution& view, const Camera& camera, std::string_view jpeg,
                            double enlarged);

// Where an imager has seen corners: a shade per cell and a dot per corner.
std::string coverage_figure(const Coverage& coverage, const Solution& solution,
                            const ImagerSolution& imager);

// The wagon from above, coloured by the millimetres of UncertaintyMap, with the sensors.
std::string map_figure(const UncertaintyMap& map, const Rig& rig, bool pose_only);
std::string map_legend();

}  // namespace wagonsight::report

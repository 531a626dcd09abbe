#pragma once

#include <Eigen/Core>
#include <map>
#include <string>
#include <string_view>

#include "base/result.h"

namespace wagonsight {

// Reference coordinates by name, metres.
using Markers = std::map<std::string, Eigen::Vector3d>;

// Reads what the tracker saw. Either DTrack's text lines (A.R.T.): the single markers of "3d N
// [id quality][x y z] ..." are named by their number, the bodies of "6d" lines "6d/ID";
// millimetres; lines of other kinds are passed over; several frames are averaged. Or JSON: {"A":
// [x, y, z], ...} in metres. The Error names the line and the rule broken, or a marker that moved
// by more than 5 mm between frames.
Result<Markers> parse_markers(std::string_view text, std::string_view file);

}  // namespace wagonsight

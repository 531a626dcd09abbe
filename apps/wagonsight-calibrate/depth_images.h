#pragma once

#include <optional>
#include <string>
#include <vector>

#include "base/result.h"
#include "calibrate/depth_calibration.h"

namespace wagonsight {

// The depth images of the solution's views: FOLDER/NAME.depth/STEM.png (or .pgm), 16 bits,
// millimetres, beside FOLDER/NAME/STEM.png in which the board was found. Views without one are
// passed over; of many, a hundred a sensor are taken evenly. The Error names a file that cannot be
// read or has not 16 bits.
Result<std::vector<DepthView>> read_depth_images(const std::string& folder,
                                                 const std::vector<SensorSpec>& sensors,
                                                 const Solution& solution);

// The depth image beside one image ("k0/0001.png") of an imager; nothing where there is none.
Result<std::optional<DepthView>> read_depth_beside(const std::string& folder,
                                                   const std::string& imager,
                                                   const std::string& image);

}  // namespace wagonsight

#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "base/result.h"
#include "files.h"

namespace wagonsight {

// What is in a file, as JSON (for programs) and as words made from that JSON (for people).
using Report = nlohmann::ordered_json;

Result<Report> inspect_recording(const std::string& path);
Result<Report> inspect_blob(const std::string& path, const MappedFile& file);

}  // namespace wagonsight

#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "base/result.h"

// Folders that must be whole or not there at all. Every Error names the path and the system's
// reason.
namespace wagonsight {

// The folder's own entries are on the disk.
Result<void> sync_folder(const std::string& folder);
// Every file and folder below it, too.
Result<void> sync_tree(const std::string& folder);

// Nothing when it is not there.
Result<void> remove_tree(const std::string& path);

// Makes `name` what `prepared` is, in one step that a power cut cannot divide; what was there goes.
Result<void> replace_folder(const std::string& prepared, const std::string& name);

}  // namespace wagonsight

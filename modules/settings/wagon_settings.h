#pragma once

#include <optional>

#include "settings/table_reader.h"
#include "wagon/wagon.h"

namespace wagonsight {

// [wagon], [[zone]], [[seat]], [[door]], [[mask]], [[window]] and [[screen]] of a settings file.
// Nothing when there is no [wagon].
std::optional<Wagon> read_wagon(TableReader& root, Mistakes& mistakes);

}  // namespace wagonsight

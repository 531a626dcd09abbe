#pragma once

#include <string_view>

namespace wagonsight {

// The scene a recording was simulated from: its TOML text, so that replay knows the room.
inline constexpr std::string_view kSceneAttachment = "scene.toml";

}  // namespace wagonsight

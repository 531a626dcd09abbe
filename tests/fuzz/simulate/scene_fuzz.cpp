#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "simulate/scene.h"

// Any text as a scene: read with a room of finite size, or refused with the file's name.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  const auto scene = wagonsight::parse_scene(text, "fuzz.toml");
  if (!scene) {
    if (!scene.error().message.starts_with("fuzz.toml")) std::abort();
    return 0;
  }
  for (const double extent : {scene->length, scene->width, scene->height}) {
    if (!std::isfinite(extent) || extent <= 0) std::abort();
  }
  return 0;
}

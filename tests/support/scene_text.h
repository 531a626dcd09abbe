#pragma once

#include <fmt/format.h>

#include <string>
#include <string_view>

// Scenes as TOML, told briefly. What differs is given as further lines of TOML.
namespace wagonsight::testing {

inline std::string wagon_text(double length) {
  return fmt::format("\n[wagon]\nlength = {:.1f}\nwidth = 2.7\nheight = 2.4\n", length);
}

inline std::string seat_text(std::string_view name, std::string_view position, int yaw) {
  return fmt::format("[[seat]]\nname = '{}'\nposition = [{}]\nyaw = {}\n", name, position, yaw);
}

// A door in the wall y = 2.7 m.
inline std::string door_text(std::string_view name, double from, double to) {
  return fmt::format("[[door]]\nname = '{}'\nfrom = [{}, 2.7]\nto = [{}, 2.7]\n", name, from, to);
}

inline std::string sensor_text(std::string_view name, std::string_view kind,
                               std::string_view position, std::string_view look_at,
                               std::string_view more = "") {
  return fmt::format("[[sensor]]\nname = '{}'\nkind = '{}'\nposition = [{}]\nlook_at = [{}]\n{}\n",
                     name, kind, position, look_at, more);
}

inline std::string passenger_text(std::string_view name, std::string_view more) {
  return fmt::format("[[passenger]]\nname = '{}'\n{}\n", name, more);
}

// What the passenger told last does `at` seconds after the start.
inline std::string act_text(double at, std::string_view what, std::string_view more = "") {
  return fmt::format("[[passenger.do]]\nat = {}\nact = '{}'\n{}\n", at, what, more);
}

}  // namespace wagonsight::testing

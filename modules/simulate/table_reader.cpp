#include "simulate/table_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <sstream>

namespace wagonsight {
namespace {

std::string as_text(const toml::node& node) {
  std::ostringstream out;
  node.visit([&out](const auto& value) { out << value; });
  std::string text = out.str();
  std::replace(text.begin(), text.end(), '\n', ' ');
  constexpr std::size_t kLongest = 80;
  if (text.size() > kLongest) text = text.substr(0, kLongest) + "...";
  return text;
}

std::string listed(std::span<const std::string_view> choices) {
  std::string text;
  for (const auto choice : choices)
    text += fmt::format("{}\"{}\"", text.empty() ? "" : ", ", choice);
  return text;
}

}  // namespace

SceneReader::SceneReader(const toml::table& table, std::string path, std::string_view file,
                         std::optional<Error>& error)
    : table_(&table), path_(std::move(path)), file_(file), error_(&error) {}

void SceneReader::report(const toml::source_region& where, const std::string& key,
                         const std::string& value, std::string_view rule) {
  if (*error_) return;
  *error_ = Error{fmt::format("{}:{}: {} = {}: {}", file_, where.begin.line, key, value, rule)};
}

std::string SceneReader::qualified(std::string_view key) const {
  return path_.empty() ? std::string(key) : path_ + "." + std::string(key);
}

const toml::node* SceneReader::find(std::string_view key, bool needed) {
  asked_.emplace_back(key);
  const toml::node* node = table_->get(key);
  if (node == nullptr && needed)
    report(table_->source(), qualified(key), "(nothing)", "this key is needed");
  return *error_ ? nullptr : node;
}

void SceneReader::refuse(std::string_view key, std::string_view rule) {
  const toml::node* node = table_->get(key);
  report(node != nullptr ? node->source() : table_->source(), qualified(key),
         node != nullptr ? as_text(*node) : "(nothing)", rule);
}

double SceneReader::number(std::string_view key, double low, double high,
                           std::optional<double> fallback) {
  const double otherwise = fallback.value_or(low);
  const toml::node* node = find(key, !fallback.has_value());
  if (node == nullptr) return otherwise;
  const std::optional<double> value =
      node->is_number() ? node->value<double>() : std::optional<double>{};
  if (value && std::isfinite(*value) && *value >= low && *value <= high) return *value;
  refuse(key, fmt::format("must be a number from {} to {}", low, high));
  return otherwise;
}

int SceneReader::whole(std::string_view key, int low, int high, int fallback) {
  const toml::node* node = find(key, false);
  if (node == nullptr) return fallback;
  const auto value = node->is_integer() ? node->value<std::int64_t>() : std::nullopt;
  if (value && *value >= low && *value <= high) return static_cast<int>(*value);
  refuse(key, fmt::format("must be a whole number from {} to {}", low, high));
  return fallback;
}

std::string SceneReader::text(std::string_view key, std::optional<std::string> fallback) {
  const toml::node* node = find(key, !fallback.has_value());
  const std::string otherwise = fallback.value_or("");
  if (node == nullptr) return otherwise;
  const auto value = node->is_string() ? node->value<std::string>() : std::nullopt;
  constexpr std::size_t kLongest = 40;  // base's Name
  if (value && !value->empty() && value->size() <= kLongest) return *value;
  refuse(key, "must be a text of 1 to 40 bytes");
  return otherwise;
}

int SceneReader::choice(std::string_view key, std::span<const std::string_view> choices,
                        std::optional<int> fallback) {
  const toml::node* node = find(key, !fallback.has_value());
  if (node == nullptr) return fallback.value_or(0);
  const auto value = node->is_string() ? node->value<std::string>() : std::nullopt;
  const auto found = value ? std::find(choices.begin(), choices.end(), *value) : choices.end();
  if (found != choices.end()) return static_cast<int>(found - choices.begin());
  refuse(key, "must be one of " + listed(choices));
  return fallback.value_or(0);
}

std::vector<std::string> SceneReader::texts(std::string_view key,
                                            std::span<const std::string_view> choices) {
  std::vector<std::string> found;
  const toml::node* node = find(key, false);
  if (node == nullptr) return found;
  const std::string rule = "must be a list of some of " + listed(choices);
  const toml::array* array = node->as_array();
  if (array == nullptr) {
    refuse(key, rule);
    return found;
  }
  for (const toml::node& item : *array) {
    const auto value = item.is_string() ? item.value<std::string>() : std::nullopt;
    if (!value || std::find(choices.begin(), choices.end(), *value) == choices.end()) {
      refuse(key, rule);
      return found;
    }
    found.push_back(*value);
  }
  return found;
}

namespace {

template <int N>
std::optional<Eigen::Matrix<double, N, 1>> vector_of(const toml::node& node) {
  const toml::array* array = node.as_array();
  if (array == nullptr || array->size() != static_cast<std::size_t>(N)) return std::nullopt;
  Eigen::Matrix<double, N, 1> result;
  for (int i = 0; i < N; ++i) {
    const toml::node& item = *array->get(static_cast<std::size_t>(i));
    const auto value = item.is_number() ? item.value<double>() : std::nullopt;
    constexpr double kFarthest = 1000;  // metres: beyond any wagon
    if (!value || !std::isfinite(*value) || std::abs(*value) > kFarthest) return std::nullopt;
    result[i] = *value;
  }
  return result;
}

}  // namespace

template <int N>
std::optional<Eigen::Matrix<double, N, 1>> SceneReader::point(std::string_view key, bool needed) {
  const toml::node* node = find(key, needed);
  if (node == nullptr) return std::nullopt;
  const auto result = vector_of<N>(*node);
  if (!result) refuse(key, fmt::format("must be {} numbers in brackets, in metres", N));
  return result;
}

std::optional<Eigen::Vector2d> SceneReader::point2(std::string_view key, bool needed) {
  return point<2>(key, needed);
}

std::optional<Eigen::Vector3d> SceneReader::point3(std::string_view key, bool needed) {
  return point<3>(key, needed);
}

std::vector<Eigen::Vector2d> SceneReader::polygon(std::string_view key, std::size_t corners_max) {
  std::vector<Eigen::Vector2d> corners;
  const toml::node* node = find(key, true);
  if (node == nullptr) return corners;
  const std::string rule = fmt::format("must be 3 to {} points [x, y]", corners_max);
  const toml::array* array = node->as_array();
  if (array == nullptr || array->size() < 3 || array->size() > corners_max) {
    refuse(key, rule);
    return corners;
  }
  for (const toml::node& item : *array) {
    const auto corner = vector_of<2>(item);
    if (!corner) {
      refuse(key, rule);
      return {};
    }
    corners.push_back(*corner);
  }
  return corners;
}

std::vector<SceneReader> SceneReader::tables(std::string_view key, std::size_t count_max) {
  std::vector<SceneReader> readers;
  const toml::node* node = find(key, false);
  if (node == nullptr) return readers;
  const std::string path = qualified(key);
  if (const toml::table* single = node->as_table()) {
    readers.emplace_back(*single, path, file_, *error_);
    return readers;
  }
  const toml::array* array = node->as_array();
  const bool fits = array != nullptr && array->size() <= count_max;
  if (!fits) {
    report(node->source(), path, fmt::format("{} entries", array != nullptr ? array->size() : 1),
           fmt::format("must be at most {} tables, written as [[{}]]", count_max, path));
    return readers;
  }
  for (const toml::node& item : *array) {
    const toml::table* table = item.as_table();
    if (table == nullptr) {
      report(item.source(), path, as_text(item), "must be a table, written as [[" + path + "]]");
      return readers;
    }
    readers.emplace_back(*table, path, file_, *error_);
  }
  return readers;
}

void SceneReader::finish() {
  for (const auto& [key, node] : *table_) {
    if (std::find(asked_.begin(), asked_.end(), key.str()) != asked_.end()) continue;
    std::string known;
    for (const std::string& name : asked_) known += (known.empty() ? "" : ", ") + name;
    report(key.source(), qualified(key.str()), as_text(node),
           "there is no such key here; known are " + known);
    return;
  }
}

}  // namespace wagonsight

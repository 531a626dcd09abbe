#include "settings/table_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <numeric>

namespace wagonsight {
namespace {

// Enough to recognise a value in the file.
constexpr std::size_t kShownBytesMax = 60;

void append_shown(const toml::node& node, std::string& text) {
  if (text.size() > kShownBytesMax) return;
  if (const toml::array* array = node.as_array()) {
    text += '[';
    for (std::size_t i = 0; i < array->size(); ++i) {
      if (i > 0) text += ", ";
      append_shown((*array)[i], text);
    }
    text += ']';
  } else if (node.is_table()) {
    text += "a table";
  } else if (const auto* string = node.as_string()) {
    text += '"' + string->get() + '"';
  } else if (const auto* number = node.as_floating_point()) {
    text += fmt::format("{}", number->get());
  } else if (const auto* integer = node.as_integer()) {
    text += fmt::format("{}", integer->get());
  } else if (const auto* boolean = node.as_boolean()) {
    text += boolean->get() ? "true" : "false";
  } else {
    text += "a date or a time";
  }
}

std::string shown(const toml::node& node) {
  std::string text;
  append_shown(node, text);
  if (text.size() > kShownBytesMax) {
    std::size_t end = kShownBytesMax;  // never within a UTF-8 sequence
    while (end > 0 && (static_cast<unsigned char>(text[end]) & 0xC0) == 0x80) --end;
    text.resize(end);
    text += "...";
  }
  return text;
}

std::string range_rule(double low, double high) {
  return fmt::format("must be from {:g} to {:g}", low, high);
}

std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t substituted = diagonal + (a[i - 1] == b[j - 1] ? 0 : 1);
      diagonal = row[j];
      row[j] = std::min({row[j] + 1, row[j - 1] + 1, substituted});
    }
  }
  return row.back();
}

}  // namespace

std::string_view nearest_word(std::string_view word, const std::vector<std::string>& words) {
  constexpr std::size_t kWordMax = 64;  // longer is no typing mistake
  if (word.size() > kWordMax) return {};
  std::string_view nearest;
  std::size_t least = std::max<std::size_t>(2, word.size() / 2) + 1;
  for (const std::string& candidate : words) {
    const std::size_t distance = edit_distance(word, candidate);
    if (distance >= least) continue;
    least = distance;
    nearest = candidate;
  }
  return nearest;
}

void Mistakes::add(const toml::source_region& where, std::string_view what, std::string_view rule) {
  const std::uint32_t number = where.begin.line;
  std::string text = fmt::format("{}:{}: {}: {}", file_name_, number, what, rule);
  // A line is a line and a terminal is left alone, whatever stands in the file.
  std::replace_if(
      text.begin(), text.end(), [](unsigned char c) { return c < 0x20 || c == 0x7F; }, ' ');
  lines_.push_back({number, std::move(text)});
}

std::string Mistakes::text() const {
  auto sorted = lines_;
  std::stable_sort(sorted.begin(), sorted.end(),
                   [](const Line& a, const Line& b) { return a.number < b.number; });
  std::string text;
  for (const Line& line : sorted) text += (text.empty() ? "" : "\n") + line.text;
  return text;
}

const toml::node* TableReader::find(std::string_view key) {
  known_.emplace_back(key);
  return table_.get(key);
}

std::string TableReader::name_of(std::string_view key) const {
  return path_.empty() ? std::string(key) : fmt::format("{}.{}", path_, key);
}

void TableReader::refuse(std::string_view key, std::string_view rule) {
  if (const toml::node* node = table_.get(key))
    mistakes_.add(node->source(), fmt::format("{} = {}", name_of(key), shown(*node)), rule);
  else
    mistakes_.add(table_.source(), name_of(key), rule);
}

void TableReader::refuse_secret(std::string_view key, std::string_view rule) {
  const toml::node* node = table_.get(key);
  mistakes_.add(node == nullptr ? table_.source() : node->source(), name_of(key), rule);
}

void TableReader::require(std::string_view key, std::string_view why) {
  if (!has(key)) mistakes_.add(table_.source(), fmt::format("{} is missing", name_of(key)), why);
}

bool TableReader::number(std::string_view key, double& out, double low, double high) {
  const toml::node* node = find(key);
  if (node == nullptr) return false;
  if (read_numbers(*node, &out, 1, low, high)) return true;
  refuse(key, node->is_number() ? range_rule(low, high) : "must be a number");
  return false;
}

bool TableReader::read_numbers(const toml::node& node, double* out, std::size_t count, double low,
                               double high) const {
  const auto in_range = [&](double v) { return v >= low && v <= high; };  // NaN is not
  if (count == 1 && node.is_number()) {
    const double value = *node.value<double>();
    if (in_range(value)) *out = value;
    return in_range(value);
  }
  const toml::array* array = node.as_array();
  if (array == nullptr || array->size() != count) return false;
  std::vector<double> values;
  for (const toml::node& item : *array) {
    if (!item.is_number() || !in_range(*item.value<double>())) return false;
    values.push_back(*item.value<double>());
  }
  std::copy(values.begin(), values.end(), out);
  return true;
}

bool TableReader::numbers(std::string_view key, double* out, std::size_t count, double low,
                          double high) {
  const toml::node* node = find(key);
  if (node == nullptr) return false;
  if (node->is_array() && read_numbers(*node, out, count, low, high)) return true;
  refuse(key, fmt::format("must be {} numbers from {:g} to {:g}", count, low, high));
  return false;
}

bool TableReader::integer(std::string_view key, std::int64_t& out, std::int64_t low,
                          std::int64_t high) {
  const toml::node* node = find(key);
  if (node == nullptr) return false;
  if (const auto* integer = node->as_integer(); integer && **integer >= low && **integer <= high) {
    out = **integer;
    return true;
  }
  refuse(key, fmt::format("must be a whole number from {} to {}", low, high));
  return false;
}

bool TableReader::boolean(std::string_view key, bool& out) {
  const toml::node* node = find(key);
  if (node == nullptr) return false;
  if (const auto* value = node->as_boolean()) {
    out = **value;
    return true;
  }
  refuse(key, "must be true or false");
  return false;
}

bool TableReader::text(std::string_view key, std::string& out, std::size_t size_max) {
  const toml::node* node = find(key);
  if (node == nullptr) return false;
  const auto* value = node->as_string();
  const auto is_control = [](unsigned char c) { return c < 0x20 || c == 0x7F; };
  if (value && !(*value)->empty() && (*value)->size() <= size_max &&
      std::none_of((*value)->begin(), (*value)->end(), is_control)) {
    out = **value;
    return true;
  }
  refuse(key, fmt::format("must be a text of 1 to {} bytes on one line", size_max));
  return false;
}

bool TableReader::secret(std::string_view key, std::string& out, std::size_t size_min,
                         std::size_t size_max) {
  const toml::node* node = find(key);
  if (node == nullptr) return false;
  const auto* value = node->as_string();
  if (value && (*value)->size() >= size_min && (*value)->size() <= size_max &&
      std::all_of((*value)->begin(), (*value)->end(), [](char c) { return c > ' ' && c <= '~'; })) {
    out = **value;
    return true;
  }
  refuse_secret(key, fmt::format("must be a text of {} to {} printable characters without spaces",
                                 size_min, size_max));
  return false;
}

bool TableReader::choice(std::string_view key, std::string& out,
                         std::initializer_list<std::string_view> allowed) {
  const toml::node* node = find(key);
  if (node == nullptr) return false;
  const auto* value = node->as_string();
  if (value && std::find(allowed.begin(), allowed.end(), **value) != allowed.end()) {
    out = **value;
    return true;
  }
  refuse(key, fmt::format("must be \"{}\" or \"{}\"",
                          fmt::join(allowed.begin(), allowed.end() - 1, "\", \""),
                          *(allowed.end() - 1)));
  return false;
}

bool TableReader::points(std::string_view key, std::vector<std::array<double, 2>>& out, double low,
                         double high) {
  const toml::node* node = find(key);
  if (node == nullptr) return false;
  const toml::array* array = node->as_array();
  std::vector<std::array<double, 2>> points;
  bool good = array != nullptr;
  if (good) {
    for (const toml::node& item : *array) {
      std::array<double, 2> point{};
      good = good && item.is_array() && read_numbers(item, point.data(), 2, low, high);
      points.push_back(point);
    }
  }
  if (good)
    out = std::move(points);
  else
    refuse(key, fmt::format("must be a list of [x, y], each from {:g} to {:g}", low, high));
  return good;
}

bool TableReader::texts(std::string_view key, std::vector<std::string>& out, std::size_t count_max,
                        std::size_t size_max) {
  const toml::node* node = find(key);
  if (node == nullptr) return false;
  const toml::array* array = node->as_array();
  std::vector<std::string> texts;
  bool good = array != nullptr && array->size() <= count_max;
  if (good) {
    for (const toml::node& item : *array) {
      const auto* value = item.as_string();
      good = good && value && !(*value)->empty() && (*value)->size() <= size_max;
      if (good) texts.push_back(**value);
    }
  }
  if (good)
    out = std::move(texts);
  else
    refuse(key,
           fmt::format("must be a list of at most {} texts of 1 to {} bytes", count_max, size_max));
  return good;
}

std::vector<const toml::table*> TableReader::tables(std::string_view key) {
  std::vector<const toml::table*> tables;
  const toml::node* node = find(key);
  if (node == nullptr) return tables;
  const toml::array* array = node->as_array();
  if (array == nullptr || !array->is_homogeneous(toml::node_type::table)) {
    refuse(key, fmt::format("must be written as [[{}]]", key));
    return tables;
  }
  for (const toml::node& item : *array) tables.push_back(item.as_table());
  return tables;
}

const toml::table* TableReader::table(std::string_view key) {
  const toml::node* node = find(key);
  if (node == nullptr) return nullptr;
  if (!node->is_table()) refuse(key, fmt::format("must be written as [{}]", key));
  return node->as_table();
}

void TableReader::finish() {
  for (const auto& [key, node] : table_) {
    if (std::find(known_.begin(), known_.end(), key.str()) != known_.end()) continue;
    const std::string_view nearest = nearest_word(key.str(), known_);
    const std::string hint = nearest.empty()
                                 ? fmt::format("known here: {}", fmt::join(known_, ", "))
                                 : fmt::format("did you mean {}?", nearest);
    mistakes_.add(key.source(), name_of(key.str()), "unknown key; " + hint);
  }
}

}  // namespace wagonsight

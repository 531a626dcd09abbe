#include <fmt/format.h>

#include <algorithm>

#include "settings/settings.h"
#include "settings/table_reader.h"

// Writes a parsed file out again. Not by toml++'s own formatter: 3.3 computes the width of a number
// below one by casting a negative double to size_t.
namespace wagonsight {
namespace {

void append_quoted(std::string_view text, std::string& out) {
  out += '"';
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if (c == '"' || c == '\\') {
      out += '\\';
      out += c;
    } else if (byte < 0x20 || byte == 0x7F) {
      out += fmt::format("\\u{:04X}", byte);
    } else {
      out += c;
    }
  }
  out += '"';
}

void append_key(std::string_view key, std::string& out) {
  const bool bare = !key.empty() && std::all_of(key.begin(), key.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' ||
           c == '-';
  });
  if (bare)
    out += key;
  else
    append_quoted(key, out);
}

void append_value(const toml::node& node, std::string& out);

void append_inline_table(const toml::table& table, std::string& out) {
  out += '{';
  bool first = true;
  for (const auto& [key, node] : table) {
    out += first ? "" : ", ";
    first = false;
    append_key(key.str(), out);
    out += " = ";
    append_value(node, out);
  }
  out += '}';
}

void append_value(const toml::node& node, std::string& out) {
  if (const toml::array* array = node.as_array()) {
    out += '[';
    for (std::size_t i = 0; i < array->size(); ++i) {
      out += i == 0 ? "" : ", ";
      append_value((*array)[i], out);
    }
    out += ']';
  } else if (const toml::table* table = node.as_table()) {
    append_inline_table(*table, out);
  } else if (const auto* text = node.as_string()) {
    append_quoted(text->get(), out);
  } else if (const auto* integer = node.as_integer()) {
    out += fmt::format("{}", integer->get());
  } else if (const auto* number = node.as_floating_point()) {
    // A whole number stays one with a point; fmt's shortest form reads back as the same value.
    const std::string digits = fmt::format("{}", number->get());
    out += digits + (digits.find_first_not_of("-0123456789") == std::string::npos ? ".0" : "");
  } else if (const auto* boolean = node.as_boolean()) {
    out += boolean->get() ? "true" : "false";
  } else {
    out += "\"(a date or a time)\"";  // no setting is one
  }
}

bool is_list_of_tables(const toml::node& node) {
  const toml::array* array = node.as_array();
  return array != nullptr && array->is_homogeneous(toml::node_type::table);
}

// Values before tables, as the format wants it.
void append_table(const toml::table& table, const std::string& path, std::string& out) {
  for (const auto& [key, node] : table) {
    if (node.is_table() || is_list_of_tables(node)) continue;
    append_key(key.str(), out);
    out += " = ";
    append_value(node, out);
    out += '\n';
  }
  for (const auto& [key, node] : table) {
    std::string name = path.empty() ? "" : path + ".";
    append_key(key.str(), name);
    if (const toml::table* inner = node.as_table()) {
      out += "\n[" + name + "]\n";
      append_table(*inner, name, out);
    } else if (is_list_of_tables(node)) {
      for (const toml::node& item : *node.as_array()) {
        out += "\n[[" + name + "]]\n";
        append_table(*item.as_table(), name, out);
      }
    }
  }
}

// Whatever stands below [web] tokens, of whatever form, is a secret.
void remove_secrets(toml::table& file) {
  toml::table* web = file["web"].as_table();
  if (web == nullptr || !web->contains("tokens")) return;
  std::vector<std::string> names;
  if (const toml::table* tokens = (*web)["tokens"].as_table())
    for (const auto& [key, node] : *tokens) names.emplace_back(key.str());
  toml::table removed;
  for (const std::string& name : names) removed.insert(name, "(removed)");
  if (names.empty())
    web->insert_or_assign("tokens", "(removed)");
  else
    web->insert_or_assign("tokens", std::move(removed));
}

}  // namespace

std::string without_secrets(std::string_view text) {
  if (text.size() > kSettingsBytesMax) return {};
  toml::parse_result file = toml::parse(text);
  if (!file) return {};
  remove_secrets(file.table());
  std::string out;
  append_table(file.table(), "", out);
  return out;
}

}  // namespace wagonsight

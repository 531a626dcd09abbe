#pragma once

#include <array>
#include <cstdint>
#include <initializer_list>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/toml.h"

// Reads one table of a TOML file key by key and gathers what is wrong with it. Internal to
// settings.
namespace wagonsight {

// Gathers the mistakes of a file in the order of their lines.
class Mistakes {
 public:
  explicit Mistakes(std::string_view file_name) : file_name_(file_name) {}

  // FILE:LINE: WHAT: RULE
  void add(const toml::source_region& where, std::string_view what, std::string_view rule);
  bool empty() const { return lines_.empty(); }
  std::string text() const;  // one line each

 private:
  struct Line {
    std::uint32_t number;
    std::string text;
  };
  std::string file_name_;
  std::vector<Line> lines_;
};

// Each getter leaves `out` as it is when the key is absent or wrong; what is wrong is gathered.
// A key that no getter asked for is a mistake, found by finish().
class TableReader {
 public:
  // `path` is how the table is called in messages: "pipeline", "seat 3".
  TableReader(const toml::table& table, std::string path, Mistakes& mistakes)
      : table_(table), path_(std::move(path)), mistakes_(mistakes) {}

  bool number(std::string_view key, double& out, double low, double high);
  bool integer(std::string_view key, std::int64_t& out, std::int64_t low, std::int64_t high);
  bool boolean(std::string_view key, bool& out);
  bool text(std::string_view key, std::string& out, std::size_t size_max);
  // Printable ASCII without spaces, which is what a header can carry; never shown in a message.
  bool secret(std::string_view key, std::string& out, std::size_t size_min, std::size_t size_max);
  bool choice(std::string_view key, std::string& out,
              std::initializer_list<std::string_view> allowed);
  template <std::size_t N>
  bool numbers(std::string_view key, std::array<double, N>& out, double low, double high) {
    return numbers(key, out.data(), N, low, high);
  }
  // [[x, y], ...]
  bool points(std::string_view key, std::vector<std::array<double, 2>>& out, double low,
              double high);
  bool texts(std::string_view key, std::vector<std::string>& out, std::size_t count_max,
             std::size_t size_max);
  // The tables of [[key]], or nothing.
  std::vector<const toml::table*> tables(std::string_view key);
  const toml::table* table(std::string_view key);

  bool has(std::string_view key) const { return table_.get(key) != nullptr; }
  // The value of `key` breaks `rule` (or, when absent, the table does).
  void refuse(std::string_view key, std::string_view rule);
  // As refuse, without telling the value.
  void refuse_secret(std::string_view key, std::string_view rule);
  void require(std::string_view key, std::string_view why);
  void finish();

 private:
  const toml::node* find(std::string_view key);
  bool numbers(std::string_view key, double* out, std::size_t count, double low, double high);
  bool read_numbers(const toml::node& node, double* out, std::size_t count, double low,
                    double high) const;
  std::string name_of(std::string_view key) const;

  const toml::table& table_;
  std::string path_;
  Mistakes& mistakes_;
  std::vector<std::string> known_;
};

// Of the words the one that is closest to `word` by Levenshtein's distance; empty when none is.
std::string_view nearest_word(std::string_view word, const std::vector<std::string>& words);

}  // namespace wagonsight

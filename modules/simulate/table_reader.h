#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/result.h"
#include "base/toml.h"

namespace wagonsight {

// Reads the keys of one TOML table and remembers the first rule that was broken, so that a caller
// reads key after key as prose and asks once. After an error every read gives its default.
class SceneReader {
 public:
  // `error` is shared by the readers of one file. `path` is told in errors, as "passenger.do".
  SceneReader(const toml::table& table, std::string path, std::string_view file,
              std::optional<Error>& error);

  double number(std::string_view key, double low, double high, std::optional<double> fallback);
  int whole(std::string_view key, int low, int high, int fallback);
  std::string text(std::string_view key, std::optional<std::string> fallback);
  // One of `choices` (by index), or `fallback` when the key is absent; none: the key is needed.
  int choice(std::string_view key, std::span<const std::string_view> choices,
             std::optional<int> fallback);
  std::vector<std::string> texts(std::string_view key, std::span<const std::string_view> choices);
  std::optional<Eigen::Vector2d> point2(std::string_view key, bool needed);
  std::optional<Eigen::Vector3d> point3(std::string_view key, bool needed);
  std::vector<Eigen::Vector2d> polygon(std::string_view key, std::size_t corners_max);
  // The readers of an array of tables [[key]]; a single [key] counts as one.
  std::vector<SceneReader> tables(std::string_view key, std::size_t count_max);
  bool has(std::string_view key) const { return table_->contains(key); }

  // Reports any key that nobody asked for.
  void finish();
  // Reports that `key`, as it stands in the file, breaks `rule`.
  void refuse(std::string_view key, std::string_view rule);

 private:
  const toml::node* find(std::string_view key, bool needed);
  std::string qualified(std::string_view key) const;
  void report(const toml::source_region& where, const std::string& key, const std::string& value,
              std::string_view rule);
  template <int N>
  std::optional<Eigen::Matrix<double, N, 1>> point(std::string_view key, bool needed);

  const toml::table* table_;
  std::string path_;
  std::string_view file_;
  std::optional<Error>* error_;
  std::vector<std::string> asked_;
};

}  // namespace wagonsight

#include "calibrate/board_grid.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>
#include <numbers>
#include <opencv2/calib3d.hpp>
#include <optional>
#include <set>

namespace wagonsight {
namespace {

using Place = std::pair<int, int>;
constexpr double kTurnMax = 35 * std::numbers::pi / 180;  // between what is predicted and seen

// Difference of two lines' angles, 0 to pi / 2.
double between_lines(double a, double b) {
  const double d = std::fmod(std::abs(a - b), std::numbers::pi);
  return std::min(d, std::numbers::pi - d);
}

class Grower {
 public:
  Grower(const std::vector<SaddlePoint>& saddles, int side_max)
      : saddles_(saddles), used_(saddles.size(), false), side_max_(side_max) {}

  // The lattice that hangs together with a saddle; empty when it has no square of neighbours.
  BoardGrid grow_from(std::size_t seed) {
    grid_ = BoardGrid{};
    taken_.clear();
    if (!lay_first_square(seed)) return {};
    std::deque<Place> open;
    for (const auto& [place, node] : grid_.nodes) open.push_back(place);
    while (!open.empty()) {
      const Place from = open.front();
      open.pop_front();
      for (const Place& step : {Place{1, 0}, {-1, 0}, {0, 1}, {0, -1}}) {
        const Place to{from.first + step.first, from.second + step.second};
        if (grid_.nodes.contains(to) || !fits(to)) continue;
        const auto expected = expect(from, step);
        if (!expected) continue;
        const double spacing = (*expected - pixel(from)).norm();
        if (!take_nearest(to, *expected, 0.3 * spacing)) continue;
        open.push_back(to);
      }
    }
    return grid_;
  }

  // Adds saddles that lie where the lattice's homography has places, gap or not.
  void bridge_gaps(BoardGrid& grid) {
    grid_ = grid;
    taken_.clear();
    for (const auto& [place, node] : grid_.nodes) taken_.insert(node.saddle);
    constexpr int kRounds = 4;
    for (int round = 0; round < kRounds; ++round) {
      const std::size_t before = grid_.nodes.size();
      // Not farther than this from what is known: a homography knows no lens distortion.
      constexpr int kReach = 4;
      std::set<Place> places;
      for (const auto& [place, node] : grid_.nodes)
        for (int di = -kReach; di <= kReach; ++di)
          for (int dj = -kReach; dj <= kReach; ++dj)
            places.insert({place.first + di, place.second + dj});
      for (const Place& to : places) {
        if (grid_.nodes.contains(to) || !fits(to)) continue;
        const Eigen::Vector2d expected = position_of(grid_, to.first, to.second);
        const double spacing =
            std::min((position_of(grid_, to.first + 1, to.second) - expected).norm(),
                     (position_of(grid_, to.first, to.second + 1) - expected).norm());
        if (expected.allFinite() && spacing > 4) take_nearest(to, expected, 0.22 * spacing);
      }
      if (grid_.nodes.size() == before) break;
    }
    grid = grid_;
  }

  void mark_used(const BoardGrid& grid) {
    for (const auto& [place, node] : grid.nodes) used_[node.saddle] = true;
  }
  bool is_used(std::size_t saddle) const { return used_[saddle]; }

 private:
  const Eigen::Vector2d& pixel(const Place& place) const { return grid_.nodes.at(place).pixel; }

  // Would the lattice still fit onto the board?
  bool fits(const Place& place) const {
    int low_i = place.first, high_i = low_i, low_j = place.second, high_j = low_j;
    for (const auto& [at, node] : grid_.nodes) {
      low_i = std::min(low_i, at.first), high_i = std::max(high_i, at.first);
      low_j = std::min(low_j, at.second), high_j = std::max(high_j, at.second);
    }
    return high_i - low_i < side_max_ && high_j - low_j < side_max_;
  }

  void put(const Place& place, std::size_t saddle) {
    grid_.nodes[place] = {saddles_[saddle].pixel, saddle};
    taken_.insert(saddle);
  }

  // The nearest free saddle along `direction` (unit) whose sectors are the other way round.
  std::optional<std::size_t> neighbour(std::size_t from, const Eigen::Vector2d& direction) const {
    std::optional<std::size_t> best;
    double nearest = 1e9;
    for (std::size_t s = 0; s < saddles_.size(); ++s) {
      const Eigen::Vector2d way = saddles_[s].pixel - saddles_[from].pixel;
      const double along = way.dot(direction), length = way.norm();
      constexpr double kCone = 0.94;  // cosine of 20 degrees
      if (s == from || along < kCone * length || length < 4 || length >= nearest) continue;
      const double turn = between_lines(saddles_[s].bright_angle,
                                        saddles_[from].bright_angle + std::numbers::pi / 2);
      if (turn > kTurnMax) continue;
      nearest = length;
      best = s;
    }
    return best;
  }

  bool lay_first_square(std::size_t seed) {
    Eigen::Vector2d along_i = saddles_[seed].edges[0], along_j = saddles_[seed].edges[1];
    // Clockwise in the image, whose y points down.
    if (along_i.x() * along_j.y() - along_i.y() * along_j.x() < 0) along_j = -along_j;
    const auto right = neighbour(seed, along_i), below = neighbour(seed, along_j);
    if (!right || !below || *right == *below) return false;
    const Eigen::Vector2d e_i = saddles_[*right].pixel - saddles_[seed].pixel,
                          e_j = saddles_[*below].pixel - saddles_[seed].pixel;
    if (e_i.norm() > 3 * e_j.norm() || e_j.norm() > 3 * e_i.norm()) return false;
    // Of the sectors at the seed, is the one towards (+, +) bright?
    const Eigen::Vector2d diagonal = e_i.normalized() + e_j.normalized();
    const double to_diagonal =
        between_lines(saddles_[seed].bright_angle, std::atan2(diagonal.y(), diagonal.x()));
    grid_.bright_at_even = to_diagonal < std::numbers::pi / 4 ? 1 : -1;
    put({0, 0}, seed);
    put({1, 0}, *right);
    put({0, 1}, *below);
    const Eigen::Vector2d corner = saddles_[seed].pixel + e_i + e_j;
    return take_nearest({1, 1}, corner, 0.3 * std::min(e_i.norm(), e_j.norm()));
  }

  // Where the neighbour of `from` should be: straight on from the node behind it, or across from
  // the row beside it, or the mean of what there is.
  std::optional<Eigen::Vector2d> expect(const Place& from, const Place& step) const {
    Eigen::Vector2d sum = Eigen::Vector2d::Zero();
    int votes = 0;
    const auto at = [&](int i, int j) { return grid_.nodes.find({i, j}); };
    const auto behind = at(from.first - step.first, from.second - step.second);
    if (behind != grid_.nodes.end()) sum += 2 * pixel(from) - behind->second.pixel, ++votes;
    for (const int side : {-1, 1}) {
      const Place across{side * step.second, side * step.first};
      const auto beside = at(from.first + across.first, from.second + across.second);
      const auto ahead =
          at(from.first + across.first + step.first, from.second + across.second + step.second);
      if (beside == grid_.nodes.end() || ahead == grid_.nodes.end()) continue;
      sum += pixel(from) + ahead->second.pixel - beside->second.pixel, ++votes;
    }
    if (votes == 0) return std::nullopt;
    return sum / votes;
  }

  // Bright where the board's pattern has it at that place?
  bool has_right_colour(const Place& place, std::size_t saddle) const {
    // The nearest node of the same colouring compares best; sectors turn little between nodes.
    double nearest = 1e9, expected = 0;
    for (const auto& [at, node] : grid_.nodes) {
      const double distance = (node.pixel - saddles_[saddle].pixel).norm();
      if (distance >= nearest) continue;
      nearest = distance;
      const bool same = (at.first + at.second - place.first - place.second) % 2 == 0;
      expected = saddles_[node.saddle].bright_angle + (same ? 0 : std::numbers::pi / 2);
    }
    return between_lines(saddles_[saddle].bright_angle, expected) < kTurnMax;
  }

  bool take_nearest(const Place& place, const Eigen::Vector2d& expected, double within) {
    std::optional<std::size_t> best;
    double nearest = within;
    for (std::size_t s = 0; s < saddles_.size(); ++s) {
      const double distance = (saddles_[s].pixel - expected).norm();
      if (distance >= nearest || taken_.contains(s)) continue;
      if (!has_right_colour(place, s)) continue;
      nearest = distance;
      best = s;
    }
    if (!best) return false;
    put(place, *best);
    return true;
  }

  const std::vector<SaddlePoint>& saddles_;
  std::vector<bool> used_;
  int side_max_;
  BoardGrid grid_;
  std::set<std::size_t> taken_;
};

template <class Get>
int extent(const BoardGrid& grid, Get get) {
  if (grid.nodes.empty()) return 0;
  int low = get(grid.nodes.begin()->first), high = low;
  for (const auto& [place, node] : grid.nodes) {
    low = std::min(low, get(place));
    high = std::max(high, get(place));
  }
  return high - low + 1;
}

}  // namespace

int BoardGrid::extent_i() const {
  return extent(*this, [](const Place& p) { return p.first; });
}
int BoardGrid::extent_j() const {
  return extent(*this, [](const Place& p) { return p.second; });
}

BoardGrid find_grid(const std::vector<SaddlePoint>& saddles, int side_max) {
  constexpr std::size_t kNodesMin = 6;
  constexpr int kSeedsMax = 60;  // a board that sixty seeds have not found is none
  Grower grower(saddles, side_max);
  BoardGrid best;
  int seeds = 0;
  for (std::size_t s = 0; s < saddles.size() && seeds < kSeedsMax; ++s) {
    if (grower.is_used(s)) continue;
    ++seeds;
    const BoardGrid grid = grower.grow_from(s);
    if (grid.nodes.size() < kNodesMin) continue;
    grower.mark_used(grid);
    if (grid.nodes.size() > best.nodes.size()) best = grid;
  }
  if (best.nodes.size() < kNodesMin) return {};
  grower.bridge_gaps(best);
  return best;
}

Eigen::Vector2d position_of(const BoardGrid& grid, double i, double j) {
  // The sixteen nearest nodes: near enough for a lens' distortion to be one homography.
  constexpr std::size_t kNear = 16;
  std::vector<std::pair<double, Place>> by_distance;
  for (const auto& [place, node] : grid.nodes)
    by_distance.emplace_back(std::hypot(place.first - i, place.second - j), place);
  std::sort(by_distance.begin(), by_distance.end());
  if (by_distance.size() > kNear) {
    // All that are as far as the sixteenth, so that a line of nodes is not taken alone.
    const double limit = std::max(3.0, by_distance[kNear - 1].first);
    std::erase_if(by_distance, [&](const auto& item) { return item.first > limit + 1e-9; });
  }
  std::vector<cv::Point2d> from, to;
  for (const auto& [distance, place] : by_distance) {
    const Eigen::Vector2d& p = grid.nodes.at(place).pixel;
    from.emplace_back(place.first, place.second);
    to.emplace_back(p.x(), p.y());
  }
  constexpr double kNowhere = std::numeric_limits<double>::quiet_NaN();
  if (from.size() < 4) return {kNowhere, kNowhere};
  const cv::Mat H = cv::findHomography(from, to, 0);
  if (H.empty()) return {kNowhere, kNowhere};
  Eigen::Matrix3d h;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) h(r, c) = H.at<double>(r, c);
  return (h * Eigen::Vector3d(i, j, 1)).hnormalized();
}

}  // namespace wagonsight

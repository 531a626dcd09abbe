#include "calibrate/findings.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <set>

namespace wagonsight {
namespace {

constexpr double kDegrees = 180 / std::numbers::pi;
// A corner of a printed board is found to a quarter of a pixel; from one pixel on something is
// wrong with the corners or the lens model.
constexpr double kRmsGood = 0.6, kRmsUsable = 1.2;  // px, length of a residual
// Of what the pose alone contributes at 1 m height; the sensors' own noise is 5 to 20 mm.
constexpr double kPoseGood = 0.005, kPoseUsable = 0.015;
constexpr double kCoverageGood = 0.6;
constexpr int kOverlapMin = 3, kViewsMin = 5;
constexpr double kFlatDeg = 65;

const ImagerSolution* find(const Solution& solution, const std::string& name) {
  for (const ImagerSolution& imager : solution.imagers)
    if (imager.name == name) return &imager;
  return nullptr;
}

const ViewSolution* worst_view(const Solution& solution, const std::string& imager) {
  const ViewSolution* worst = nullptr;
  for (const ViewSolution& view : solution.views)
    if (view.imager == imager && (worst == nullptr || view.rms_px > worst->rms_px)) worst = &view;
  return worst;
}

std::string name_of(const ViewSolution& view) {
  return view.image.empty() ? fmt::format("{} at {}", view.imager, view.pose) : view.image;
}

int view_count(const Solution& solution, const std::string& imager) {
  return static_cast<int>(
      std::count_if(solution.views.begin(), solution.views.end(),
                    [&](const ViewSolution& view) { return view.imager == imager; }));
}

void judge_fit(const Solution& solution, const ImagerSolution& imager, std::vector<Finding>& list) {
  if (imager.rms_px > kRmsGood) {
    const ViewSolution* worst = worst_view(solution, imager.name);
    std::string cause = "look at its worst views below for badly placed corners";
    if (worst != nullptr && worst->rms_px > 1.4 * imager.rms_px) {
      const double tilt = tilt_deg(solution, *worst);
      cause =
          fmt::format("its worst view is {} ({:.2f} px, the board tilted by {:.0f} degrees): {}",
                      name_of(*worst), worst->rms_px, tilt,
                      tilt > kFlatDeg ? "photograph the board there less edge on"
                                      : "click its corners again or leave the view out");
    } else if (imager.intrinsics_fixed) {
      cause = "its intrinsics are fixed; let them be refined (fix_intrinsics = false) and compare";
    }
    list.push_back({imager.rms_px > kRmsUsable ? Grade::kPoor : Grade::kUsable,
                    fmt::format("{} fits to {:.2f} px only.", imager.name, imager.rms_px), cause});
  }
  const int all = imager.corners + imager.rejected;
  if (all > 0 && imager.rejected > all / 20 + 3)
    list.push_back({Grade::kUsable,
                    fmt::format("{} of {}'s {} corners did not fit and were left out.",
                                imager.rejected, imager.name, all),
                    "see the red crosses below; wrong IDs are corrected on the click page"});
  if (imager.held_out_rms_px > 1.5 * imager.rms_px + 0.1)
    list.push_back(
        {Grade::kUsable,
         fmt::format(
             "{} predicts corners it has not seen to {:.2f} px, but fits its own to {:.2f}.",
             imager.name, imager.held_out_rms_px, imager.rms_px),
         "its views are too few or too alike: add some with the board tilted and near the edges"});
}

void judge_views(const Solution& solution, const ImagerSolution& imager,
                 std::vector<Finding>& list) {
  const int count = view_count(solution, imager.name);
  if (count < kViewsMin && !imager.intrinsics_fixed)
    list.push_back(
        {Grade::kUsable,
         fmt::format("{} has {} views for its intrinsics and its pose.", imager.name, count),
         fmt::format("photograph at least {} more", kViewsMin - count)});
  const double position = std::sqrt(imager.covariance.bottomRightCorner<3, 3>().trace());
  const double turn = std::sqrt(imager.covariance.topLeftCorner<3, 3>().trace()) * kDegrees;
  if (position > 0.010 || turn > 0.3)
    list.push_back({position > 0.030 || turn > 1.0 ? Grade::kPoor : Grade::kUsable,
                    fmt::format("{} is placed to {:.0f} mm and {:.2f} degrees only.", imager.name,
                                position * 1e3, turn),
                    "show it the board nearer, larger and at several tilts, together with its "
                    "neighbours"});
}

void judge_overlap(const Solution& solution, std::vector<Finding>& list) {
  const auto overlap = overlap_of(solution);
  for (std::size_t i = 0; i < overlap.size(); ++i) {
    int most = 0;
    std::size_t partner = i;
    for (std::size_t k = 0; k < overlap.size(); ++k)
      if (k != i && overlap[i][k] > most) most = overlap[i][k], partner = k;
    if (overlap.size() < 2 || most >= kOverlapMin) continue;
    list.push_back({Grade::kUsable,
                    fmt::format("{} hangs on {} board pose{} that another camera sees too{}.",
                                solution.imagers[i].name, most, most == 1 ? "" : "s",
                                most > 0 ? " (" + solution.imagers[partner].name + ")" : ""),
                    fmt::format("photograph the board at least {} more times where {} and a "
                                "neighbour both see it",
                                kOverlapMin - most, solution.imagers[i].name)});
  }
}

void judge_georeference(const Solution& solution, std::vector<Finding>& list) {
  if (!solution.georeference) {
    list.push_back({Grade::kGood,
                    "There is no georeference: the world is the reference board, z up.",
                    "measure three targets or more and run georeference"});
    return;
  }
  const Georeferenced& geo = *solution.georeference;
  if (std::abs(geo.X_WB.scale - 1) > 0.02)
    list.push_back(
        {Grade::kPoor,
         fmt::format("The targets say that the board is {:.1f}% {} than stated.",
                     std::abs(geo.X_WB.scale - 1) * 100, geo.X_WB.scale > 1 ? "larger" : "smaller"),
         "measure a square of the board and correct square_m"});
  for (std::size_t i = 0; i < geo.targets.size(); ++i)
    if (geo.residuals_m[i].norm() > 0.010)
      list.push_back({Grade::kUsable,
                      fmt::format("Target {} lies {:.0f} mm off.", geo.targets[i],
                                  geo.residuals_m[i].norm() * 1e3),
                      "check its measured place and its clicks"});
}

const char* grade_word(Grade grade) {
  return grade == Grade::kGood     ? "The calibration is good"
         : grade == Grade::kUsable ? "The calibration can be used, and could be better"
                                   : "The calibration is not good enough";
}

}  // namespace

std::vector<Coverage> coverage_of(const Solution& solution) {
  static const char* const kRowNames[] = {"upper", "middle", "lower"};
  static const char* const kColumnNames[] = {"left", "centre", "right"};
  std::vector<Coverage> all;
  for (const ImagerSolution& imager : solution.imagers) {
    Coverage coverage;
    coverage.imager = imager.name;
    int thirds[3][3] = {};
    for (const ViewSolution& view : solution.views) {
      if (view.imager != imager.name) continue;
      for (const auto& r : view.residuals) {
        if (!r.used) continue;
        const double x = std::clamp(r.pixel.x() / imager.camera.width, 0.0, 0.9999);
        const double y = std::clamp(r.pixel.y() / imager.camera.height, 0.0, 0.9999);
        ++coverage.counts[static_cast<int>(y * Coverage::kRows)]
                         [static_cast<int>(x * Coverage::kColumns)];
        ++thirds[static_cast<int>(3 * y)][static_cast<int>(3 * x)];
      }
    }
    int filled = 0, least = 1 << 30;
    for (const auto& row : coverage.counts)
      for (const int count : row) filled += count > 0 ? 1 : 0;
    for (int row = 0; row < 3; ++row)
      for (int column = 0; column < 3; ++column)
        if (thirds[row][column] < least) {
          least = thirds[row][column];
          coverage.emptiest = fmt::format("{} {}", kRowNames[row], kColumnNames[column]);
        }
    coverage.share = filled / static_cast<double>(Coverage::kRows * Coverage::kColumns);
    all.push_back(coverage);
  }
  return all;
}

std::vector<std::vector<int>> overlap_of(const Solution& solution) {
  std::map<std::string, std::set<std::string>> poses;
  for (const ViewSolution& view : solution.views) poses[view.imager].insert(view.pose);
  std::vector<std::vector<int>> shared(solution.imagers.size(),
                                       std::vector<int>(solution.imagers.size(), 0));
  for (std::size_t i = 0; i < solution.imagers.size(); ++i)
    for (std::size_t k = 0; k < solution.imagers.size(); ++k)
      for (const std::string& pose : poses[solution.imagers[i].name])
        shared[i][k] += poses[solution.imagers[k].name].contains(pose) ? 1 : 0;
  return shared;
}

double tilt_deg(const Solution& solution, const ViewSolution& view) {
  const ImagerSolution* imager = find(solution, view.imager);
  const auto pose =
      std::find_if(solution.poses.begin(), solution.poses.end(),
                   [&](const BoardPose& candidate) { return candidate.name == view.pose; });
  if (imager == nullptr || pose == solution.poses.end()) return 0;
  const Rigid X_SP = imager->X_BS.inverse() * pose->X_BP;
  const Eigen::Vector3d middle =
      X_SP * (solution.board.point(solution.board.corner_count() - 1) / 2);
  const Eigen::Vector3d normal = X_SP.rotation * Eigen::Vector3d::UnitZ();
  return std::acos(std::min(1.0, std::abs(normal.dot(middle.normalized())))) * kDegrees;
}

Findings judge(const Solution& solution, const UncertaintyMap& map) {
  Findings findings;
  for (const ImagerSolution& imager : solution.imagers) {
    judge_fit(solution, imager, findings.list);
    judge_views(solution, imager, findings.list);
  }
  for (const Coverage& coverage : coverage_of(solution))
    if (coverage.share < kCoverageGood) {
      const ImagerSolution* imager = find(solution, coverage.imager);
      const bool matters = imager != nullptr && !imager->intrinsics_fixed;
      findings.list.push_back(
          {matters ? Grade::kUsable : Grade::kGood,
           fmt::format("The board covered {:.0f}% of {}'s image.", coverage.share * 100,
                       coverage.imager),
           fmt::format("show it the board in the {} of its image", coverage.emptiest)});
    }
  judge_overlap(solution, findings.list);
  judge_georeference(solution, findings.list);
  const double pose = map.median_pose_m(), total = map.median_total_m();
  if (pose > kPoseGood)
    findings.list.push_back(
        {pose > kPoseUsable ? Grade::kPoor : Grade::kUsable,
         fmt::format("The cameras' poses alone move a point in the wagon by {:.0f} mm.",
                     pose * 1e3),
         "see the map below: photograph more boards where it is red"});
  std::stable_sort(findings.list.begin(), findings.list.end(),
                   [](const Finding& a, const Finding& b) { return a.grade > b.grade; });
  for (Finding& finding : findings.list) {
    char& first = finding.what_to_do.front();
    if (first >= 'a' && first <= 'z') first = static_cast<char>(first - 'a' + 'A');
  }
  for (const Finding& finding : findings.list)
    findings.grade = std::max(findings.grade, finding.grade);
  double worst = 0;
  std::string worst_name;
  for (const ImagerSolution& imager : solution.imagers)
    if (imager.rms_px > worst) worst = imager.rms_px, worst_name = imager.name;
  findings.headline = grade_word(findings.grade);
  findings.sentence = fmt::format(
      "{} camera{} see{} {} board pose{}; the worst of them ({}) fits to "
      "{:.2f} px.",
      solution.imagers.size(), solution.imagers.size() == 1 ? "" : "s",
      solution.imagers.size() == 1 ? "s" : "", solution.poses.size(),
      solution.poses.size() == 1 ? "" : "s", worst_name, worst);
  if (total > 0)
    findings.sentence += fmt::format(
        " {} a point is placed to within {:.0f} mm (one sigma, and better in half of what is "
        "seen); "
        "the calibration's share of that is {:.1f} mm.",
        map.height_m > 0 ? fmt::format("{:.0f} m above the floor", map.height_m)
                         : "At the board's height",
        total * 1e3, pose * 1e3);
  return findings;
}

}  // namespace wagonsight

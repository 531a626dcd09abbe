#include "calibrate/georeference.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <set>

#include "calibrate/reprojection.h"

namespace wagonsight {
namespace {

using Json = nlohmann::json;
using calibration::skew;

// Index of an imager, or -1.
int find_imager(const Solution& solution, const std::string& name) {
  for (std::size_t i = 0; i < solution.imagers.size(); ++i)
    if (solution.imagers[i].name == name) return static_cast<int>(i);
  return -1;
}

Result<Eigen::VectorXd> parse_numbers(const Json& json, std::size_t count,
                                      const std::string& where) {
  if (!json.is_array() || json.size() != count)
    return fail(fmt::format("{} must be {} numbers", where, count));
  Eigen::VectorXd numbers(static_cast<Eigen::Index>(count));
  for (std::size_t i = 0; i < count; ++i) {
    if (!json[i].is_number() || !std::isfinite(json[i].get<double>()))
      return fail(fmt::format("{} must be {} finite numbers", where, count));
    numbers[static_cast<Eigen::Index>(i)] = json[i].get<double>();
  }
  return numbers;
}

// [longer semi-axis, shorter, angle] about the sighting's pixel, or with [.., x, y] about that one.
Result<BallOutline> parse_outline(const Json& json, const Eigen::Vector2d& pixel,
                                  const std::string& where) {
  const bool has_centre = json.is_array() && json.size() == 5;
  const auto numbers = parse_numbers(json, has_centre ? 5 : 3, where + ": an \"outline\"");
  if (!numbers) return fail(numbers.error().message);
  if (!((*numbers)[0] > 0 && (*numbers)[1] > 0))
    return fail(where + ": an \"outline\" must have semi-axes above zero");
  BallOutline outline;
  outline.centre = has_centre ? Eigen::Vector2d(numbers->tail<2>()) : pixel;
  outline.semi_axes_px = numbers->head<2>();
  outline.angle = (*numbers)[2];
  return outline;
}

Result<Target::Sighting> parse_sighting(const Json& item, const std::string& where) {
  auto pixel = parse_numbers(Json::array({item.value("x", Json()), item.value("y", Json())}), 2,
                             where + ": a sighting's x and y");
  if (!pixel) return fail(pixel.error().message);
  Target::Sighting sighting{item["sensor"].get<std::string>(), *pixel, {}, {}};
  if (item.contains("image") && item["image"].is_string())
    sighting.image = item["image"].get<std::string>();
  if (item.contains("outline")) {
    auto outline = parse_outline(item["outline"], sighting.pixel, where);
    if (!outline) return fail(outline.error().message);
    sighting.outline = *outline;
  }
  return sighting;
}

Result<Target> parse_target(const Json& json, std::size_t index, std::string_view file) {
  std::string where = fmt::format("{}: target {}", file, index);
  if (!json.is_object() || !json.contains("id") || !json["id"].is_string())
    return fail(where + " needs an \"id\"");
  Target target;
  target.id = json["id"].get<std::string>();
  where += fmt::format(" ({})", target.id);
  if (json.contains("world")) {
    auto world = parse_numbers(json["world"], 3, where + ": \"world\"");
    if (!world) return fail(world.error().message);
    target.world = Eigen::Vector3d(*world);
  }
  if (json.contains("marker") && json["marker"].is_string())
    target.marker = json["marker"].get<std::string>();
  if (json.contains("radius_m")) {
    auto radius = parse_numbers(Json::array({json["radius_m"]}), 1, where + ": \"radius_m\"");
    if (!radius) return fail(radius.error().message);
    if (!((*radius)[0] > 0)) return fail(where + ": \"radius_m\" must be above zero");
    target.radius_m = (*radius)[0];
  }
  for (const Json& item : json.value("seen", Json::array())) {
    if (!item.is_object() || !item.contains("sensor") || !item["sensor"].is_string())
      return fail(where + ": a sighting needs a \"sensor\"");
    if (item.contains("center")) {
      auto centre = parse_numbers(item["center"], 3, where + ": a sphere's \"center\"");
      if (!centre) return fail(centre.error().message);
      auto sigma = parse_numbers(Json::array({item.value("sigma_m", Json(0.003))}), 1,
                                 where + ": a sphere's \"sigma_m\"");
      if (!sigma) return fail(sigma.error().message);
      if (!((*sigma)[0] > 0)) return fail(where + ": a sphere's \"sigma_m\" must be above zero");
      target.spheres.push_back({item["sensor"].get<std::string>(), *centre, (*sigma)[0]});
      continue;
    }
    auto sighting = parse_sighting(item, where);
    if (!sighting) return fail(sighting.error().message);
    target.seen.push_back(std::move(*sighting));
  }
  return target;
}

Similarity umeyama(const std::vector<Eigen::Vector3d>& from,
                   const std::vector<Eigen::Vector3d>& to) {
  const auto n = static_cast<Eigen::Index>(from.size());
  Eigen::Matrix3Xd source(3, n), target(3, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    source.col(i) = from[static_cast<std::size_t>(i)];
    target.col(i) = to[static_cast<std::size_t>(i)];
  }
  const Eigen::Matrix4d M = Eigen::umeyama(source, target, true);
  Similarity X;
  X.scale = std::cbrt(M.topLeftCorner<3, 3>().determinant());
  X.rotation = Eigen::Quaterniond(Eigen::Matrix3d(M.topLeftCorner<3, 3>() / X.scale)).normalized();
  X.position = M.topRightCorner<3, 1>();
  return X;
}

// Reference coordinates are taken as exact to this; a tracked ball's centre is.
constexpr double kReferenceSigma = 0.0005;

}  // namespace

Result<std::vector<Target>> parse_targets(std::string_view text, std::string_view file) {
  const Json root = Json::parse(text, nullptr, false);
  if (root.is_discarded() || !root.is_object() || !root.contains("targets") ||
      !root["targets"].is_array())
    return fail(fmt::format("{}: this is not a JSON object with \"targets\"", file));
  std::vector<Target> targets;
  std::set<std::string> ids;
  for (std::size_t i = 0; i < root["targets"].size(); ++i) {
    auto target = parse_target(root["targets"][i], i, file);
    if (!target) return fail(target.error().message);
    if (!ids.insert(target->id).second)
      return fail(fmt::format("{}: target {} stands there twice", file, target->id));
    targets.push_back(std::move(*target));
  }
  return targets;
}

Result<void> take_markers(const Markers& markers, std::vector<Target>& targets) {
  for (Target& target : targets) {
    if (target.world) continue;
    const std::string& name = target.marker.empty() ? target.id : target.marker;
    const auto marker = markers.find(name);
    if (marker == markers.end())
      return fail(
          fmt::format("target {}: the tracker saw no marker \"{}\"; name its marker or give its "
                      "coordinates",
                      target.id, name));
    target.world = marker->second;
  }
  return {};
}

namespace {

// What one imager says of a target: a pixel, or a point from depth (in B, with its sigma).
struct Evidence {
  int imager = 0;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  // Of the pixel's ray, in B.
  Eigen::Vector3d origin = Eigen::Vector3d::Zero(), direction = Eigen::Vector3d::Zero();
  bool is_point = false;
  Eigen::Vector3d p_B = Eigen::Vector3d::Zero();
  double sigma_m = 0;
};

Result<std::vector<Evidence>> gather(const Solution& solution, const Target& target) {
  std::vector<Evidence> all;
  const auto unknown = [&](const std::string& name) {
    return fail(fmt::format("target {}: \"{}\" is not in the solution", target.id, name));
  };
  for (const auto& sighting : target.seen) {
    Evidence evidence;
    evidence.imager = find_imager(solution, sighting.imager);
    if (evidence.imager < 0) return unknown(sighting.imager);
    const ImagerSolution& imager = solution.imagers[static_cast<std::size_t>(evidence.imager)];
    const auto ray = ray_through(imager.camera, sighting.pixel);
    if (!ray)
      return fail(fmt::format("target {}: its pixel in {} lies where the lens is not invertible",
                              target.id, sighting.imager));
    evidence.pixel = sighting.pixel;
    evidence.origin = imager.X_BS.position;
    evidence.direction = (imager.X_BS.rotation * *ray).normalized();
    all.push_back(evidence);
  }
  for (const auto& sphere : target.spheres) {
    Evidence evidence;
    evidence.imager = find_imager(solution, sphere.imager);
    if (evidence.imager < 0) return unknown(sphere.imager);
    evidence.is_point = true;
    evidence.p_B =
        solution.imagers[static_cast<std::size_t>(evidence.imager)].measuring_X_BS() * sphere.p_S;
    evidence.sigma_m = sphere.sigma_m;
    all.push_back(evidence);
  }
  constexpr double kAngleMin = 0.5 * std::numbers::pi / 180;
  double angle = 0;
  for (const Evidence& a : all)
    for (const Evidence& b : all)
      if (!a.is_point && !b.is_point)
        angle = std::max(angle, std::asin(std::min(1.0, a.direction.cross(b.direction).norm())));
  if (target.spheres.empty() && angle < kAngleMin)
    return fail(
        fmt::format("target {}: it must be seen by at least two imagers from directions more "
                    "than 0.5 degrees apart",
                    target.id));
  return all;
}

Eigen::Vector3d midpoint(const std::vector<Evidence>& all) {
  Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  for (const Evidence& evidence : all) {
    Eigen::Matrix3d across = Eigen::Matrix3d::Identity();
    if (!evidence.is_point) across -= evidence.direction * evidence.direction.transpose();
    A += across;
    b += across * (evidence.is_point ? evidence.p_B : evidence.origin);
  }
  return A.ldlt().solve(b);
}

// Information of one piece of evidence at p_B and its pull; false behind the imager.
bool weigh(const Solution& solution, const Evidence& evidence, const Eigen::Vector3d& p_B,
           Eigen::Matrix3d& information, Eigen::Vector3d& pull) {
  if (evidence.is_point) {
    const double weight = 1 / (evidence.sigma_m * evidence.sigma_m);
    information = weight * Eigen::Matrix3d::Identity();
    pull = weight * (evidence.p_B - p_B);
    return true;
  }
  const ImagerSolution& imager = solution.imagers[static_cast<std::size_t>(evidence.imager)];
  const auto X_BS = calibration::to_block(imager.X_BS.inverse()),
             here = calibration::to_block(Rigid{Eigen::Quaterniond::Identity(), p_B});
  const auto k = calibration::to_block(imager.camera);
  Eigen::Vector2d pixel;
  calibration::PixelJacobians J;
  if (!calibration::ViewProjection(X_BS.data(), here.data(), k.data())
           .project(Eigen::Vector3d::Zero(), pixel, &J))
    return false;
  constexpr double kSigmaMin_px = 0.05;
  const double sigma = std::max(solution.sigma0_px, kSigmaMin_px);
  const Eigen::Matrix<double, 2, 3> by_point = J.X_BP.rightCols<3>() / sigma;
  information = by_point.transpose() * by_point;
  pull = by_point.transpose() * (evidence.pixel - pixel) / sigma;
  return true;
}

// Of the imagers' X_BS together; blocks alone where a solution carries no joint covariance.
Eigen::MatrixXd joint_covariance(const Solution& solution) {
  if (solution.joint_covariance.size() > 0) return solution.joint_covariance;
  const auto rows = 6 * static_cast<Eigen::Index>(solution.imagers.size());
  Eigen::MatrixXd C = Eigen::MatrixXd::Zero(rows, rows);
  for (std::size_t i = 0; i < solution.imagers.size(); ++i)
    C.block<6, 6>(6 * static_cast<Eigen::Index>(i), 6 * static_cast<Eigen::Index>(i)) =
        solution.imagers[i].covariance;
  return C;
}

}  // namespace

Result<Triangulated> triangulate(const Solution& solution, const Target& target) {
  const auto gathered = gather(solution, target);
  if (!gathered) return fail(gathered.error().message);
  Triangulated result;
  result.p_B = midpoint(*gathered);
  Eigen::Matrix3d N, information;
  Eigen::Vector3d pull;
  for (int iteration = 0; iteration < 10; ++iteration) {
    N.setZero();
    Eigen::Vector3d g = Eigen::Vector3d::Zero();
    for (const Evidence& evidence : *gathered) {
      if (!weigh(solution, evidence, result.p_B, information, pull))
        return fail(fmt::format("target {}: its rays meet behind {}", target.id,
                                solution.imagers[static_cast<std::size_t>(evidence.imager)].name));
      N += information;
      g += pull;
    }
    const Eigen::Vector3d step = N.ldlt().solve(g);
    result.p_B += step;
    if (step.norm() < 1e-12) break;
  }
  result.covariance = N.inverse();
  result.by_imagers =
      Eigen::Matrix3Xd::Zero(3, 6 * static_cast<Eigen::Index>(solution.imagers.size()));
  for (const Evidence& evidence : *gathered) {
    if (!weigh(solution, evidence, result.p_B, information, pull)) continue;
    // An imager turned by r and moved by t sees the point as if that had moved by
    // -(r x (p - origin)) - t.
    const Rigid& X_BS = solution.imagers[static_cast<std::size_t>(evidence.imager)].X_BS;
    const Eigen::Matrix3d share = result.covariance * information;
    const auto at = 6 * static_cast<Eigen::Index>(evidence.imager);
    result.by_imagers.middleCols<3>(at) -= share * skew(result.p_B - X_BS.position);
    result.by_imagers.middleCols<3>(at + 3) += share;
  }
  return result;
}

namespace {

// The targets in both frames and the covariance of all p_B together.
struct Correspondences {
  std::vector<Eigen::Vector3d> p_B, p_W;
  Eigen::MatrixXd covariance;
};

Result<Correspondences> correspond(const std::vector<Target>& targets, const Solution& solution) {
  Correspondences pairs;
  const auto n = static_cast<Eigen::Index>(targets.size());
  pairs.covariance = Eigen::MatrixXd::Zero(3 * n, 3 * n);
  Eigen::MatrixXd by_imagers(3 * n, 6 * static_cast<Eigen::Index>(solution.imagers.size()));
  for (Eigen::Index i = 0; i < n; ++i) {
    const Target& target = targets[static_cast<std::size_t>(i)];
    if (!target.world)
      return fail(
          fmt::format("target {}: it has no \"world\" coordinates; give them or the "
                      "tracker's file",
                      target.id));
    auto point = triangulate(solution, target);
    if (!point) return fail(point.error().message);
    pairs.p_B.push_back(point->p_B);
    pairs.p_W.push_back(*target.world);
    pairs.covariance.block<3, 3>(3 * i, 3 * i) = point->covariance;
    by_imagers.middleRows<3>(3 * i) = point->by_imagers;
  }
  pairs.covariance += by_imagers * joint_covariance(solution) * by_imagers.transpose();
  return pairs;
}

bool on_one_line(const std::vector<Eigen::Vector3d>& points) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const auto& p : points) mean += p / static_cast<double>(points.size());
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const auto& p : points) scatter += (p - mean) * (p - mean).transpose();
  const Eigen::Vector3d spread =
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(scatter).eigenvalues();
  constexpr double kCollinear = 1e-3;  // squared ratio of the second extent to the first
  return spread[1] < kCollinear * spread[2];
}

// One Gauss-Newton step's equations on rotation (left, in W), position and scale.
struct Equations {
  Eigen::Matrix<double, 7, 7> N;
  Eigen::Matrix<double, 7, 1> g;
  double chi2 = 0;
};

Equations linearise(const Correspondences& pairs, const Similarity& X) {
  const auto n = static_cast<Eigen::Index>(pairs.p_B.size());
  Eigen::MatrixXd J(3 * n, 7), turn = Eigen::MatrixXd::Zero(3 * n, 3 * n);
  Eigen::VectorXd residual(3 * n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto& p_B = pairs.p_B[static_cast<std::size_t>(i)];
    const Eigen::Vector3d turned = X.rotation * p_B;
    J.block<3, 3>(3 * i, 0) = -skew(X.scale * turned);
    J.block<3, 3>(3 * i, 3).setIdentity();
    J.block<3, 1>(3 * i, 6) = turned;
    turn.block<3, 3>(3 * i, 3 * i) = X.scale * X.rotation.toRotationMatrix();
    residual.segment<3>(3 * i) = pairs.p_W[static_cast<std::size_t>(i)] - X * p_B;
  }
  Eigen::MatrixXd C = turn * pairs.covariance * turn.transpose();
  C.diagonal().array() += kReferenceSigma * kReferenceSigma;
  const Eigen::LDLT<Eigen::MatrixXd> weight(C);
  return {J.transpose() * weight.solve(J), J.transpose() * weight.solve(residual),
          residual.dot(weight.solve(residual))};
}

}  // namespace

Result<void> georeference(const std::vector<Target>& targets, Solution& solution) {
  if (targets.size() < 3)
    return fail(
        fmt::format("{} targets cannot fix the seven parameters of the georeference; measure "
                    "at least three that are not on one line",
                    targets.size()));
  const auto pairs = correspond(targets, solution);
  if (!pairs) return fail(pairs.error().message);
  if (on_one_line(pairs->p_W) || on_one_line(pairs->p_B))
    return fail(
        "the targets lie on one line and leave the turn about it free; move one of them aside");
  Similarity X = umeyama(pairs->p_B, pairs->p_W);
  Equations equations;
  for (int iteration = 0; iteration < 20; ++iteration) {
    equations = linearise(*pairs, X);
    const Eigen::Matrix<double, 7, 1> step = equations.N.ldlt().solve(equations.g);
    const Rigid turn = calibration::to_rigid(step.head<3>(), Eigen::Vector3d::Zero());
    X.rotation = (turn.rotation * X.rotation).normalized();
    X.position += step.segment<3>(3);
    X.scale += step[6];
    if (step.norm() < 1e-13) break;
  }
  equations = linearise(*pairs, X);
  Georeferenced result;
  result.X_WB = X;
  for (std::size_t i = 0; i < targets.size(); ++i) {
    result.residuals_m.emplace_back(pairs->p_W[i] - X * pairs->p_B[i]);
    result.targets.push_back(targets[i].id);
  }
  // Residuals larger than the covariances explain widen the sigmas; smaller ones do not narrow
  // them.
  const double freedom = 3.0 * static_cast<double>(targets.size()) - 7.0;
  result.covariance = equations.N.inverse() * std::max(1.0, equations.chi2 / freedom);
  result.covariance = (result.covariance + result.covariance.transpose()).eval() / 2;
  solution.georeference = std::move(result);
  return {};
}

}  // namespace wagonsight

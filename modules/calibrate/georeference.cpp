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

const ImagerSolution* find_imager(const Solution& solution, const std::string& name) {
  for (const ImagerSolution& imager : solution.imagers)
    if (imager.name == name) return &imager;
  return nullptr;
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

Result<Target> parse_target(const Json& json, std::size_t index, std::string_view file) {
  std::string where = fmt::format("{}: target {}", file, index);
  if (!json.is_object() || !json.contains("id") || !json["id"].is_string())
    return fail(where + " needs an \"id\"");
  Target target;
  target.id = json["id"].get<std::string>();
  where += fmt::format(" ({})", target.id);
  auto world = parse_numbers(json.value("world", Json()), 3, where + ": \"world\"");
  if (!world) return fail(world.error().message);
  target.world = *world;
  for (const Json& item : json.value("seen", Json::array())) {
    if (!item.is_object() || !item.contains("sensor") || !item["sensor"].is_string())
      return fail(where + ": a sighting needs a \"sensor\"");
    auto pixel = parse_numbers(Json::array({item.value("x", Json()), item.value("y", Json())}), 2,
                               where + ": a sighting's x and y");
    if (!pixel) return fail(pixel.error().message);
    target.seen.push_back({item["sensor"].get<std::string>(), *pixel});
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

Result<Triangulated> triangulate(const Solution& solution, const Target& target) {
  struct Ray {
    const ImagerSolution* imager;
    Eigen::Vector2d pixel;
    Eigen::Vector3d origin, direction;
  };
  std::vector<Ray> rays;
  for (const auto& sighting : target.seen) {
    const ImagerSolution* imager = find_imager(solution, sighting.imager);
    if (imager == nullptr)
      return fail(
          fmt::format("target {}: \"{}\" is not in the solution", target.id, sighting.imager));
    const auto ray = ray_through(imager->camera, sighting.pixel);
    if (!ray)
      return fail(fmt::format("target {}: its pixel in {} lies where the lens is not invertible",
                              target.id, sighting.imager));
    rays.push_back({imager, sighting.pixel, imager->X_BS.position,
                    (imager->X_BS.rotation * *ray).normalized()});
  }
  double angle = 0;
  for (const Ray& a : rays)
    for (const Ray& b : rays)
      angle = std::max(angle, std::asin(std::min(1.0, a.direction.cross(b.direction).norm())));
  constexpr double kAngleMin = 0.5 * std::numbers::pi / 180;
  if (rays.size() < 2 || angle < kAngleMin)
    return fail(
        fmt::format("target {}: it must be seen by at least two imagers from directions more "
                    "than 0.5 degrees apart",
                    target.id));
  Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  for (const Ray& ray : rays) {
    const Eigen::Matrix3d across =
        Eigen::Matrix3d::Identity() - ray.direction * ray.direction.transpose();
    A += across;
    b += across * ray.origin;
  }
  Triangulated result;
  result.p_B = A.ldlt().solve(b);
  Eigen::Matrix3d N;
  for (int iteration = 0; iteration < 10; ++iteration) {
    N.setZero();
    Eigen::Vector3d g = Eigen::Vector3d::Zero();
    for (const Ray& ray : rays) {
      const Rigid X_SB = ray.imager->X_BS.inverse();
      Eigen::Matrix<double, 2, 3> J;
      const auto at = project(ray.imager->camera, X_SB * result.p_B);
      if (!at)
        return fail(fmt::format("target {}: its rays meet behind {}", target.id, ray.imager->name));
      constexpr double kStep = 1e-6;
      for (int k = 0; k < 3; ++k) {
        const Eigen::Vector3d moved = result.p_B + kStep * Eigen::Vector3d::Unit(k);
        J.col(k) = (project(ray.imager->camera, X_SB * moved).value_or(*at) - *at) / kStep;
      }
      N += J.transpose() * J;
      g += J.transpose() * (ray.pixel - *at);
    }
    const Eigen::Vector3d step = N.ldlt().solve(g);
    result.p_B += step;
    if (step.norm() < 1e-12) break;
  }
  const double sigma = std::max(solution.sigma0_px, 0.05);
  result.covariance = sigma * sigma * N.inverse();
  return result;
}

Result<void> georeference(const std::vector<Target>& targets, Solution& solution) {
  if (targets.size() < 3)
    return fail(
        fmt::format("{} targets cannot fix the seven parameters of the georeference; measure "
                    "at least three that are not on one line",
                    targets.size()));
  std::vector<Eigen::Vector3d> p_B, p_W;
  std::vector<Eigen::Matrix3d> covariance;
  for (const Target& target : targets) {
    auto point = triangulate(solution, target);
    if (!point) return fail(point.error().message);
    p_B.push_back(point->p_B);
    p_W.push_back(target.world);
    covariance.push_back(point->covariance);
  }
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const auto& p : p_W) mean += p / static_cast<double>(p_W.size());
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const auto& p : p_W) scatter += (p - mean) * (p - mean).transpose();
  const Eigen::Vector3d spread =
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(scatter).eigenvalues();
  constexpr double kCollinear = 1e-3;  // squared ratio of the second extent to the first
  if (spread[1] < kCollinear * spread[2])
    return fail(
        "the targets lie on one line and leave the turn about it free; move one of them aside");
  Similarity X = umeyama(p_B, p_W);
  // Gauss-Newton on rotation (left, in W), position and scale with the targets' own covariances.
  Eigen::Matrix<double, 7, 7> N;
  for (int iteration = 0; iteration < 20; ++iteration) {
    N.setZero();
    Eigen::Matrix<double, 7, 1> g = Eigen::Matrix<double, 7, 1>::Zero();
    for (std::size_t i = 0; i < p_B.size(); ++i) {
      const Eigen::Vector3d turned = X.rotation * p_B[i];
      Eigen::Matrix<double, 3, 7> J;
      J.leftCols<3>() = -skew(X.scale * turned);
      J.middleCols<3>(3).setIdentity();
      J.col(6) = turned;
      const Eigen::Matrix3d R = X.rotation.toRotationMatrix();
      const Eigen::Matrix3d C = X.scale * X.scale * R * covariance[i] * R.transpose() +
                                kReferenceSigma * kReferenceSigma * Eigen::Matrix3d::Identity();
      const Eigen::Matrix3d W = C.inverse();
      N += J.transpose() * W * J;
      g += J.transpose() * W * (p_W[i] - X * p_B[i]);
    }
    const Eigen::Matrix<double, 7, 1> step = N.ldlt().solve(g);
    const Eigen::Vector3d turn = step.head<3>();
    if (turn.norm() > 0)
      X.rotation = (Eigen::AngleAxisd(turn.norm(), turn.normalized()) * X.rotation).normalized();
    X.position += step.segment<3>(3);
    X.scale += step[6];
    if (step.norm() < 1e-13) break;
  }
  Georeferenced result;
  result.X_WB = X;
  double chi2 = 0;
  for (std::size_t i = 0; i < p_B.size(); ++i) {
    const Eigen::Vector3d residual = p_W[i] - X * p_B[i];
    const Eigen::Matrix3d R = X.rotation.toRotationMatrix();
    const Eigen::Matrix3d C = X.scale * X.scale * R * covariance[i] * R.transpose() +
                              kReferenceSigma * kReferenceSigma * Eigen::Matrix3d::Identity();
    chi2 += residual.dot(C.ldlt().solve(residual));
    result.residuals_m.push_back(residual);
    result.targets.push_back(targets[i].id);
  }
  // Residuals larger than the covariances explain widen the sigmas; smaller ones do not narrow
  // them.
  const double freedom = 3.0 * static_cast<double>(p_B.size()) - 7.0;
  result.covariance = N.inverse() * std::max(1.0, chi2 / freedom);
  solution.georeference = std::move(result);
  return {};
}

}  // namespace wagonsight

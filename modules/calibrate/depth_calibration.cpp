#include "calibrate/depth_calibration.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "calibrate/reprojection.h"

namespace wagonsight {
namespace {

using calibration::left_jacobian;
using calibration::skew;
using Vector10 = Eigen::Matrix<double, 10, 1>;
using Matrix10 = Eigen::Matrix<double, 10, 10>;

// Order of the parameters: rotation of X_CS (small, in C), its position, scale, offset, pixel
// offset u, v.
constexpr int kScale = 6, kOffset = 7, kPixelU = 8;

Vector10 prior_sigmas() {
  Vector10 sigmas;
  sigmas << Eigen::Vector3d::Constant(kDepthPriorRotation_rad),
      Eigen::Vector3d::Constant(kDepthPriorPosition_m), kDepthPriorScale, kDepthPriorOffset_m,
      kDepthPriorPixels, kDepthPriorPixels;
  return sigmas;
}

// The board's plane in one depth image: its pose in the imager's frame C and how well that is
// known (information of a small rotation and shift in C).
struct Plane {
  const DepthView* view = nullptr;
  Rigid X_CP;
  Matrix6 information = Matrix6::Zero();
};

// From the corners of the view alone, so that it is honest about a board that was seen badly.
Matrix6 corner_information(const Solution& solution, const ImagerSolution& imager,
                           const ViewSolution& view, const Rigid& X_CP) {
  const auto X = calibration::to_block(X_CP), still = calibration::to_block(Rigid{});
  const auto k = calibration::to_block(imager.camera);
  const calibration::ViewProjection projection(X.data(), still.data(), k.data());
  Matrix6 to_small = Matrix6::Identity();
  to_small.topLeftCorner<3, 3>() = left_jacobian(calibration::rotation_vector(X_CP)).inverse();
  const double sigma = std::max(imager.rms_px_per_coordinate, 0.05);
  Matrix6 information = Matrix6::Zero();
  for (const auto& seen : view.residuals) {
    if (!seen.used) continue;
    Eigen::Vector2d pixel;
    calibration::PixelJacobians J;
    if (!projection.project(solution.board.point(seen.id), pixel, &J)) continue;
    const Eigen::Matrix<double, 2, 6> small = J.X_SB * to_small / sigma;
    // X_SB is the block (rotation, position) of X_CP here; a small rotation turns the position too.
    Eigen::Matrix<double, 2, 6> moved = small;
    moved.leftCols<3>() -= small.rightCols<3>() * skew(X_CP.position);
    information += moved.transpose() * moved;
  }
  return information;
}

class DepthFit {
 public:
  DepthFit(const Solution& solution, const ImagerSolution& imager, const DepthCameraSpec& spec,
           const DepthOptions& options)
      : board_(solution.board), options_(options) {
    result_.from_infrared = spec.from_infrared;
    result_.camera = spec.from_infrared ? imager.camera : spec.camera;
    if (!spec.from_infrared) result_.X_CS = spec.X_CS;
    start_ = result_;
  }

  void add(const Plane& plane) { planes_.push_back(plane); }

  // Nothing when no board gives a reading.
  std::optional<DepthCalibration> fit() {
    constexpr int kRounds = 12;
    for (int round = 0; round < kRounds; ++round) {
      // First wide, for the start may be off by the prior; then by the noise.
      accumulate(round < 3 ? 0 : options_.gate_sigmas);
      if (readings_ == 0) return std::nullopt;
      const Vector10 step = solve_step();
      apply(step);
      if (round > 3 && step.norm() < 1e-9) break;
    }
    accumulate(options_.gate_sigmas);
    if (readings_ == 0) return std::nullopt;
    solve_step();
    result_.covariance = covariance_;
    result_.readings = readings_;
    result_.rms_m = std::sqrt(squares_m2_ / readings_);
    result_.mean_depth_m = depth_sum_m_ / readings_;
    return result_;
  }

 private:
  bool is_active(int parameter) const {
    return result_.from_infrared ? parameter >= kScale : parameter < kPixelU;
  }
  struct Expected;
  void accumulate(double gate_sigmas);
  std::optional<Expected> expect(const Plane& plane, int u, int v) const;
  Vector10 derivative(const Expected& expected, const Eigen::Vector3d& normal, int u, int v) const;
  void add_plane(const Plane& plane, double gate_sigmas);
  Vector10 deviation_from_start() const;
  Vector10 solve_step();
  void apply(const Vector10& step);

  Board board_;
  DepthOptions options_;
  DepthCalibration start_, result_;
  std::vector<Plane> planes_;
  Matrix10 N_;
  Vector10 g_;
  Matrix10 covariance_;
  double weighted_squares_ = 0, squares_m2_ = 0, depth_sum_m_ = 0;
  int readings_ = 0;
};

void DepthFit::accumulate(double gate_sigmas) {
  N_.setZero();
  g_.setZero();
  weighted_squares_ = squares_m2_ = depth_sum_m_ = 0;
  readings_ = result_.views = 0;
  for (const Plane& plane : planes_) {
    const int before = readings_;
    add_plane(plane, gate_sigmas);
    if (readings_ > before) ++result_.views;
  }
}

// Where on the plane the ray of one pixel ends, and what its reading should be there.
struct DepthFit::Expected {
  Eigen::Vector3d turned, p_C;  // the ray (z = 1 in S) and the point, both in C's axes
  double along = 0;             // metres along the plane's normal for a metre of depth
  double z = 0, raw = 0;        // depth, and the reading that the correction makes of it
};

std::optional<DepthFit::Expected> DepthFit::expect(const Plane& plane, int u, int v) const {
  const auto ray = ray_through(result_.camera, Eigen::Vector2d(u, v));
  if (!ray) return std::nullopt;
  const Eigen::Vector3d normal = plane.X_CP.rotation * Eigen::Vector3d::UnitZ();
  Expected expected;
  expected.turned = result_.X_CS.rotation * *ray;
  expected.along = normal.dot(expected.turned);
  constexpr double kAlongMin = 0.05;  // flatter than three degrees
  if (std::abs(expected.along) < kAlongMin) return std::nullopt;
  expected.z = normal.dot(plane.X_CP.position - result_.X_CS.position) / expected.along;
  expected.raw = (expected.z - result_.offset_m) / result_.scale;
  expected.p_C = expected.z * expected.turned + result_.X_CS.position;
  if (!(expected.raw > 0)) return std::nullopt;
  // Inside of the outer squares, a third of a square away from the board's edge.
  constexpr double kMargin = 0.67;
  const Eigen::Vector3d p_P = plane.X_CP.inverse() * expected.p_C;
  const Eigen::Vector2d squares = p_P.head<2>() / board_.square_m;
  if (squares.x() < -kMargin || squares.y() < -kMargin ||
      squares.x() > board_.columns - 1 + kMargin || squares.y() > board_.rows - 1 + kMargin)
    return std::nullopt;
  return expected;
}

// Of a reading's distance from the plane by the parameters.
Vector10 DepthFit::derivative(const Expected& expected, const Eigen::Vector3d& normal, int u,
                              int v) const {
  Vector10 J = Vector10::Zero();
  J.head<3>() = (expected.z * expected.turned).cross(normal);
  J.segment<3>(3) = normal;
  J[kScale] = expected.raw * expected.along;
  J[kOffset] = expected.along;
  if (result_.from_infrared)
    for (int k = 0; k < 2; ++k) {
      // The camera's centre moves against the offset: a ray's change with its pixel.
      const auto beside =
          ray_through(result_.camera, Eigen::Vector2d(u, v) + 0.5 * Eigen::Vector2d::Unit(k));
      if (beside)
        J[kPixelU + k] =
            expected.z * normal.dot(result_.X_CS.rotation * *beside - expected.turned) / 0.5;
    }
  for (int k = 0; k < 10; ++k)
    if (!is_active(k)) J[k] = 0;
  return J;
}

// One board: its readings' normal equations, its own pose eliminated (Schur complement). Weights,
// derivatives and the choice of pixels depend on the reading that is expected, never on the noisy
// one: a reading that is too short by chance would weigh more (a Kinect's noise grows with the
// square of the distance) and pull all boards nearer.
void DepthFit::add_plane(const Plane& plane, double gate_sigmas) {
  const Eigen::Vector3d normal = plane.X_CP.rotation * Eigen::Vector3d::UnitZ();
  Matrix10 N = Matrix10::Zero();
  Vector10 g = Vector10::Zero();
  Eigen::Matrix<double, 10, 6> coupling = Eigen::Matrix<double, 10, 6>::Zero();
  Matrix6 own = plane.information;
  Eigen::Matrix<double, 6, 1> own_g = Eigen::Matrix<double, 6, 1>::Zero();
  const DepthView& view = *plane.view;
  for (int v = options_.stride_px / 2; v < view.height; v += options_.stride_px)
    for (int u = options_.stride_px / 2; u < view.width; u += options_.stride_px) {
      const double raw =
          1e-3 * view.raw_mm[static_cast<std::size_t>(v) * static_cast<std::size_t>(view.width) +
                             static_cast<std::size_t>(u)];
      if (raw <= 0) continue;
      const auto expected = expect(plane, u, v);
      if (!expected) continue;
      const double sigma_raw = std::hypot(options_.noise.sigma(expected->raw),
                                          options_.noise.step(expected->raw) / std::sqrt(12.0));
      const double to_plane = result_.scale * expected->along;
      const double sigma = std::max(1e-4, std::abs(to_plane) * sigma_raw);
      const double e = to_plane * (raw - expected->raw);
      if (std::abs(e) > options_.gate_m || (gate_sigmas > 0 && std::abs(e) > gate_sigmas * sigma))
        continue;
      const Vector10 J = derivative(*expected, normal, u, v);
      // The plane's own small rotation and shift in C about C's origin.
      Eigen::Matrix<double, 6, 1> H;
      H << -expected->p_C.cross(normal), -normal;
      const double weight = 1 / (sigma * sigma);
      N += weight * J * J.transpose();
      g -= weight * e * J;
      coupling += weight * J * H.transpose();
      own += weight * H * H.transpose();
      own_g -= weight * e * H;
      weighted_squares_ += weight * e * e;
      squares_m2_ += e * e;
      depth_sum_m_ += raw;
      ++readings_;
    }
  const Eigen::LDLT<Matrix6> factor(own);
  if (factor.info() != Eigen::Success || factor.rcond() < 1e-15) return;
  N_ += N - coupling * factor.solve(coupling.transpose());
  g_ += g - coupling * factor.solve(own_g);
}

Vector10 DepthFit::deviation_from_start() const {
  Vector10 d = Vector10::Zero();
  d.head<3>() = calibration::rotation_vector(
      {result_.X_CS.rotation * start_.X_CS.rotation.conjugate(), Eigen::Vector3d::Zero()});
  d.segment<3>(3) = result_.X_CS.position - start_.X_CS.position;
  d[kScale] = result_.scale - 1;
  d[kOffset] = result_.offset_m;
  d.tail<2>() = result_.pixel_offset;
  return d;
}

Vector10 DepthFit::solve_step() {
  const Vector10 information = prior_sigmas().array().square().inverse();
  Matrix10 N = N_;
  N.diagonal() += information;
  const Vector10 g = g_ - information.cwiseProduct(deviation_from_start());
  const Eigen::LDLT<Matrix10> factor(N);
  // Residuals larger than the noise model explains widen the covariance, smaller ones do not
  // narrow it.
  const double widen = std::max(1.0, weighted_squares_ / std::max(1, readings_ - 8));
  covariance_ = widen * factor.solve(Matrix10::Identity());
  for (int k = 0; k < 10; ++k)
    if (!is_active(k)) covariance_.row(k).setZero(), covariance_.col(k).setZero();
  covariance_ = (covariance_ + covariance_.transpose()).eval() / 2;
  Vector10 step = factor.solve(g);
  for (int k = 0; k < 10; ++k)
    if (!is_active(k)) step[k] = 0;
  return step;
}

void DepthFit::apply(const Vector10& step) {
  Rigid& X = result_.X_CS;
  X.rotation =
      (calibration::to_rigid(step.head<3>(), Eigen::Vector3d::Zero()).rotation * X.rotation)
          .normalized();
  X.position += step.segment<3>(3);
  result_.scale += step[kScale];
  result_.offset_m += step[kOffset];
  result_.pixel_offset += step.tail<2>();
  // The depth image's pixel (u, v) looks where the infrared image's (u, v) + offset does.
  result_.camera.cx = start_.camera.cx - result_.pixel_offset.x();
  result_.camera.cy = start_.camera.cy - result_.pixel_offset.y();
}

std::string where(const DepthView& view) {
  return view.image.empty() ? view.imager + " " + view.pose : view.image;
}

// The views of one imager whose pose was solved and seen by the imager itself.
Result<std::vector<Plane>> planes_of(std::span<const DepthView> views, const ImagerSolution& imager,
                                     const Camera& camera, Solution& solution) {
  std::vector<Plane> planes;
  for (const DepthView& view : views) {
    if (view.imager != imager.name) continue;
    if (view.width != camera.width || view.height != camera.height ||
        view.raw_mm.size() !=
            static_cast<std::size_t>(view.width) * static_cast<std::size_t>(view.height))
      return fail(fmt::format("{}: the depth image is {} x {}, but {}'s depth camera is {} x {}",
                              where(view), view.width, view.height, imager.name, camera.width,
                              camera.height));
    const auto pose = std::find_if(solution.poses.begin(), solution.poses.end(),
                                   [&](const BoardPose& p) { return p.name == view.pose; });
    const auto seen = std::find_if(
        solution.views.begin(), solution.views.end(),
        [&](const ViewSolution& v) { return v.pose == view.pose && v.imager == imager.name; });
    if (pose == solution.poses.end() || seen == solution.views.end()) continue;
    const Rigid X_CP = imager.X_BS.inverse() * pose->X_BP;
    planes.push_back({&view, X_CP, corner_information(solution, imager, *seen, X_CP)});
  }
  return planes;
}

void remark_on_what_is_weak(const ImagerSolution& imager, std::vector<std::string>& remarks) {
  const Vector10 prior = prior_sigmas();
  const DepthCalibration& depth = *imager.depth;
  constexpr const char* kNames[] = {"turn",  "turn",  "turn",   "place",        "place",
                                    "place", "scale", "offset", "pixel offset", "pixel offset"};
  std::string weak;
  for (int k = 0; k < 10; ++k) {
    // Half of the prior's sigma left: the boards say no more than was known before.
    const double sigma = std::sqrt(depth.covariance(k, k));
    if (sigma < 0.5 * prior[k] || weak.find(kNames[k]) != std::string::npos) continue;
    weak += fmt::format("{}{}", weak.empty() ? "" : ", ", kNames[k]);
  }
  if (!weak.empty())
    remarks.push_back(
        fmt::format("{}: {} depth images do not determine its depth camera's {}; tilt the board "
                    "more, near and far",
                    imager.name, depth.views, weak));
}

}  // namespace

Result<void> calibrate_depth(std::span<const DepthView> views,
                             const std::vector<SensorSpec>& sensors, Solution& solution,
                             const DepthOptions& options) {
  for (const DepthView& view : views) {
    const bool known =
        std::any_of(solution.imagers.begin(), solution.imagers.end(),
                    [&](const ImagerSolution& imager) { return imager.name == view.imager; });
    if (!known)
      return fail(
          fmt::format("{}: \"{}\" is not in the solution; solve it or remove its depth "
                      "images",
                      where(view), view.imager));
  }
  for (ImagerSolution& imager : solution.imagers) {
    const auto spec = std::find_if(sensors.begin(), sensors.end(),
                                   [&](const SensorSpec& s) { return s.name == imager.name; });
    if (spec == sensors.end() || !spec->depth) continue;
    const Camera& camera = spec->depth->from_infrared ? imager.camera : spec->depth->camera;
    const auto planes = planes_of(views, imager, camera, solution);
    if (!planes) return fail(planes.error().message);
    DepthFit fit(solution, imager, *spec->depth, options);
    for (const Plane& plane : *planes) fit.add(plane);
    imager.depth = fit.fit();
    if (imager.depth) {
      remark_on_what_is_weak(imager, solution.remarks);
      continue;
    }
    solution.remarks.push_back(
        fmt::format("{}: no depth image shows the board; its depth camera is taken to be where "
                    "its calibrated image is",
                    imager.name));
  }
  check_scale(solution);
  return {};
}

void check_scale(Solution& solution) {
  // The ratio of the board's metres to the Kinect's at the distance where the board was: better
  // known than scale and offset each by themselves.
  constexpr double kKinectScaleSigma = 0.01;  // from one unit to the next
  double sum = 0, weights = 0;
  for (const ImagerSolution& imager : solution.imagers) {
    if (!imager.depth) continue;
    const DepthCalibration& depth = *imager.depth;
    const double inverse = 1 / depth.mean_depth_m;
    const Eigen::Matrix2d C = depth.covariance.block<2, 2>(kScale, kScale);
    const Eigen::Vector2d J(1, inverse);
    const double variance = J.dot(C * J) + kKinectScaleSigma * kKinectScaleSigma;
    sum += (depth.scale + depth.offset_m * inverse) / variance;
    weights += 1 / variance;
  }
  if (weights == 0) return;
  const double ratio = sum / weights;
  ScaleCheck check;
  check.square_m = solution.board.square_m / ratio;
  check.sigma_m = check.square_m / ratio / std::sqrt(weights);
  constexpr double kTolerated = 0.02;
  check.agrees = std::abs(ratio - 1) <= kTolerated;
  if (!check.agrees)
    solution.remarks.push_back(fmt::format(
        "the board's squares are stated as {:.2f} mm, but the Kinects' depth says {:.2f} mm +- "
        "{:.2f} mm; measure the board, correct square_m and solve again",
        solution.board.square_m * 1e3, check.square_m * 1e3, check.sigma_m * 1e3));
  solution.scale_check = check;
}

}  // namespace wagonsight

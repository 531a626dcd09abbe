#include "calibrate/solution.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "geometry/angles.h"

namespace wagonsight {
namespace {

using Json = nlohmann::json;

Json to_json(const Eigen::Ref<const Eigen::MatrixXd>& matrix) {
  Json rows = Json::array();
  for (Eigen::Index r = 0; r < matrix.rows(); ++r) {
    Json row = Json::array();
    for (Eigen::Index c = 0; c < matrix.cols(); ++c) row.push_back(matrix(r, c));
    rows.push_back(std::move(row));
  }
  return rows;
}

Json to_list(const Eigen::Ref<const Eigen::VectorXd>& vector) {
  return Json(std::vector<double>(vector.begin(), vector.end()));
}

Json to_json(const Eigen::Quaterniond& q) {
  return Json::array({q.w(), q.x(), q.y(), q.z()});
}

Json to_json(const Rigid& X) {
  return {{"rotation", to_json(X.rotation)}, {"position", to_list(X.position)}};
}

Json to_json(const Camera& c) {
  Eigen::Matrix3d K;
  K << c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1;
  return {
      {"width", c.width}, {"height", c.height}, {"K", to_json(K)}, {"distortion", c.distortion}};
}

Json to_json(const ImagerSolution& imager) {
  Json json = to_json(imager.camera);
  json.update({{"kind", imager.kind == SensorKind::kStereo ? "stereo" : "kinect"},
               {"intrinsics_fixed", imager.intrinsics_fixed},
               {"sigma_intrinsics", to_list(imager.sigma_intrinsics)},
               {"X_BS", to_json(imager.X_BS)},
               {"covariance", to_json(imager.covariance)},
               {"corners", imager.corners},
               {"rejected", imager.rejected},
               {"rms_px", imager.rms_px},
               {"rms_px_per_coordinate", imager.rms_px_per_coordinate},
               {"held_out_rms_px", imager.held_out_rms_px}});
  if (imager.depth) {
    const DepthCalibration& depth = *imager.depth;
    Json& told = json["depth"] = to_json(depth.camera);
    told.update({{"through", depth.from_infrared ? "infrared" : "colour"},
                 {"X_CS", to_json(depth.X_CS)},
                 {"X_BS", to_json(imager.measuring_X_BS())},
                 {"scale", depth.scale},
                 {"offset_m", depth.offset_m},
                 {"pixel_offset", to_list(depth.pixel_offset)},
                 {"covariance", to_json(depth.covariance)},
                 {"covariance_order",
                  "rotation of X_CS x, y, z (rad), position x, y, z (m), scale, offset (m), pixel "
                  "offset u, v"},
                 {"views", depth.views},
                 {"readings", depth.readings},
                 {"rms_m", depth.rms_m},
                 {"mean_depth_m", depth.mean_depth_m}});
  }
  return json;
}

// Of omega, phi, kappa (rad) from the covariance of the rotation about W's axes, by differences.
Eigen::Vector3d angle_sigmas(const Georeferenced& geo) {
  constexpr double kStep = 1e-6;
  Eigen::Matrix3d J;
  for (int k = 0; k < 3; ++k) {
    const Eigen::Quaterniond turn(Eigen::AngleAxisd(kStep, Eigen::Vector3d::Unit(k)));
    const OmegaPhiKappa a = to_omega_phi_kappa(turn.conjugate() * geo.X_WB.rotation),
                        b = to_omega_phi_kappa(turn * geo.X_WB.rotation);
    J.col(k) = Eigen::Vector3d(wrap_angle(b.omega - a.omega), b.phi - a.phi,
                               wrap_angle(b.kappa - a.kappa)) /
               (2 * kStep);
  }
  const Eigen::Matrix3d C = J * geo.covariance.topLeftCorner<3, 3>() * J.transpose();
  return C.diagonal().cwiseMax(0).cwiseSqrt();
}

Json to_json(const Georeferenced& geo) {
  constexpr double kDegrees = 180 / std::numbers::pi;
  const OmegaPhiKappa angles = to_omega_phi_kappa(geo.X_WB.rotation);
  Json residuals = Json::array();
  for (std::size_t i = 0; i < geo.targets.size(); ++i)
    residuals.push_back({{"id", geo.targets[i]},
                         {"residual", to_list(geo.residuals_m[i])},
                         {"length", geo.residuals_m[i].norm()}});
  return {{"X_WB",
           {{"rotation", to_json(geo.X_WB.rotation)}, {"position", to_list(geo.X_WB.position)}}},
          {"scale", geo.X_WB.scale},
          {"omega_phi_kappa_deg",
           {angles.omega * kDegrees, angles.phi * kDegrees, angles.kappa * kDegrees}},
          {"omega_phi_kappa_sigma_deg", to_list(kDegrees * angle_sigmas(geo))},
          {"sigma", to_list(geo.covariance.diagonal().cwiseSqrt())},
          {"sigma_order", "rotation x, y, z (rad, about W's axes), position x, y, z (m), scale"},
          {"covariance", to_json(geo.covariance)},
          {"residuals_m", std::move(residuals)}};
}

// Reading back: a SOLUTION.json may have been edited, so every value is checked for its shape.
class Reader {
 public:
  explicit Reader(std::string_view file) : file_(file) {}

  bool ok() const { return error_.empty(); }
  const std::string& error() const { return error_; }

  double number(const Json& json, const std::string& path) {
    if (!json.is_number() || !std::isfinite(json.get<double>())) {
      complain(path, "must be a finite number");
      return 0;
    }
    return json.get<double>();
  }
  template <int N>
  Eigen::Matrix<double, N, 1> vector(const Json& json, const std::string& path) {
    Eigen::Matrix<double, N, 1> v = Eigen::Matrix<double, N, 1>::Zero();
    if (!json.is_array() || json.size() != N) {
      complain(path, fmt::format("must be {} numbers", N));
      return v;
    }
    for (int i = 0; i < N; ++i) v[i] = number(json[static_cast<std::size_t>(i)], path);
    return v;
  }
  template <int N>
  Eigen::Matrix<double, N, N> matrix(const Json& json, const std::string& path) {
    Eigen::Matrix<double, N, N> M = Eigen::Matrix<double, N, N>::Zero();
    if (!json.is_array() || json.size() != N) {
      complain(path, fmt::format("must be {} rows", N));
      return M;
    }
    for (int r = 0; r < N; ++r)
      M.row(r) = vector<N>(json[static_cast<std::size_t>(r)], path).transpose();
    return M;
  }
  Eigen::Quaterniond rotation(const Json& json, const std::string& path) {
    const Eigen::Vector4d q = vector<4>(json, path);
    if (ok() && std::abs(q.norm() - 1) > 1e-3)
      complain(path, "must be a unit quaternion w, x, y, z");
    return ok() ? Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized()
                : Eigen::Quaterniond::Identity();
  }
  void complain(const std::string& path, std::string_view rule) {
    if (error_.empty()) error_ = fmt::format("{}: {} {}", file_, path, rule);
  }

 private:
  std::string file_;
  std::string error_;
};

Camera read_camera(Reader& reader, const std::string& path, const Json& json) {
  Camera camera;
  camera.width = static_cast<int>(reader.number(json.value("width", Json()), path + ".width"));
  camera.height = static_cast<int>(reader.number(json.value("height", Json()), path + ".height"));
  const Eigen::Matrix3d K = reader.matrix<3>(json.value("K", Json()), path + ".K");
  camera.fx = K(0, 0);
  camera.fy = K(1, 1);
  camera.cx = K(0, 2);
  camera.cy = K(1, 2);
  const auto distortion = reader.vector<5>(json.value("distortion", Json()), path + ".distortion");
  std::copy(distortion.begin(), distortion.end(), camera.distortion.begin());
  return camera;
}

Rigid read_rigid(Reader& reader, const std::string& path, const Json& json) {
  Rigid X;
  if (!json.is_object()) {
    reader.complain(path, "is missing");
    return X;
  }
  X.rotation = reader.rotation(json.value("rotation", Json()), path + ".rotation");
  X.position = reader.vector<3>(json.value("position", Json()), path + ".position");
  return X;
}

DepthCalibration read_depth(Reader& reader, const std::string& path, const Json& json) {
  DepthCalibration depth;
  if (!json.is_object()) {
    reader.complain(path, "must describe the depth camera");
    return depth;
  }
  const auto get = [&](const char* key) {
    return reader.number(json.value(key, Json()), path + "." + key);
  };
  depth.from_infrared = json.value("through", Json()) == "infrared";
  depth.camera = read_camera(reader, path, json);
  depth.X_CS = read_rigid(reader, path + ".X_CS", json.value("X_CS", Json()));
  depth.scale = get("scale");
  depth.offset_m = get("offset_m");
  depth.pixel_offset = reader.vector<2>(json.value("pixel_offset", Json()), path + ".pixel_offset");
  depth.covariance = reader.matrix<10>(json.value("covariance", Json()), path + ".covariance");
  depth.views = static_cast<int>(get("views"));
  depth.readings = static_cast<int>(get("readings"));
  depth.rms_m = get("rms_m");
  depth.mean_depth_m = get("mean_depth_m");
  return depth;
}

ImagerSolution read_imager(Reader& reader, const std::string& name, const Json& json) {
  ImagerSolution imager;
  imager.name = name;
  const std::string path = "sensors." + name;
  const auto get = [&](const char* key) { return json.value(key, Json()); };
  imager.kind = get("kind") == "stereo" ? SensorKind::kStereo : SensorKind::kKinect;
  if (!json.is_object()) {
    reader.complain(path, "must be an object");
    return imager;
  }
  imager.camera = read_camera(reader, path, json);
  imager.X_BS = read_rigid(reader, path + ".X_BS", get("X_BS"));
  imager.covariance = reader.matrix<6>(get("covariance"), path + ".covariance");
  imager.rms_px = reader.number(get("rms_px"), path + ".rms_px");
  imager.rms_px_per_coordinate = imager.rms_px / std::numbers::sqrt2;
  if (json.contains("held_out_rms_px"))
    imager.held_out_rms_px = reader.number(json["held_out_rms_px"], path + ".held_out_rms_px");
  if (json.contains("sigma_intrinsics"))
    imager.sigma_intrinsics =
        reader.vector<4>(json["sigma_intrinsics"], path + ".sigma_intrinsics");
  imager.intrinsics_fixed = json.value("intrinsics_fixed", Json()) == true;
  imager.corners =
      json.value("corners", Json()).is_number_integer() ? json["corners"].get<int>() : 0;
  imager.rejected =
      json.value("rejected", Json()).is_number_integer() ? json["rejected"].get<int>() : 0;
  if (json.contains("depth")) imager.depth = read_depth(reader, path + ".depth", json["depth"]);
  return imager;
}

// The sensors come back sorted by name, so the rows are put into that order.
Eigen::MatrixXd read_joint(Reader& reader, const Json& json,
                           const std::vector<ImagerSolution>& imagers) {
  const auto n = static_cast<Eigen::Index>(imagers.size());
  const Json order = json.value("order", Json::array()), matrix = json.value("matrix", Json());
  std::vector<Eigen::Index> at;
  for (const ImagerSolution& imager : imagers)
    for (std::size_t i = 0; i < order.size(); ++i)
      if (order[i] == imager.name) at.push_back(static_cast<Eigen::Index>(i));
  if (at.size() != imagers.size() || order.size() != imagers.size() || !matrix.is_array() ||
      matrix.size() != 6 * imagers.size()) {
    reader.complain("joint_covariance", "must name every sensor once and have six rows each");
    return {};
  }
  Eigen::MatrixXd stored(6 * n, 6 * n), sorted(6 * n, 6 * n);
  for (Eigen::Index r = 0; r < 6 * n; ++r) {
    const Json& row = matrix[static_cast<std::size_t>(r)];
    if (!row.is_array() || row.size() != static_cast<std::size_t>(6 * n)) {
      reader.complain("joint_covariance", "must be square");
      return {};
    }
    for (Eigen::Index c = 0; c < 6 * n; ++c)
      stored(r, c) = reader.number(row[static_cast<std::size_t>(c)], "joint_covariance");
  }
  for (Eigen::Index a = 0; a < n; ++a)
    for (Eigen::Index b = 0; b < n; ++b)
      sorted.block<6, 6>(6 * a, 6 * b) = stored.block<6, 6>(6 * at[static_cast<std::size_t>(a)],
                                                            6 * at[static_cast<std::size_t>(b)]);
  return sorted;
}

StereoPair read_pair(Reader& reader, const std::string& name, const Json& json) {
  StereoPair pair;
  pair.name = name;
  const std::string path = "stereo." + name;
  pair.X_LR = read_rigid(reader, path + ".X_LR", json.value("X_LR", Json()));
  pair.covariance = reader.matrix<6>(json.value("covariance", Json()), path + ".covariance");
  pair.baseline_m = reader.number(json.value("baseline_m", Json()), path + ".baseline_m");
  pair.baseline_sigma_m =
      reader.number(json.value("baseline_sigma_m", Json()), path + ".baseline_sigma_m");
  return pair;
}

Georeferenced read_georeference(Reader& reader, const Json& json) {
  Georeferenced geo;
  const Json X_WB = json.value("X_WB", Json::object());
  geo.X_WB.rotation = reader.rotation(X_WB.value("rotation", Json()), "georeference.X_WB.rotation");
  geo.X_WB.position =
      reader.vector<3>(X_WB.value("position", Json()), "georeference.X_WB.position");
  geo.X_WB.scale = reader.number(json.value("scale", Json()), "georeference.scale");
  geo.covariance = reader.matrix<7>(json.value("covariance", Json()), "georeference.covariance");
  for (const Json& item : json.value("residuals_m", Json::array())) {
    geo.targets.push_back(item.value("id", std::string()));
    geo.residuals_m.emplace_back(
        reader.vector<3>(item.value("residual", Json()), "georeference.residuals_m"));
  }
  return geo;
}

}  // namespace

std::string format_solution(const Solution& solution) {
  Json root;
  root["board"] = {{"rows", solution.board.rows},
                   {"columns", solution.board.columns},
                   {"square_m", solution.board.square_m}};
  root["reference_pose"] = solution.reference_pose;
  root["sigma0_px"] = solution.sigma0_px;
  root["sensors"] = Json::object();
  for (const ImagerSolution& imager : solution.imagers)
    root["sensors"][imager.name] = to_json(imager);
  if (solution.joint_covariance.size() > 0) {
    Json order = Json::array();
    for (const ImagerSolution& imager : solution.imagers) order.push_back(imager.name);
    root["joint_covariance"] = {{"order", std::move(order)},
                                {"matrix", to_json(solution.joint_covariance)}};
  }
  root["stereo"] = Json::object();
  for (const StereoPair& pair : solution.pairs)
    root["stereo"][pair.name] = {{"X_LR", to_json(pair.X_LR)},
                                 {"covariance", to_json(pair.covariance)},
                                 {"baseline_m", pair.baseline_m},
                                 {"baseline_sigma_m", pair.baseline_sigma_m}};
  root["poses"] = Json::array();
  for (const BoardPose& pose : solution.poses)
    root["poses"].push_back({{"name", pose.name},
                             {"X_BP", to_json(pose.X_BP)},
                             {"covariance", to_json(pose.covariance)}});
  root["views"] = Json::array();
  for (const ViewSolution& view : solution.views) {
    Json residuals = Json::array();
    for (const auto& r : view.residuals)
      residuals.push_back({r.id, r.pixel.x(), r.pixel.y(), r.residual.x(), r.residual.y(), r.used});
    root["views"].push_back({{"sensor", view.imager},
                             {"image", view.image},
                             {"pose", view.pose},
                             {"rms_px", view.rms_px},
                             {"residuals", std::move(residuals)}});
  }
  root["remarks"] = solution.remarks;
  if (solution.scale_check)
    root["scale_check"] = {{"square_m", solution.scale_check->square_m},
                           {"sigma_m", solution.scale_check->sigma_m},
                           {"agrees", solution.scale_check->agrees}};
  if (solution.georeference) root["georeference"] = to_json(*solution.georeference);
  return root.dump(1) + "\n";
}

Result<Solution> parse_solution(std::string_view text, std::string_view file) {
  const Json root = Json::parse(text, nullptr, false);
  if (root.is_discarded() || !root.is_object() || !root.contains("sensors") ||
      !root["sensors"].is_object())
    return fail(fmt::format("{}: this is not a SOLUTION.json (no \"sensors\")", file));
  Solution solution;
  Reader reader(file);
  const Json board = root.value("board", Json::object());
  solution.board.rows = static_cast<int>(reader.number(board.value("rows", Json()), "board.rows"));
  solution.board.columns =
      static_cast<int>(reader.number(board.value("columns", Json()), "board.columns"));
  solution.board.square_m = reader.number(board.value("square_m", Json()), "board.square_m");
  solution.reference_pose = root.value("reference_pose", std::string());
  if (root.contains("sigma0_px"))
    solution.sigma0_px = reader.number(root["sigma0_px"], "sigma0_px");
  for (const auto& [name, json] : root["sensors"].items())
    solution.imagers.push_back(read_imager(reader, name, json));
  if (root.contains("joint_covariance"))
    solution.joint_covariance = read_joint(reader, root["joint_covariance"], solution.imagers);
  const Json pairs = root.value("stereo", Json::object());
  for (const auto& [name, json] : pairs.items())
    solution.pairs.push_back(read_pair(reader, name, json));
  for (const Json& json : root.value("poses", Json::array())) {
    BoardPose& pose = solution.poses.emplace_back();
    pose.name = json.value("name", std::string());
    pose.X_BP = read_rigid(reader, "poses.X_BP", json.value("X_BP", Json()));
    if (json.contains("covariance"))
      pose.covariance = reader.matrix<6>(json["covariance"], "poses.covariance");
  }
  for (const Json& json : root.value("views", Json::array())) {
    ViewSolution& view = solution.views.emplace_back();
    view.imager = json.value("sensor", std::string());
    view.image = json.value("image", std::string());
    view.pose = json.value("pose", std::string());
    view.rms_px = reader.number(json.value("rms_px", Json()), "views.rms_px");
    for (const Json& r : json.value("residuals", Json::array())) {
      if (!r.is_array() || r.size() != 6 || !r[5].is_boolean()) {
        reader.complain("views.residuals", "must be [id, x, y, dx, dy, used]");
        break;
      }
      view.residuals.push_back(
          {static_cast<int>(reader.number(r[0], "views.residuals")),
           {reader.number(r[1], "views.residuals"), reader.number(r[2], "views.residuals")},
           {reader.number(r[3], "views.residuals"), reader.number(r[4], "views.residuals")},
           r[5].get<bool>()});
    }
  }
  for (const Json& remark : root.value("remarks", Json::array()))
    if (remark.is_string()) solution.remarks.push_back(remark.get<std::string>());
  if (root.contains("scale_check") && root["scale_check"].is_object()) {
    const Json& json = root["scale_check"];
    solution.scale_check = {reader.number(json.value("square_m", Json()), "scale_check.square_m"),
                            reader.number(json.value("sigma_m", Json()), "scale_check.sigma_m"),
                            json.value("agrees", Json()) == true};
  }
  if (root.contains("georeference"))
    solution.georeference = read_georeference(reader, root["georeference"]);
  if (!reader.ok()) return fail(reader.error());
  return solution;
}

}  // namespace wagonsight

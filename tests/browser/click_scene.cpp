// Photographs for the click page's test: click_scene FOLDER writes two cameras' images of a board
// in seven poses and of four balls, with a hand over part of every board so that no detector finds
// a whole one, and truth.json: where every corner and ball truly is.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <random>

#include "calibrate/observations.h"
#include "geometry/angles.h"
#include "geometry/camera.h"
#include "geometry/transform.h"

namespace wagonsight {
namespace {

using Json = nlohmann::json;

constexpr int kWidth = 640, kHeight = 480, kPoses = 7, kSub = 3;
const Board kBoard{6, 9, 0.06};
constexpr double kBallRadius = 0.05;

struct SceneCamera {
  std::string name;
  Camera camera;
  Rigid X_WS;
};

std::vector<SceneCamera> make_cameras() {
  std::vector<SceneCamera> cameras;
  const Eigen::Vector3d middle(0, 0, 0.9);
  for (const auto& [name, place] : {std::pair{"k0", Eigen::Vector3d(-1.6, -0.5, 2.2)},
                                    {"k1", Eigen::Vector3d(1.5, -0.9, 2.3)}}) {
    SceneCamera one;
    one.name = name;
    one.camera.width = kWidth, one.camera.height = kHeight;
    one.camera.fx = 528.3, one.camera.fy = 527.1, one.camera.cx = 317.2, one.camera.cy = 243.9;
    one.camera.distortion = {0.06, -0.09, 0.0006, -0.0004, 0};
    one.X_WS = {look_at(place, middle), place};
    cameras.push_back(one);
  }
  return cameras;
}

// X_WB of each photograph: the first lies on the floor's table, the others are held up and tilted.
std::vector<Rigid> make_poses() {
  std::vector<Rigid> poses;
  std::mt19937 random(7);
  std::uniform_real_distribution<double> uniform(-1, 1);
  const Eigen::Quaterniond facing_up = from_omega_phi_kappa({3.14159265, 0, 0.2});
  for (int i = 0; i < kPoses; ++i) {
    const double tilt = i == 0 ? 0 : 0.35;
    const Eigen::Quaterniond turn = from_omega_phi_kappa(
        {tilt * uniform(random), tilt * uniform(random), 0.4 * uniform(random)});
    const Eigen::Vector3d centre(0.45 * uniform(random), 0.3 * uniform(random),
                                 0.8 + 0.3 * uniform(random));
    Rigid X{turn * facing_up, Eigen::Vector3d::Zero()};
    X.position = centre - X.rotation * (kBoard.point(kBoard.corner_count() - 1) / 2);
    poses.push_back(X);
  }
  return poses;
}

const std::array<Eigen::Vector3d, 4> kBalls = {
    Eigen::Vector3d(-0.75, -0.45, 1.15), {0.8, -0.1, 0.6}, {0.7, 0.65, 1.25}, {-0.7, 0.6, 0.55}};

struct Scene {
  Rigid X_WB;
  Eigen::Vector2d hand;  // on the board, metres

  // What a ray meets first, as brightness.
  double look(const Eigen::Vector3d& from, const Eigen::Vector3d& along) const {
    double nearest = 1e9, brightness = 95 + 30 * std::sin(3 * along.x()) * std::cos(4 * along.y());
    for (const Eigen::Vector3d& ball : kBalls) {
      const double b = along.dot(ball - from);
      const double gap = (ball - from).squaredNorm() - b * b;
      if (gap > kBallRadius * kBallRadius) continue;
      const double distance = b - std::sqrt(kBallRadius * kBallRadius - gap);
      if (distance <= 0 || distance >= nearest) continue;
      nearest = distance;
      const Eigen::Vector3d normal = (from + distance * along - ball) / kBallRadius;
      brightness = 205 + 45 * std::max(0.0, normal.z());
    }
    const Rigid X_BW = X_WB.inverse();
    const Eigen::Vector3d o = X_BW * from, d = X_BW.rotation * along;
    const double distance = -o.z() / d.z();
    if (!(distance > 0) || distance > nearest) return brightness;
    const Eigen::Vector3d p = o + distance * d;
    const double rim = 1.4 * kBoard.square_m;
    if (p.x() < -rim || p.y() < -rim || p.x() > kBoard.square_m * (kBoard.columns - 1) + rim ||
        p.y() > kBoard.square_m * (kBoard.rows - 1) + rim)
      return brightness;
    if ((p.head<2>() - hand).norm() < 1.3 * kBoard.square_m) return 120 + 200 * p.x();
    const int a = static_cast<int>(std::floor(p.x() / kBoard.square_m));
    const int b = static_cast<int>(std::floor(p.y() / kBoard.square_m));
    const bool printed = a >= -1 && b >= -1 && a < kBoard.columns && b < kBoard.rows;
    return printed && ((a + b) & 1) == 0 ? 45 : 215;
  }
};

void paint(const SceneCamera& camera, const Scene& scene, const std::filesystem::path& file,
           unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0, 1.5);
  std::string pixels(static_cast<std::size_t>(kWidth * kHeight), '\0');
  for (int v = 0; v < kHeight; ++v)
    for (int u = 0; u < kWidth; ++u) {
      double sum = 0;
      for (int k = 0; k < kSub * kSub; ++k) {
        const Eigen::Vector2d at(u + (k % kSub + 0.5) / kSub - 0.5,
                                 v + (k / kSub + 0.5) / kSub - 0.5);
        const Eigen::Vector3d ray = *ray_through(camera.camera, at);
        sum += scene.look(camera.X_WS.position, (camera.X_WS.rotation * ray).normalized());
      }
      const double value = std::clamp(sum / (kSub * kSub) + noise(random), 0.0, 255.0);
      pixels[static_cast<std::size_t>(v * kWidth + u)] =
          static_cast<char>(static_cast<unsigned char>(value));
    }
  std::ofstream(file, std::ios::binary)
      << fmt::format("P5\n{} {}\n255\n", kWidth, kHeight) << pixels;
}

Json place(const Eigen::Vector2d& pixel) {
  return {{"x", pixel.x()}, {"y", pixel.y()}};
}

int run(const std::filesystem::path& folder) {
  const auto cameras = make_cameras();
  const auto poses = make_poses();
  Json truth = {{"images", Json::object()}, {"balls", Json::array()}};
  std::string sensors;
  for (const SceneCamera& camera : cameras) {
    std::filesystem::create_directories(folder / "images" / camera.name);
    const Camera& c = camera.camera;
    sensors += fmt::format(
        "[[sensor]]\nname = \"{}\"\nkind = \"kinect\"\nwidth = {}\nheight = {}\nfix_intrinsics = "
        "true\n"
        "fx = {}\nfy = {}\ncx = {}\ncy = {}\ndistortion = [{}]\n\n",
        camera.name, c.width, c.height, c.fx, c.fy, c.cx, c.cy, fmt::join(c.distortion, ", "));
    truth["cameras"][camera.name] = {camera.X_WS.position.x(), camera.X_WS.position.y(),
                                     camera.X_WS.position.z()};
    for (int i = 0; i < kPoses; ++i) {
      const std::string name = fmt::format("{}/{:04}.pgm", camera.name, i + 1);
      const Scene scene{poses[static_cast<std::size_t>(i)],
                        {0.03 + 0.08 * (i % 4), 0.1 + 0.05 * (i % 3)}};
      paint(camera, scene, folder / "images" / name, static_cast<unsigned>(i) + 1);
      const Rigid X_SB = camera.X_WS.inverse() * scene.X_WB;
      Json corners = Json::array();
      for (int id = 0; id < kBoard.corner_count(); ++id) {
        const Eigen::Vector3d p = kBoard.point(id);
        Json corner = place(*project(c, X_SB * p));
        corner["id"] = id;
        const double from_hand = (p.head<2>() - scene.hand).norm() / kBoard.square_m;
        corner["hidden"] = from_hand < 1.15;  // beyond, part of the saddle peeps out
        corner["free"] = from_hand > 1.7;     // with all that is around it
        corners.push_back(corner);
      }
      truth["images"][name] = corners;
    }
  }
  for (std::size_t b = 0; b < kBalls.size(); ++b) {
    Json ball = {{"id", std::string(1, static_cast<char>('A' + b))},
                 {"world", {kBalls[b].x(), kBalls[b].y(), kBalls[b].z()}}};
    for (const SceneCamera& camera : cameras)
      ball["seen"][camera.name] = place(*project(camera.camera, camera.X_WS.inverse() * kBalls[b]));
    truth["balls"].push_back(ball);
  }
  std::ofstream(folder / "sensors.toml") << sensors;
  std::ofstream(folder / "board.toml") << fmt::format("rows = {}\ncolumns = {}\nsquare_m = {}\n",
                                                      kBoard.rows, kBoard.columns, kBoard.square_m);
  std::ofstream(folder / "truth.json") << truth.dump(1);
  return 0;
}

}  // namespace
}  // namespace wagonsight

int main(int argc, char** argv) {
  if (argc != 2) return 2;
  return wagonsight::run(argv[1]);
}

#pragma once

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "calibrate/detect_board.h"
#include "geometry/camera.h"
#include "geometry/transform.h"

// Photographs of a chessboard that nobody took: the board's plane is intersected with sixteen rays
// a pixel, then blur, glare, what stands before the board, and noise.
namespace wagonsight::synthetic {

struct Photograph {
  int width = 640, height = 480;
  std::vector<float> light;  // 0 to 255
  std::vector<std::uint8_t> pixels;

  GrayImage view() const { return {pixels.data(), width, height}; }

  void cover(int u0, int v0, int u1, int v1, float value) {
    for (int v = std::max(0, v0); v < std::min(height, v1); ++v)
      for (int u = std::max(0, u0); u < std::min(width, u1); ++u)
        light[static_cast<std::size_t>(v * width + u)] = value;
  }
  void glare(double x, double y, double radius) {
    for (int v = 0; v < height; ++v)
      for (int u = 0; u < width; ++u) {
        const double d2 = ((u - x) * (u - x) + (v - y) * (v - y)) / (radius * radius);
        light[static_cast<std::size_t>(v * width + u)] +=
            static_cast<float>(600 * std::exp(-2 * d2));
      }
  }
  void blur(double sigma) {
    const int reach = static_cast<int>(std::ceil(3 * sigma));
    std::vector<float> kernel;
    float sum = 0;
    for (int i = -reach; i <= reach; ++i) {
      kernel.push_back(static_cast<float>(std::exp(-i * i / (2 * sigma * sigma))));
      sum += kernel.back();
    }
    for (const bool across : {true, false}) {
      std::vector<float> out(light.size());
      for (int v = 0; v < height; ++v)
        for (int u = 0; u < width; ++u) {
          float value = 0;
          for (int i = -reach; i <= reach; ++i) {
            const int x = std::clamp(across ? u + i : u, 0, width - 1);
            const int y = std::clamp(across ? v : v + i, 0, height - 1);
            value += kernel[static_cast<std::size_t>(i + reach)] *
                     light[static_cast<std::size_t>(y * width + x)] / sum;
          }
          out[static_cast<std::size_t>(v * width + u)] = value;
        }
      light = out;
    }
  }
  void expose(double noise, unsigned seed) {
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    pixels.clear();
    for (const float value : light)
      pixels.push_back(static_cast<std::uint8_t>(
          std::clamp(std::lround(static_cast<double>(value) + noise * normal(random)), 0L, 255L)));
  }
};

// Corner 0's outer square is black; behind the outer squares lies a white margin of 0.6 squares.
inline float board_light(const Board& board, double x, double y) {
  const double column = x / board.square_m, row = y / board.square_m;
  constexpr double kMargin = 0.6;
  if (column < -1 - kMargin || row < -1 - kMargin || column > board.columns + kMargin ||
      row > board.rows + kMargin)
    return 90.0F;
  if (column < -1 || row < -1 || column > board.columns || row > board.rows) return 215.0F;
  const int parity = static_cast<int>(std::floor(column)) + static_cast<int>(std::floor(row));
  return parity % 2 == 0 ? 35.0F : 215.0F;
}

inline Photograph photograph(const Board& board, const Camera& camera, const Rigid& X_SP) {
  Photograph photo;
  photo.width = camera.width;
  photo.height = camera.height;
  const Rigid X_PS = X_SP.inverse();
  for (int v = 0; v < photo.height; ++v)
    for (int u = 0; u < photo.width; ++u) {
      float sum = 0;
      for (int s = 0; s < 16; ++s) {
        const Eigen::Vector2d pixel(u + (s % 4 - 1.5) / 4, v + (s / 4 - 1.5) / 4);
        const Eigen::Vector3d ray((pixel.x() - camera.cx) / camera.fx,
                                  (pixel.y() - camera.cy) / camera.fy, 1);
        const Eigen::Vector3d direction = X_PS.rotation * ray;
        const double t = -X_PS.position.z() / direction.z();
        const Eigen::Vector3d p = X_PS.position + t * direction;
        sum += t > 0 ? board_light(board, p.x(), p.y()) : 90.0F;
      }
      photo.light.push_back(sum / 16);
    }
  return photo;
}

// A board that faces the camera at `distance`, its middle near the axis, turned about x, y and
// rolled about the optical axis (radians).
inline Rigid facing(const Board& board, double distance, double about_x, double about_y,
                    double roll) {
  const Eigen::Vector3d middle(board.square_m * (board.columns - 1) / 2,
                               board.square_m * (board.rows - 1) / 2, 0);
  const Eigen::Quaterniond turn = Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitZ()) *
                                  Eigen::AngleAxisd(about_x, Eigen::Vector3d::UnitX()) *
                                  Eigen::AngleAxisd(about_y, Eigen::Vector3d::UnitY());
  return {turn, Eigen::Vector3d(0.01, -0.02, distance) - turn * middle};
}

}  // namespace wagonsight::synthetic

#include "simulate/stereo_imager.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "simulate/random.h"

namespace wagonsight {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;

// Below this brightness outside, a window shows the inside of the wagon more than anything else.
constexpr float kDarkOutside = 0.3F;
constexpr float kTrainSpeed = 30;  // m/s

Part mirrored(Part part, int axis, double plane) {
  part.centre[axis] = 2 * plane - part.centre[axis];
  part.axes.row(axis) *= -1;
  return part;
}

DrawRect common(const DrawRect& a, const DrawRect& b) {
  return {std::max(a.u, b.u), std::max(a.v, b.v), std::min(a.u_end, b.u_end),
          std::min(a.v_end, b.v_end)};
}

Finish finish_of(const RoomPart& piece, std::size_t index) {
  Finish finish;
  finish.a = static_cast<float>(mixed(index, 1) % 256);
  finish.b = static_cast<float>(mixed(index, 2) % 256);
  switch (piece.surface) {
    case Surface::kFloor:
      return {Texture::kFloor, 0.22F, finish.a, finish.b};
    case Surface::kCeiling:
      return {Texture::kPlain, 0.7F, finish.a, finish.b};
    case Surface::kWall:
      return {Texture::kPlain, 0.6F, finish.a, finish.b};
    case Surface::kGround:
      return {Texture::kFloor, 0.35F, finish.a, finish.b};
    case Surface::kSeat:
      return {Texture::kFabric, 0.25F, finish.a, finish.b};
    case Surface::kFurniture:
      return {Texture::kLaminate, piece.material == Material::kDark ? 0.05F : 0.45F, finish.a,
              finish.b};
  }
  return finish;
}

// Of a wall: heater slots at the bottom, laminate up to the windows, then plain panels.
Texture wall_texture(float z) {
  constexpr float kHeater = 0.28F, kSill = 1.15F;
  return z < kHeater ? Texture::kGrille : z < kSill ? Texture::kLaminate : Texture::kPlain;
}

}  // namespace

StereoImager::StereoImager(const Scene& scene, const std::vector<RoomPart>& room,
                           const SurfaceTextures& textures, const Camera& camera)
    : scene_(&scene),
      room_(&room),
      textures_(&textures),
      raster_(camera),
      width_(camera.width),
      height_(camera.height),
      focal_(static_cast<float>(camera.fx)),
      faces_(1 + 6 * room.size()),
      face_light_(faces_.size()),
      face_sun_(faces_.size()),
      drawn_(kPartsMax),
      reflected_(kPartsMax),
      inverse_depth_(static_cast<std::size_t>(camera.width) *
                     static_cast<std::size_t>(camera.height)),
      mirror_depth_(inverse_depth_.size()),
      part_(inverse_depth_.size(), -1),
      mirror_part_(inverse_depth_.size(), -1) {
  for (std::size_t i = 0; i < room.size(); ++i)
    for (int axis = 0; axis < 3; ++axis)
      for (int side = 0; side < 2; ++side)
        faces_[1 + 6 * i + static_cast<std::size_t>(2 * axis + side)].n_W =
            room[i].part.axes.col(axis).cast<float>() * (side == 0 ? -1.0F : 1.0F);
}

void StereoImager::add_pose(const Rigid& X_WS) {
  stills_.emplace_back();
  stills_.back().X_WS = X_WS;
  draw_still(stills_.back());
  find_panes(stills_.back());
}

void StereoImager::choose(const Still& still) {
  R_WS_ = still.X_WS.rotation.toRotationMatrix().cast<float>();
  o_W_ = still.X_WS.position.cast<float>();
}

StereoImager::Drawn StereoImager::prepare(const Part& part, const Finish& finish,
                                          const Rigid& X_SW) const {
  Drawn drawn;
  drawn.shape = raster_.prepare(part, X_SW);
  drawn.finish = finish;
  for (int axis = 0; axis < 3; ++axis)
    drawn.texels[static_cast<std::size_t>(axis)] =
        static_cast<float>(part.half[axis]) * SurfaceTextures::kTexelsPerM;
  return drawn;
}

// The texture of a part lies on it as seen along the local axis that its surface faces most; where
// that changes there is a seam, which is on the part and so the same for both imagers.
StereoImager::Touch StereoImager::touch(const Drawn& drawn, int u, int v, float w) const {
  const PreparedPart& part = drawn.shape;
  const float x = raster_.ray_x(u), y = raster_.ray_y(v), t = 1.0F / w;
  float local[3], n[3];
  for (std::size_t i = 0; i < 3; ++i)
    local[i] = (part.m[i][0] * x + part.m[i][1] * y + part.m[i][2]) * t - part.c[i];
  const bool cone = part.shape == Part::Shape::kCone;
  std::size_t facing = std::abs(local[1]) > std::abs(local[0]) ? 1 : 0;
  if (!cone && std::abs(local[2]) > std::abs(local[facing])) facing = 2;
  for (std::size_t i = 0; i < 3; ++i) n[i] = local[i];
  if (cone) n[2] = -part.taper * (1.0F + part.taper * local[2]);
  if (part.shape == Part::Shape::kBox)
    for (std::size_t i = 0; i < 3; ++i) n[i] = i == facing ? local[i] : 0.0F;
  Vector3f n_S;
  for (std::size_t k = 0; k < 3; ++k)
    n_S[static_cast<int>(k)] = n[0] * part.m[0][k] + n[1] * part.m[1][k] + n[2] * part.m[2][k];
  const std::size_t first = facing == 0 ? 1 : 0, second = facing == 2 ? 1 : 2;
  const float a = local[first] * drawn.texels[first] + drawn.finish.a;
  const float b = local[second] * drawn.texels[second] + drawn.finish.b;
  const float footprint = SurfaceTextures::kTexelsPerM * t / focal_;
  const float texture = textures_->sample(drawn.finish.texture, a, b, footprint);
  return {R_WS_ * n_S / (n_S.norm() + 1e-9F), drawn.finish.albedo * texture};
}

std::uint16_t StereoImager::still_albedo(const Drawn& drawn, Surface surface, int u, int v, float w,
                                         std::uint16_t& face) const {
  Drawn wanted = drawn;
  const Vector3f p_W = o_W_ + direction_W(u, v) / w;
  if (surface == Surface::kWall) wanted.finish.texture = wall_texture(p_W.z());
  const Touch seen = touch(wanted, u, v, w);
  // Which of the six faces: the one whose normal it has.
  const auto first = static_cast<std::size_t>(1 + 6 * drawn.shape.tag);
  std::size_t best = first;
  for (std::size_t i = first; i < first + 6; ++i)
    if (faces_[i].n_W.dot(seen.n_W) > faces_[best].n_W.dot(seen.n_W)) best = i;
  face = static_cast<std::uint16_t>(best);
  return static_cast<std::uint16_t>(std::clamp(seen.albedo / kAlbedoUnit, 0.0F, 65535.0F));
}

void StereoImager::draw_still(Still& still) {
  choose(still);
  const std::size_t count = inverse_depth_.size();
  still.inverse_depth.assign(count, 0);
  still.albedo.assign(count, 0);
  still.face.assign(count, 0);
  still.sunlit.assign(count, 0);
  std::fill(part_.begin(), part_.end(), -1);
  const Rigid X_SW = still.X_WS.inverse();
  std::vector<Drawn> pieces;
  const RasterTarget target{width_, height_, still.inverse_depth, part_};
  for (std::size_t i = 0; i < room_->size(); ++i) {
    pieces.push_back(prepare((*room_)[i].part, finish_of((*room_)[i], i), X_SW));
    pieces.back().shape.tag = static_cast<std::int32_t>(i);
    raster_.draw(pieces.back().shape, static_cast<std::int32_t>(i), target);
  }
  for (int v = 0; v < height_; ++v)
    for (int u = 0; u < width_; ++u) {
      const std::size_t pixel = at(u, v);
      if (part_[pixel] < 0) continue;
      const auto index = static_cast<std::size_t>(part_[pixel]);
      still.albedo[pixel] = still_albedo(pieces[index], (*room_)[index].surface, u, v,
                                         still.inverse_depth[pixel], still.face[pixel]);
    }
}

void StereoImager::find_panes(Still& still) {
  const Rigid X_SW = still.X_WS.inverse();
  for (std::size_t i = 0; i < room_->size(); ++i) {
    const RoomPart& piece = (*room_)[i];
    if (piece.material != Material::kGlass && piece.material != Material::kScreen) continue;
    Pane pane;
    pane.material = piece.material;
    piece.part.half.minCoeff(&pane.axis);
    pane.inward = still.X_WS.position[pane.axis] > piece.part.centre[pane.axis] ? 1 : -1;
    pane.plane = piece.part.centre[pane.axis] + pane.inward * piece.part.half[pane.axis];
    pane.face = static_cast<std::uint16_t>(1 + 6 * i + static_cast<std::size_t>(2 * pane.axis) +
                                           (pane.inward > 0 ? 1U : 0U));
    pane.rect = raster_.prepare(piece.part, X_SW).rect;
    if (pane.rect.empty()) continue;
    if (pane.material == Material::kGlass) mirror_room(still, pane);
    for (std::size_t f = 1 + 6 * i; f < 7 + 6 * i; ++f) faces_[f].pane = true;
    still.panes.push_back(std::move(pane));
  }
}

// The room as the pane mirrors it: drawn behind the pane.
void StereoImager::mirror_room(Still& still, Pane& pane) {
  const Rigid X_SW = still.X_WS.inverse();
  const DrawRect& rect = pane.rect;
  std::fill(mirror_depth_.begin(), mirror_depth_.end(), 0.0F);
  std::fill(mirror_part_.begin(), mirror_part_.end(), -1);
  std::vector<Drawn> pieces;
  const RasterTarget target{width_, height_, mirror_depth_, mirror_part_};
  for (std::size_t i = 0; i < room_->size(); ++i) {
    const Part& part = (*room_)[i].part;
    pieces.push_back(
        prepare(mirrored(part, pane.axis, pane.plane), finish_of((*room_)[i], i), X_SW));
    pieces.back().shape.tag = static_cast<std::int32_t>(i);
    const double reach = pane.inward * (part.centre[pane.axis] - pane.plane) +
                         part.axes.row(pane.axis).cwiseAbs().dot(part.half);
    constexpr double kProud = 0.02;  // the pane itself and its wall mirror nothing
    if (reach < kProud) continue;
    pieces.back().shape.rect = common(pieces.back().shape.rect, rect);
    raster_.draw(pieces.back().shape, static_cast<std::int32_t>(i), target);
  }
  for (int v = rect.v; v < rect.v_end; ++v)
    for (int u = rect.u; u < rect.u_end; ++u) {
      const std::size_t pixel = at(u, v);
      std::uint16_t face = 0, albedo = 0;
      if (const std::int32_t index = mirror_part_[pixel]; index >= 0) {
        const auto i = static_cast<std::size_t>(index);
        albedo = still_albedo(pieces[i], (*room_)[i].surface, u, v, mirror_depth_[pixel], face);
      }
      pane.mirrored.push_back(mirror_depth_[pixel]);
      pane.albedo.push_back(albedo);
      pane.face_of.push_back(face);
    }
}

void StereoImager::light_faces(const Illumination& lit) {
  face_light_[0] = lit.light.outside / kAlbedoUnit;  // the sky has no albedo: see light_still
  for (std::size_t i = 1; i < faces_.size(); ++i) {
    face_light_[i] = diffuse_light(lit.light, faces_[i].n_W);
    face_sun_[i] = lit.light.sun * std::max(0.0F, faces_[i].n_W.dot(lit.light.to_sun));
  }
}

void StereoImager::find_sunlit(Still& still, const Illumination& lit) {
  if (!lit.patches.shining() || still.sun_step == lit.light.sun_step) return;
  still.sun_step = lit.light.sun_step;
  for (int v = 0; v < height_; ++v)
    for (int u = 0; u < width_; ++u) {
      const std::size_t pixel = at(u, v);
      const bool faces_sun = face_sun_[still.face[pixel]] > 0 && still.inverse_depth[pixel] > 0;
      still.sunlit[pixel] =
          faces_sun && lit.patches.lit(o_W_ + direction_W(u, v) / still.inverse_depth[pixel]) ? 1
                                                                                              : 0;
    }
}

void StereoImager::draw_parts(std::span<const VisiblePart> parts, const Rigid& X_SW) {
  drawn_.clear();
  changed_ = {width_, height_, 0, 0};
  const RasterTarget target{width_, height_, inverse_depth_, part_};
  for (const VisiblePart& visible : parts) {
    const Drawn drawn = prepare(visible.part, visible.finish, X_SW);
    const DrawRect& rect = drawn.shape.rect;
    if (rect.empty() || !drawn_.try_push_back(drawn)) continue;
    raster_.draw(drawn.shape, static_cast<std::int32_t>(drawn_.size() - 1), target);
    changed_ = {std::min(changed_.u, rect.u), std::min(changed_.v, rect.v),
                std::max(changed_.u_end, rect.u_end), std::max(changed_.v_end, rect.v_end)};
  }
}

void StereoImager::light_still(const Still& still, std::span<float> radiance) const {
  const bool sunny = std::any_of(face_sun_.begin(), face_sun_.end(), [](float s) { return s > 0; });
  for (std::size_t i = 0; i < radiance.size(); ++i) {
    // The sky, face 0, has albedo 0, taken for one unit.
    const float albedo = kAlbedoUnit * static_cast<float>(std::max<int>(still.albedo[i], 1));
    radiance[i] = albedo * face_light_[still.face[i]];
    if (sunny && still.sunlit[i] != 0) radiance[i] += albedo * face_sun_[still.face[i]];
  }
}

void StereoImager::light_parts(const Illumination& lit, std::span<float> radiance) const {
  for (int v = changed_.v; v < changed_.v_end; ++v)
    for (int u = changed_.u; u < changed_.u_end; ++u) {
      const std::size_t pixel = at(u, v);
      if (part_[pixel] < 0) continue;
      const float w = inverse_depth_[pixel];
      const Touch seen = touch(drawn_[static_cast<std::size_t>(part_[pixel])], u, v, w);
      float light = diffuse_light(lit.light, seen.n_W);
      if (lit.patches.shining()) {
        const float cosine = seen.n_W.dot(lit.light.to_sun);
        if (cosine > 0 && lit.patches.lit(o_W_ + direction_W(u, v) / w))
          light += lit.light.sun * cosine;
      }
      radiance[pixel] = seen.albedo * light;
    }
}

float StereoImager::reflection(const Pane& pane, int u, int v, std::size_t in_rect,
                               const Illumination& lit) const {
  const std::size_t pixel = at(u, v);
  if (const std::int32_t index = mirror_part_[pixel]; index >= 0) {
    const Touch seen =
        touch(reflected_[static_cast<std::size_t>(index)], u, v, mirror_depth_[pixel]);
    return seen.albedo * diffuse_light(lit.light, seen.n_W);
  }
  const std::uint16_t face = pane.face_of[in_rect];
  return face == 0 ? 0.0F
                   : kAlbedoUnit * static_cast<float>(pane.albedo[in_rect]) * face_light_[face];
}

// A screen shines by itself and its text runs; a window shows what passes by outside and, when it
// is dark there, the inside of the wagon, people included.
void StereoImager::light_pane(const Still& still, const Pane& pane,
                              std::span<const VisiblePart> parts, const Illumination& lit,
                              std::span<float> radiance) {
  const DrawRect& rect = pane.rect;
  const bool mirrors = pane.material == Material::kGlass && lit.light.outside < kDarkOutside;
  if (mirrors) {
    reflected_.clear();
    std::size_t next = 0;
    for (int v = rect.v; v < rect.v_end; ++v)
      for (int u = rect.u; u < rect.u_end; ++u) {
        mirror_depth_[at(u, v)] = pane.mirrored[next++];
        mirror_part_[at(u, v)] = -1;
      }
    const RasterTarget target{width_, height_, mirror_depth_, mirror_part_};
    const Rigid X_SW = still.X_WS.inverse();
    for (const VisiblePart& visible : parts) {
      Drawn drawn = prepare(mirrored(visible.part, pane.axis, pane.plane), visible.finish, X_SW);
      drawn.shape.rect = common(drawn.shape.rect, rect);
      if (drawn.shape.rect.empty() || !reflected_.try_push_back(drawn)) continue;
      raster_.draw(drawn.shape, static_cast<std::int32_t>(reflected_.size() - 1), target);
    }
  }
  const auto run = static_cast<float>(std::fmod(lit.light.seconds * 0.25, 4.0));  // metres of text
  const auto passed =
      static_cast<float>(std::fmod(lit.light.seconds * static_cast<double>(kTrainSpeed), 1e4));
  std::size_t next = 0;
  for (int v = rect.v; v < rect.v_end; ++v)
    for (int u = rect.u; u < rect.u_end; ++u, ++next) {
      const std::size_t pixel = at(u, v);
      if (part_[pixel] >= 0 || still.face[pixel] != pane.face) continue;
      const Vector3f d_W = direction_W(u, v);
      const int along = pane.axis == 0 ? 1 : 0;
      const float footprint = SurfaceTextures::kTexelsPerM / (focal_ * still.inverse_depth[pixel]);
      if (pane.material == Material::kScreen) {
        const Vector3f p_W = o_W_ + d_W / still.inverse_depth[pixel];
        const float a = (p_W[along] + run) * SurfaceTextures::kTexelsPerM;
        radiance[pixel] =
            0.35F * textures_->sample(Texture::kText, a, -p_W.z() * SurfaceTextures::kTexelsPerM,
                                      footprint);
        continue;
      }
      // Twenty metres away, a texel of 0.3 m.
      const float steepness = std::abs(d_W[pane.axis]) + 1e-3F;
      const float a = std::clamp(20 * d_W[along] / steepness, -200.0F, 200.0F) + passed;
      const float b = std::clamp(20 * d_W.z() / steepness, -200.0F, 200.0F);
      const float tile = std::fmod(a / 0.3F, 256.0F);
      radiance[pixel] = lit.light.outside * textures_->sample(Texture::kScenery, tile, b / 0.3F, 1);
      if (!mirrors) continue;
      const float grazing = 1 - std::abs(d_W[pane.axis]) / d_W.norm();
      const float share = 0.12F + 0.88F * grazing * grazing * grazing * grazing * grazing;
      radiance[pixel] += share * reflection(pane, u, v, next, lit);
    }
}

void StereoImager::render(std::size_t pose, std::span<const VisiblePart> parts,
                          const Illumination& lit, std::span<float> radiance) {
  Still& still = stills_[pose];
  shown_ = &still;
  choose(still);
  std::copy(still.inverse_depth.begin(), still.inverse_depth.end(), inverse_depth_.begin());
  std::fill(part_.begin(), part_.end(), -1);
  light_faces(lit);
  find_sunlit(still, lit);
  draw_parts(parts, still.X_WS.inverse());
  light_still(still, radiance);
  light_parts(lit, radiance);
  for (const Pane& pane : still.panes) light_pane(still, pane, parts, lit, radiance);
}

float StereoImager::inverse_depth(int u, int v) const {
  const std::size_t pixel = at(u, v);
  const bool pane = part_[pixel] < 0 && faces_[shown_->face[pixel]].pane;
  return pane ? 0.0F : inverse_depth_[pixel];
}

std::int32_t StereoImager::tag_at(int u, int v) const {
  const std::int32_t index = part_[at(u, v)];
  return index < 0 ? 0 : drawn_[static_cast<std::size_t>(index)].shape.tag;
}

}  // namespace wagonsight

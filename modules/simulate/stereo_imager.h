#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "base/bounded_vector.h"
#include "simulate/raster.h"
#include "simulate/room.h"
#include "simulate/surface_texture.h"
#include "simulate/wagon_light.h"

namespace wagonsight {

// How a part looks in visible light, besides its shape.
struct Finish {
  Texture texture = Texture::kCloth;
  float albedo = 0.4F;
  float a = 0, b = 0;  // where its texture begins, texels
};

// A part that moves, in W.
struct VisiblePart {
  Part part;
  Finish finish;
};

// Lights of an instant, as all imagers of a scene have them.
struct Illumination {
  WagonLight light;
  SunPatches patches;
};

// One imager of a stereo camera: what it sees as radiance, cast exactly (see Raster). The still
// wagon is drawn once for every pose that the imager ever has. Allocates when made and in
// add_pose(). One thread.
class StereoImager {
 public:
  StereoImager(const Scene& scene, const std::vector<RoomPart>& room,
               const SurfaceTextures& textures, const Camera& camera);

  // The still wagon from X_WS (of this imager); its index is how many there were before.
  void add_pose(const Rigid& X_WS);

  // What is seen of the room and `parts`: radiance, one value a pixel, relative to a white surface
  // on a bright day.
  void render(std::size_t pose, std::span<const VisiblePart> parts, const Illumination& lit,
              std::span<float> radiance);
  // Of the last render(): inverse depth (1/m); 0 where nothing is or a pane is seen.
  float inverse_depth(int u, int v) const;
  // Whose pixel it is: as KinectModel::tag_at.
  std::int32_t tag_at(int u, int v) const;

  const Raster& raster() const { return raster_; }

 private:
  static constexpr std::size_t kPartsMax = 8192;  // as a Kinect's
  static constexpr float kAlbedoUnit = 2.0F / 65535.0F;
  struct Face {
    Eigen::Vector3f n_W{0, 0, 1};
    bool pane = false;
  };
  struct Pane {
    Material material = Material::kGlass;
    int axis = 1;            // of its normal
    double plane = 0;        // where it stands along it
    int inward = 1;          // +1: the room lies towards larger coordinates
    std::uint16_t face = 0;  // the one that is seen
    DrawRect rect;
    std::vector<float> mirrored;  // of the rect: inverse depth of the still reflection
    std::vector<std::uint16_t> albedo, face_of;  // likewise
  };
  struct Still {
    Rigid X_WS;
    std::vector<float> inverse_depth;
    std::vector<std::uint16_t> albedo, face;  // face 0: nothing, the sky
    std::vector<std::uint8_t> sunlit;
    std::int64_t sun_step = -1;
    std::vector<Pane> panes;
  };
  struct Drawn {
    PreparedPart shape;
    std::array<float, 3> texels{};  // of a half size
    Finish finish;
  };
  // A point of a part, seen.
  struct Touch {
    Eigen::Vector3f n_W;
    float albedo;
  };

  std::size_t at(int u, int v) const {
    return static_cast<std::size_t>(v) * static_cast<std::size_t>(width_) +
           static_cast<std::size_t>(u);
  }
  Eigen::Vector3f direction_W(int u, int v) const {
    return R_WS_ * Eigen::Vector3f(raster_.ray_x(u), raster_.ray_y(v), 1.0F);
  }
  void choose(const Still& still);
  Drawn prepare(const Part& part, const Finish& finish, const Rigid& X_SW) const;
  Touch touch(const Drawn& drawn, int u, int v, float w) const;
  std::uint16_t still_albedo(const Drawn& drawn, Surface surface, int u, int v, float w,
                             std::uint16_t& face) const;
  void draw_still(Still& still);
  void find_panes(Still& still);
  void mirror_room(Still& still, Pane& pane);
  void light_faces(const Illumination& lit);
  void find_sunlit(Still& still, const Illumination& lit);
  void draw_parts(std::span<const VisiblePart> parts, const Rigid& X_SW);
  void light_still(const Still& still, std::span<float> radiance) const;
  void light_parts(const Illumination& lit, std::span<float> radiance) const;
  void light_pane(const Still& still, const Pane& pane, std::span<const VisiblePart> parts,
                  const Illumination& lit, std::span<float> radiance);
  float reflection(const Pane& pane, int u, int v, std::size_t in_rect,
                   const Illumination& lit) const;

  const Scene* scene_;
  const std::vector<RoomPart>* room_;
  const SurfaceTextures* textures_;
  Raster raster_;
  int width_, height_;
  float focal_;
  std::vector<Still> stills_;
  const Still* shown_ = nullptr;  // by the last render()
  std::vector<Face> faces_;       // of the room; the same in every pose
  std::vector<float> face_light_, face_sun_;
  Eigen::Matrix3f R_WS_ = Eigen::Matrix3f::Identity();
  Eigen::Vector3f o_W_ = Eigen::Vector3f::Zero();
  BoundedVector<Drawn> drawn_, reflected_;
  std::vector<float> inverse_depth_, mirror_depth_;
  std::vector<std::int32_t> part_, mirror_part_;  // index into drawn_ or reflected_, or -1
  DrawRect changed_;
};

}  // namespace wagonsight

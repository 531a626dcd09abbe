#pragma once

#include <Eigen/Core>
#include <vector>

#include "base/fixed_vector.h"
#include "geometry/camera.h"
#include "rig/rig.h"
#include "simulate/part.h"
#include "simulate/scene.h"
#include "wagon/wagon.h"

// What stands still in a scene: shell, furniture, panes, doorways; and the same as the rest of
// wagonsight wants to have it told: a Wagon and a Rig.
namespace wagonsight {

// What a part of the room is, which decides what it looks like.
enum class Surface : std::uint8_t { kFurniture, kFloor, kCeiling, kWall, kGround, kSeat };

struct RoomPart {
  Part part;
  Material material = Material::kPlain;
  Surface surface = Surface::kFurniture;
};

inline constexpr double kSeatHeight = 0.44, kSeatDepth = 0.46, kBackrestHeight = 1.15;

// Solids of the static room in W. Allocates.
std::vector<RoomPart> room_of(const Scene& scene);

// A door's middle and the unit vector that leads through it into the wagon.
struct Doorway {
  Eigen::Vector2d middle = Eigen::Vector2d::Zero(), inward = Eigen::Vector2d::UnitY(),
                  along = Eigen::Vector2d::UnitX();
  double width = 1;
};
Doorway doorway_of(const Scene& scene, const SceneDoor& door);
inline constexpr double kDoorHeight = 2.0;

// Two leaves that slide apart in the thickness of the wall; `open` is 0..1.
void place_door_leaves(const Doorway& way, double open, FixedVector<Part, 40>& parts);

// The wagon in the form of the settings: its inside ends 4 cm before the walls and the ceiling.
Wagon wagon_of(const Scene& scene);

// The depth camera of a simulated Kinect: 640 x 480, f = 580 px, no distortion.
Camera kinect_camera();
inline constexpr double kKinectBaseline = 0.075;  // camera to projector, along +x of S

// The imagers of a simulated stereo camera: 769 x 448, f about 520 px, 8 cm apart, mounted as well
// as such cameras are (every one a little different, none distorts).
StereoGeometry stereo_imagers(std::size_t sensor);

// The true calibration of the scene's sensors.
Rig rig_of(const Scene& scene);

// The same with poses that are wrong at random: standard deviations in metres and radians.
Rig perturbed(Rig rig, double position_sigma, double rotation_sigma, std::uint64_t seed);

}  // namespace wagonsight

#pragma once

#include <cstddef>

// Every capacity of the appliance, each with its reason. Memory is these sums and nothing else;
// it is allocated at start-up and never grows.
namespace wagonsight {

// The paper's rig is four Kinects and six stereo cameras; sixteen leaves room for a longer wagon
// and lets a set of sensors be one 16-bit word.
inline constexpr std::size_t kSensorsMax = 16;

// The largest single image: 1920 x 1080. Buffers are sized by the sensors of the rig at start-up;
// this only bounds what a setting, a blob or an import may ask for.
inline constexpr std::size_t kImagePixelsMax = std::size_t{1920} * 1080;

// A metro wagon of 18 m with four passengers a square metre holds about 180; one unit sees a part.
inline constexpr std::size_t kPeopleMax = 128;

// Tracks outlive detections by their coasting time, so there are more of them than people.
inline constexpr std::size_t kTracksMax = 256;

// Zones, seats, doors and masks are drawn by a person; these are far above what one wagon has.
inline constexpr std::size_t kZonesMax = 32;
inline constexpr std::size_t kZoneCornersMax = 16;
inline constexpr std::size_t kSeatsMax = 128;
inline constexpr std::size_t kDoorsMax = 16;
inline constexpr std::size_t kMasksMax = 64;

// Blobs of one sensor in one frame; a Kinect frame of a crowd has a few dozen.
inline constexpr std::size_t kBlobsMax = 256;

// Foreground points after the voxel grid, per sensor and fused. A person seen from one side at
// 2 cm has about 1,500; forty people from four sides are 240,000, bounded by the wagon's own air.
inline constexpr std::size_t kSensorPointsMax = 65'536;
inline constexpr std::size_t kFusedPointsMax = 262'144;

// Events that are told at one instant.
inline constexpr std::size_t kEventsMax = 64;

}  // namespace wagonsight

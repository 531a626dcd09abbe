#pragma once

#include <cstddef>
#include <cstdint>

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
// 2 cm has about 1,500; five people who fill half of a Kinect's image at 2 to 5 m are 20,000. Forty
// people have 180,000 voxels of skin and clothes, of which a crowd hides the most: sensors see each
// other's points too, so what they contribute is more than what is fused. The most in scenes rush
// and crowd: 17,317 a sensor, 48,277 fused from 60,667.
inline constexpr std::size_t kSensorPointsMax = 32'768;
inline constexpr std::size_t kFusedPointsMax = 65'536;
inline constexpr std::size_t kContributionsMax = 81'920;

// Bricks (8 x 8 x 8 leaves) of one octree. At 2 cm leaves 65,536 of them are 268 m3 of air: a wagon
// of 20 x 2.8 x 2.4 m is 33,000, the class room of a typical import 41,000. One buffer of bits is
// then at most 65,536 x 64 bytes = 4 MiB; a box that needs more must choose a larger leaf.
inline constexpr std::size_t kBrickLeaves = 512;
inline constexpr std::size_t kBrickBytes = kBrickLeaves / 8;
inline constexpr std::size_t kOctreeBricksMax = 65'536;
static_assert(kOctreeBricksMax * kBrickBytes == std::size_t{4} * 1024 * 1024);
static_assert(kOctreeBricksMax * kBrickLeaves <= UINT32_MAX, "a leaf's address is 32 bits");

// Nodes (4 x 4 x 4 leaves) in which one sensor can gather evidence at a time: surfaces and what
// moves before them, not the air. 60 m2 of surface at 2 cm pass through some 9,400 of them, with
// the noise at 5 m through twice as many; people who pass while a whole recording is learned fill
// as many again. Two counters a leaf, 152 bytes a node: 10 MB at most, for replays.
inline constexpr std::size_t kEvidenceNodesMax = 65'536;
// A unit that learns as it goes gives nodes back, and its memory is resident from the start. A
// Kinect among 20 or 40 passengers (simulated scenes rush and crowd) had 6,166 nodes at the most.
inline constexpr std::size_t kLiveEvidenceNodesMax = 9'216;

// Runs of foreground pixels of one image row, over all rows: 480 rows of a Kinect with 34 runs each
// are half noise; rush has 5,177 at the most.
inline constexpr std::size_t kRunsMax = 16'384;

// Events that are told at one instant.
inline constexpr std::size_t kEventsMax = 64;

}  // namespace wagonsight

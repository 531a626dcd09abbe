#pragma once

namespace wagonsight::bench {

// Each registers its entries for every scene.
void register_chain();
void register_pcl();
void register_fuse_and_record();

// The same choices for every contestant.
inline constexpr double kLeaf_m = 0.05;
inline constexpr double kVoxel_m = 0.02;
inline constexpr double kCluster_m = 0.06;
inline constexpr unsigned kClusterPointsMin = 100;

}  // namespace wagonsight::bench

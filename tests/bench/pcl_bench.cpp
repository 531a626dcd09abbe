#include <benchmark/benchmark.h>
#include <pcl/common/transforms.h>
#include <pcl/filters/extract_indices.h>
#include <pcl/filters/filter.h>
#include <pcl/filters/passthrough.h>
#include <pcl/filters/voxel_grid.h>
#include <pcl/octree/octree_pointcloud_changedetector.h>
#include <pcl/octree/octree_search.h>
#include <pcl/search/kdtree.h>
#include <pcl/segmentation/extract_clusters.h>

#include <bit>
#include <string>
#include <vector>

#include "bench/benchmarks.h"
#include "bench/heap_count.h"
#include "bench/scenes.h"
#include "foreground/background.h"

// PCL 1.13 on the same frames: the paper's steps as PCL's own classes. Its chain has no blob step
// in the image plane (after NaN removal there is no image plane), which costs PCL nothing.
namespace wagonsight::bench {
namespace {

using Point = pcl::PointXYZ;
using Cloud = pcl::PointCloud<Point>;
using Octree = pcl::octree::OctreePointCloudSearch<Point>;
using ChangeDetector = pcl::octree::OctreePointCloudChangeDetector<Point>;

// A cube that starts where our grid starts and is a power of two of leaves wide, so that PCL's
// leaves are ours.
template <class Tree>
void align(Tree& tree, const Eigen::Vector3d& min) {
  const double width = kLeaf_m * 512;
  tree.defineBoundingBox(min.x(), min.y(), min.z(), min.x() + width, min.y() + width,
                         min.z() + width);
}

Eigen::Vector3d grid_min(const BenchScene& scene) {
  // As ForegroundExtractor: 0.3 m around the inside. PCL throws for points outside of a box; the
  // trim keeps them inside here because the box is 25.6 m wide and starts a sensor's reach before.
  return scene.wagon.inside.min.array() - 0.3 - kLeaf_m * 128;
}

Cloud::Ptr to_cloud(const BenchScene& scene, const Frame& frame) {
  Cloud::Ptr cloud(new Cloud);
  cloud->resize(frame.size());
  cloud->is_dense = false;
  for (std::size_t i = 0; i < frame.size(); ++i) {
    Point& p = (*cloud)[i];
    if (frame[i] == 0 || scene.rays[i].x == kNoRay) {
      p.x = p.y = p.z = std::numeric_limits<float>::quiet_NaN();
      continue;
    }
    p.z = static_cast<float>(frame[i]) * 0.001F;
    p.x = static_cast<float>(scene.rays[i].x) * kRayScale * p.z;
    p.y = static_cast<float>(scene.rays[i].y) * kRayScale * p.z;
  }
  return cloud;
}

// Lines 4 and 5 of Algorithm 1, and the transform to W.
Cloud::Ptr trimmed_in_world(const BenchScene& scene, const Frame& frame) {
  const Cloud::Ptr cloud = to_cloud(scene, frame);
  Cloud::Ptr valid(new Cloud), trimmed(new Cloud), world(new Cloud);
  pcl::Indices indices;
  pcl::removeNaNFromPointCloud(*cloud, *valid, indices);
  pcl::PassThrough<Point> trim;
  trim.setInputCloud(valid);
  trim.setFilterFieldName("z");
  trim.setFilterLimits(static_cast<float>(scene.sensor.trim_near),
                       static_cast<float>(scene.sensor.trim_far));
  trim.filter(*trimmed);
  Eigen::Affine3d X_WS = Eigen::Translation3d(scene.sensor.X_WS.position) *
                         Eigen::Affine3d(scene.sensor.X_WS.rotation);
  pcl::transformPointCloud(*trimmed, *world, X_WS.matrix().cast<float>());
  return world;
}

// Voxel grid and clusters of what is left (line 12 and the clusters downstream).
std::size_t clusters_of(const Cloud::Ptr& foreground) {
  Cloud::Ptr reduced(new Cloud);
  pcl::VoxelGrid<Point> grid;
  grid.setInputCloud(foreground);
  const auto voxel = static_cast<float>(kVoxel_m);
  grid.setLeafSize(voxel, voxel, voxel);
  grid.filter(*reduced);
  if (reduced->empty()) return 0;
  pcl::search::KdTree<Point>::Ptr tree(new pcl::search::KdTree<Point>);
  tree->setInputCloud(reduced);
  std::vector<pcl::PointIndices> clusters;
  pcl::EuclideanClusterExtraction<Point> extraction;
  extraction.setClusterTolerance(kCluster_m);
  extraction.setMinClusterSize(static_cast<int>(kClusterPointsMin));
  extraction.setMaxClusterSize(1'000'000);
  extraction.setSearchMethod(tree);
  extraction.setInputCloud(reduced);
  extraction.extract(clusters);
  return clusters.size();
}

// The empty room as one point a leaf.
Cloud::Ptr background_of(const BenchScene& scene) {
  Cloud::Ptr all(new Cloud), result(new Cloud);
  for (const Frame& frame : scene.background) *all += *trimmed_in_world(scene, frame);
  Octree octree(kLeaf_m);
  align(octree, grid_min(scene));
  octree.setInputCloud(all);
  octree.addPointsFromInputCloud();
  std::vector<Point, Eigen::aligned_allocator<Point>> centres;
  octree.getOccupiedVoxelCenters(centres);
  for (const Point& p : centres) result->push_back(p);
  return result;
}

enum class Mode { kStaticQuery, kXor };

// What of a cloud is new, either way.
class Change {
 public:
  Change(const BenchScene& scene, Mode mode)
      : mode_(mode), background_(background_of(scene)), known_(kLeaf_m), detector_(kLeaf_m) {
    align(known_, grid_min(scene));
    align(detector_, grid_min(scene));
    known_.setInputCloud(background_);
    known_.addPointsFromInputCloud();
  }
  pcl::IndicesPtr changed(const Cloud::Ptr& cloud) {
    pcl::IndicesPtr result(new pcl::Indices);
    if (mode_ == Mode::kStaticQuery) {
      for (std::size_t i = 0; i < cloud->size(); ++i) {
        if (!known_.isVoxelOccupiedAtPoint((*cloud)[i])) result->push_back(static_cast<int>(i));
      }
      return result;
    }
    // The detector compares with the buffer before: the background goes in first.
    detector_.setInputCloud(background_);
    detector_.addPointsFromInputCloud();
    detector_.switchBuffers();
    detector_.setInputCloud(cloud);
    detector_.addPointsFromInputCloud();
    detector_.getPointIndicesFromNewVoxels(*result);
    detector_.switchBuffers();
    return result;
  }

 private:
  Mode mode_;
  Cloud::Ptr background_;
  Octree known_;
  ChangeDetector detector_;
};

// One frame. A function of its own, so that callgrind can count its instructions alone.
[[gnu::noinline]] std::size_t pcl_chain_frame(const BenchScene& scene, const Frame& frame,
                                              Change& change, std::size_t& pixels) {
  const Cloud::Ptr cloud = trimmed_in_world(scene, frame);
  const pcl::IndicesPtr indices = change.changed(cloud);
  Cloud::Ptr foreground(new Cloud);
  pcl::ExtractIndices<Point> extract;
  extract.setInputCloud(cloud);
  extract.setIndices(indices);
  extract.filter(*foreground);
  pixels += indices->size();
  return clusters_of(foreground);
}

void chain(benchmark::State& state, const BenchScene& scene, Mode mode) {
  Change change(scene, mode);
  std::size_t frame = 0, found = 0, pixels = 0;
  const long heap_before = heap_calls();
  for (auto _ : state) {
    found += pcl_chain_frame(scene, scene.frames[frame], change, pixels);
    frame = (frame + 1) % scene.frames.size();
  }
  const auto frames = static_cast<double>(state.iterations());
  state.counters["heap_calls"] = static_cast<double>(heap_calls() - heap_before) / frames;
  state.counters["foreground_share"] =
      static_cast<double>(pixels) / frames / static_cast<double>(scene.rays.size());
  state.counters["clusters"] = static_cast<double>(found) / frames;
}

// Foreground of both where it is defined alike: a reading whose own leaf is no background, without
// noise, inside the grid. Intersection over union of all frames.
double overlap(const BenchScene& scene) {
  const Eigen::Vector3d margin = Eigen::Vector3d::Constant(0.3);
  const auto grid =
      LeafGrid::cover(scene.wagon.inside.min - margin, scene.wagon.inside.max + margin, kLeaf_m);
  const SensorView view(scene.sensor, scene.rays, scene.wagon, *grid, 1e-6);
  BitOctree leaves(*grid);
  RayThresholds thresholds(view);
  for (const Frame& frame : scene.background) {
    for (std::size_t i = 0; i < frame.size(); ++i) {
      if (frame[i] < view.depth().raw_near() || frame[i] > view.depth().raw_far()) continue;
      if (!view.has_ray(i)) continue;
      const LeafAddress leaf = view.leaf_of(i, frame[i]);
      if (leaf != kNoLeaf && leaves.insert(leaf)) thresholds.leaf_added(view, leaves, leaf);
    }
  }
  Octree known(kLeaf_m);
  align(known, grid_min(scene));
  known.setInputCloud(background_of(scene));
  known.addPointsFromInputCloud();
  std::vector<std::uint64_t> foreground((scene.rays.size() + 63) / 64), unknown(foreground.size());
  double both = 0, either = 0;
  for (const Frame& frame : scene.frames) {
    thresholds.classify(view, leaves, scene.view(frame), foreground, unknown);
    for (std::size_t i = 0; i < frame.size(); ++i) {
      if (frame[i] < view.depth().raw_near() || frame[i] > view.depth().raw_far()) continue;
      if (!view.has_ray(i)) continue;
      const Eigen::Vector3f p = view.point_W(i, view.depth().z(frame[i]));
      const RawInterval inside = view.inside(i);
      if (frame[i] < inside.first || frame[i] > inside.last) continue;
      const bool ours = (((foreground[i / 64] | unknown[i / 64]) >> (i % 64)) & 1) != 0;
      const bool theirs = !known.isVoxelOccupiedAtPoint(Point(p.x(), p.y(), p.z()));
      both += ours && theirs ? 1 : 0;
      either += ours || theirs ? 1 : 0;
    }
  }
  return either == 0 ? 1 : both / either;
}

// The change alone: the cloud is there already, trimmed and in W, which ours has to make itself.
void mask(benchmark::State& state, const BenchScene& scene, Mode mode) {
  Change change(scene, mode);
  std::vector<Cloud::Ptr> clouds;
  for (const Frame& frame : scene.frames) clouds.push_back(trimmed_in_world(scene, frame));
  std::size_t frame = 0;
  const long heap_before = heap_calls();
  for (auto _ : state) {
    benchmark::DoNotOptimize(change.changed(clouds[frame]));
    frame = (frame + 1) % clouds.size();
  }
  state.counters["heap_calls"] =
      static_cast<double>(heap_calls() - heap_before) / static_cast<double>(state.iterations());
  if (mode == Mode::kStaticQuery) state.counters["overlap_with_wagonsight"] = overlap(scene);
}

}  // namespace

void register_pcl() {
  register_on_every_scene("chain/pcl/", chain, Mode::kStaticQuery);
  register_on_every_scene("chain/pcl_xor/", chain, Mode::kXor);
  register_on_every_scene("mask/pcl_octree/", mask, Mode::kXor);
  register_on_every_scene("mask/pcl_octree_query/", mask, Mode::kStaticQuery);
}

}  // namespace wagonsight::bench

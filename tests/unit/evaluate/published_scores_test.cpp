#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>
#include <string>

#include "evaluate/tracks.h"

// The scores that are published for these two sequences, to the third decimal.
namespace wagonsight {
namespace {

struct BoxList {
  std::vector<std::uint32_t> ids;
  std::vector<ImageBox> boxes;
};

// MOTChallenge's format: frame, id, left, top, width, height, confidence, ...
std::map<int, BoxList> read_boxes(const std::filesystem::path& path) {
  std::map<int, BoxList> frames;
  std::ifstream in(path);
  for (std::string line; std::getline(in, line);) {
    for (char& c : line) c = c == ',' ? ' ' : c;
    std::istringstream values(line);
    int frame = 0;
    std::uint32_t id = 0;
    ImageBox box;
    if (!(values >> frame >> id >> box.left >> box.top >> box.width >> box.height)) continue;
    frames[frame].ids.push_back(id);
    frames[frame].boxes.push_back(box);
  }
  return frames;
}

std::vector<TrackFrame> compare(const std::map<int, BoxList>& truth,
                                const std::map<int, BoxList>& found) {
  std::map<int, std::pair<BoxList, BoxList>> both;
  for (const auto& [frame, boxes] : truth) both[frame].first = boxes;
  for (const auto& [frame, boxes] : found) both[frame].second = boxes;
  std::vector<TrackFrame> frames;
  for (const auto& [number, lists] : both) {
    TrackFrame frame{lists.first.ids, lists.second.ids, {}};
    for (const ImageBox& a : lists.first.boxes) {
      for (const ImageBox& b : lists.second.boxes) {
        frame.similarity.push_back(intersection_over_union(a, b));
      }
    }
    frames.push_back(frame);
  }
  return frames;
}

struct Published {
  const char* name;
  double mota, motp, idf1, hota;
  std::size_t false_positives, misses, switches, fragmentations, mostly_tracked, mostly_lost;
};

class PublishedScores : public testing::TestWithParam<Published> {};

TEST_P(PublishedScores, AreReproduced) {
  const Published& expected = GetParam();
  const std::filesystem::path folder =
      std::filesystem::path(WAGONSIGHT_SOURCE_DIR) / "../shared/data/mot_scores";
  const std::string name = expected.name;
  if (!std::filesystem::exists(folder / (name + "_gt.csv"))) {
    GTEST_SKIP() << "the sequences with published scores are not beside the project";
  }
  const std::vector<TrackFrame> frames =
      compare(read_boxes(folder / (name + "_gt.csv")), read_boxes(folder / (name + "_hyp.csv")));
  const ClearMot clear = clear_mot(frames, match_frames(frames, 0.5));
  EXPECT_NEAR(clear.mota, expected.mota, 5e-4);
  EXPECT_NEAR(clear.motp, expected.motp, 5e-4);
  EXPECT_EQ(clear.false_positive_count, expected.false_positives);
  EXPECT_EQ(clear.miss_count, expected.misses);
  EXPECT_EQ(clear.switch_count, expected.switches);
  EXPECT_EQ(clear.fragmentation_count, expected.fragmentations);
  EXPECT_EQ(clear.mostly_tracked, expected.mostly_tracked);
  EXPECT_EQ(clear.mostly_lost, expected.mostly_lost);
  EXPECT_NEAR(identity(frames, 0.5).idf1, expected.idf1, 5e-4);
  EXPECT_NEAR(hota(frames).hota, expected.hota, 1e-4);
}

INSTANTIATE_TEST_SUITE_P(
    Tud, PublishedScores,
    testing::Values(Published{"tud_campus", 0.526, 0.277, 0.558, 0.3914, 13, 150, 7, 7, 1, 1},
                    Published{"tud_stadtmitte", 0.564, 0.346, 0.645, 0.3979, 45, 452, 7, 6, 5, 1}),
    [](const auto& sequence) { return std::string(sequence.param.name); });

}  // namespace
}  // namespace wagonsight

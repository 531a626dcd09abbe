#include <gmock/gmock.h>

#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

#include "program.h"

// Recordings of real cameras, where they are beside the project; nothing of them is in it.
namespace wagonsight {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;
using testing::write_text;

const testing::fs::path kData = WAGONSIGHT_SOURCE_DIR "/../shared/data";

class RealRecordings : public testing::ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    if (!testing::fs::exists(kData / "five_people"))
      GTEST_SKIP() << "the real recordings are not beside the project";
    // The camera of the whole series of depth folders, pixels counted from 0.
    write_text(at("series.toml"),
               "name = \"k0\"\nwidth = 640\nheight = 480\nfx = 567.9\nfy = 568.86\ncx = 311.12\n"
               "cy = 241.57\ndistortion = [0.0016, 0.0477, -0.00118, -0.00117, -0.2943]\n"
               "rate_hz = 4\ntrim_m = [0.5, 8.0]\n");
    write_text(at("cloud.toml"),
               "name = \"k0\"\nwidth = 640\nheight = 480\nfx = 525\nfy = 525\ncx = 319.5\n"
               "cy = 239.5\n");
  }
  // How many people at each instant; `ids` collects who.
  std::vector<std::size_t> counts(const std::string& folder, const std::string& camera,
                                  std::set<int>* ids = nullptr) {
    must_run(fmt::format("import --depth '{}' --camera {} --out r.mcap", (kData / folder).string(),
                         camera));
    said_ = must_run("replay r.mcap --out people.jsonl");
    std::vector<std::size_t> result;
    std::istringstream lines(testing::read_text(at("people.jsonl")));
    for (std::string line; std::getline(lines, line);) {
      const json people = json::parse(line).at("people");
      result.push_back(people.size());
      for (const json& person : people)
        if (ids != nullptr) ids->insert(person.at("id").get<int>());
    }
    return result;
  }
  testing::Outcome said_;
};

TEST_F(RealRecordings, ASingleCloudOfFivePeopleHoldsFive) {
  EXPECT_THAT(counts("five_people", "cloud.toml"), ::testing::ElementsAre(5));
  EXPECT_THAT(said_.out, HasSubstr("background none (1 frame"));
}

TEST_F(RealRecordings, AWalkerIsOnePersonForTwoCameras) {
  for (const char* camera : {"depth_two_cameras/cam1", "depth_two_cameras/cam2"}) {
    std::set<int> ids;
    const auto found = counts(camera, "series.toml", &ids);
    ASSERT_EQ(found.size(), 20U);
    EXPECT_EQ(ids.size(), 1U) << camera;
    for (std::size_t i = 0; i < 11; ++i) EXPECT_EQ(found[i], 0U) << camera << " " << i;
    for (std::size_t i = 15; i < 18; ++i) EXPECT_EQ(found[i], 1U) << camera << " " << i;
  }
  // The second one does not see the floor.
  EXPECT_THAT(said_.err, HasSubstr("give the pose in the camera file"));
}

TEST_F(RealRecordings, ObjectsOnATableAreNobody) {
  for (const char* camera : {"depth_objects_two_cameras/cam1", "depth_objects_two_cameras/cam2"})
    EXPECT_THAT(counts(camera, "series.toml"), ::testing::Each(0U)) << camera;
}

}  // namespace
}  // namespace wagonsight

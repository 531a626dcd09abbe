#include <gmock/gmock.h>

#include <cstdint>
#include <cstring>
#include <nlohmann/json.hpp>

#include "program.h"

namespace wagonsight {
namespace {

using ::testing::HasSubstr;
using testing::kCamera;
using testing::read_text;
using testing::write_text;

// A PGM of the small camera below whose depth is a ramp; `extra` tells frames apart.
std::string ramp_pgm(int extra) {
  std::string text = "P5\n# made by a test\n32 24\n65535\n";
  for (int i = 0; i < 32 * 24; ++i) {
    const int depth = i % 50 == 0 ? 0 : 1000 + i + extra;
    text += static_cast<char>(depth >> 8);
    text += static_cast<char>(depth & 0xFF);
  }
  return text;
}

constexpr std::string_view kSmallCamera =
    "name = \"c\"\nwidth = 32\nheight = 24\nfx = 30\nfy = 30\ncx = 16\ncy = 12\nrate_hz = 10\n";

class Import : public testing::ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    write_text(at("scene.toml"), testing::kSmallScene);
    write_text(at("camera.toml"), kCamera);
    write_text(at("small.toml"), kSmallCamera);
  }
  nlohmann::json inspect(const std::string& file) const {
    return nlohmann::json::parse(must_run("inspect --json " + file).out);
  }
  // The depths (z in the camera's frame) that a PLY exported without a pose holds.
  std::vector<float> depths(const std::string& recording, double time) const {
    must_run(fmt::format("export {} --time {} --out exported.ply", recording, time));
    const std::string ply = read_text(at("exported.ply"));
    constexpr std::string_view kEnd = "end_header\n";
    const std::size_t begin = ply.find(kEnd) + kEnd.size();
    std::vector<float> z;
    for (std::size_t i = begin; i + 12 <= ply.size(); i += 12) {
      float value = 0;
      std::memcpy(&value, ply.data() + i + 8, sizeof value);
      z.push_back(value);
    }
    return z;
  }
};

TEST_F(Import, TakesPngAsItWasSimulated) {
  must_run("simulate --scene scene.toml --seconds 0.2 --out sim.mcap --images images");
  must_run("import --depth images/k0 --camera camera.toml --out png.mcap");
  const auto simulated = inspect("sim.mcap");
  const auto imported = inspect("png.mcap");
  EXPECT_EQ(imported.at("frames"), simulated.at("frames"));
  EXPECT_EQ(imported.at("whole"), true);
  EXPECT_EQ(imported.at("sensors").at(0).at("has_pose"), false);
  EXPECT_GT(depths("png.mcap", 0.1).size(), 100'000U);
}

TEST_F(Import, TakesPgmInTheOrderOfNumbers) {
  // 9 before 10, though '1' sorts before '9'.
  for (const int i : {8, 9, 10, 11})
    write_text(at(fmt::format("pgm/frame{}.pgm", i)), ramp_pgm(i * 100));
  must_run("import --depth pgm --camera small.toml --out pgm.mcap");
  for (const int i : {0, 1, 2, 3}) {
    const auto z = depths("pgm.mcap", i * 0.1);
    ASSERT_EQ(z.size(), 32U * 24 - 16);  // every fiftieth pixel has no reading
    EXPECT_NEAR(z.at(0), 1.001 + 0.1 * (8 + i), 1e-6);
  }
}

TEST_F(Import, TakesEveryFormOfOrganisedPcd) {
  write_text(at("pgm/1.pgm"), ramp_pgm(0));
  must_run("import --depth pgm --camera small.toml --out pgm.mcap");
  const auto wanted = depths("pgm.mcap", 0);
  must_run("export pgm.mcap --time 0 --out cloud.pcd");
  const std::string binary = read_text(at("cloud.pcd"));
  EXPECT_THAT(binary, HasSubstr("WIDTH 32\nHEIGHT 24\n"));
  write_text(at("binary/1.pcd"), binary);
  must_run("import --depth binary --camera small.toml --out binary.mcap");
  EXPECT_EQ(depths("binary.mcap", 0), wanted);

  // As text, and packed by the Point Cloud Library where it is installed.
  const std::size_t begin = binary.find("DATA binary\n");
  std::string ascii = binary.substr(0, begin) + "DATA ascii\n";
  for (std::size_t i = begin + std::strlen("DATA binary\n"); i + 12 <= binary.size(); i += 12) {
    float p[3];
    std::memcpy(p, binary.data() + i, sizeof p);
    ascii += fmt::format("{} {} {}\n", p[0], p[1], p[2]);
  }
  write_text(at("ascii/1.pcd"), ascii);
  must_run("import --depth ascii --camera small.toml --out ascii.mcap");
  EXPECT_EQ(depths("ascii.mcap", 0), wanted);

  if (std::system("command -v pcl_convert_pcd_ascii_binary > /dev/null") != 0)  // NOLINT
    GTEST_SKIP() << "the Point Cloud Library's tools are not installed: its packed form and its "
                    "reading of our clouds are not checked";
  testing::fs::create_directories(at("packed"));
  const std::string convert = fmt::format(
      "cd '{}' && pcl_convert_pcd_ascii_binary cloud.pcd packed/1.pcd 2 > /dev/null 2>&1 && "
      "pcl_ply2pcd exported.ply from_ply.pcd > /dev/null 2>&1",
      folder_.string());
  ASSERT_EQ(std::system(convert.c_str()), 0);  // NOLINT: a test's own command
  EXPECT_THAT(read_text(at("packed/1.pcd")), HasSubstr("DATA binary_compressed"));
  must_run("import --depth packed --camera small.toml --out packed.mcap");
  EXPECT_EQ(depths("packed.mcap", 0), wanted);
  EXPECT_THAT(read_text(at("from_ply.pcd")), HasSubstr(fmt::format("POINTS {}", wanted.size())));
}

TEST_F(Import, ScalesTheUnitOfDepth) {
  write_text(at("pgm/1.pgm"), ramp_pgm(0));
  write_text(at("tenths.toml"), std::string(kSmallCamera) + "depth_unit_m = 0.0002\n");
  must_run("import --depth pgm --camera tenths.toml --out tenths.mcap");
  EXPECT_NEAR(depths("tenths.mcap", 0).at(0), 0.200, 1e-6);  // 1001 units, in millimetres
}

TEST_F(Import, IsTheSameBytesEveryTime) {
  write_text(at("pgm/1.pgm"), ramp_pgm(0));
  must_run("import --depth pgm --camera small.toml --out a.mcap");
  must_run("import --depth pgm --camera small.toml --out b.mcap");
  EXPECT_EQ(read_text(at("a.mcap")), read_text(at("b.mcap")));
}

TEST_F(Import, KeepsThePose) {
  write_text(at("pgm/1.pgm"), ramp_pgm(0));
  // Looks straight down from 2 m: z_W = 2 - depth.
  write_text(at("posed.toml"), std::string(kSmallCamera) +
                                   "[pose]\nposition = [1, 2, 2.0]\nrotation = [0, 1, 0, 0]\n");
  must_run("import --depth pgm --camera posed.toml --out posed.mcap");
  EXPECT_EQ(inspect("posed.mcap").at("sensors").at(0).at("has_pose"), true);
  EXPECT_NEAR(depths("posed.mcap", 0).at(0), 2.0 - 1.001, 1e-3);
}

}  // namespace
}  // namespace wagonsight

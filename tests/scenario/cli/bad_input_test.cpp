#include <gmock/gmock.h>

#include <algorithm>
#include <string>
#include <vector>

#include "program.h"

namespace wagonsight {
namespace {

using testing::kCamera;
using testing::write_text;

// A valid 8-bit grey PNG of one pixel.
constexpr unsigned char kGreyPng8[] = {
    0x89, 'P',  'N',  'G',  '\r', '\n', 0x1a, '\n', 0,    0,    0,    13,   'I',  'H',
    'D',  'R',  0,    0,    0,    1,    0,    0,    0,    1,    8,    0,    0,    0,
    0,    0x3a, 0x7e, 0x9b, 0x55, 0,    0,    0,    10,   'I',  'D',  'A',  'T',  0x78,
    0x9c, 0x63, 0x60, 0,    0,    0,    2,    0,    1,    0x48, 0xaf, 0xa4, 0x71, 0,
    0,    0,    0,    'I',  'E',  'N',  'D',  0xae, 0x42, 0x60, 0x82};

struct BadInput {
  std::string arguments;
  std::string message;  // the whole of standard error, without the program's name
};

class BadInputs : public testing::ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    write_text(at("camera.toml"), kCamera);
    write_text(at("scene.toml"), testing::kSmallScene);
    write_text(at("empty.mcap"), "");
    write_text(at("text.mcap"), "hello, this is no recording at all");
    write_text(at("newer.mcap"), "\x89MCAP1\r\n rest");
    write_text(at("png8/1.png"), {reinterpret_cast<const char*>(kGreyPng8), sizeof kGreyPng8});
    write_text(at("notpng/1.png"), "GIF89a and so on");
    write_text(at("pgm8/1.pgm"), "P5\n640 480\n255\n");
    write_text(at("size/1.pgm"), "P5\n2 1\n65535\nabcd");
    write_text(at("short/1.pgm"), "P5\n640 480\n65535\nabcd");
    write_text(at("mixed/1.pgm"), "P5\n2 1\n65535\nabcd");
    write_text(at("mixed/2.png"), "");
    write_text(at("flat/1.pcd"),
               "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 1\n"
               "POINTS 2\nDATA ascii\n1 1 1\n2 2 2\n");
    write_text(at("none/readme.txt"), "no image");
    write_text(at("typo.toml"), std::string(kCamera) + "focal = 580\n");
    write_text(at("nofx.toml"), "name = \"k0\"\nwidth = 640\nheight = 480\n");
    write_text(at("negative.toml"),
               "name = \"k0\"\nwidth = -640\nheight = 480\nfx = 1e3\nfy = 1e3\n"
               "cx = 320\ncy = 240\n");
    write_text(at("notoml.toml"), "name = \n");
    write_text(at("trim.toml"), std::string(kCamera) + "trim_m = [4, 2]\n");
    write_text(at("quaternion.toml"), std::string(kCamera) +
                                          "[pose]\nposition = [0, 0, 2]\n"
                                          "rotation = [90, 0, 0, 0]\n");
    write_text(at("nosensor.toml"), "[wagon]\nlength = 5\nwidth = 2.7\nheight = 2.4\n");
    write_text(at("people.jsonl"), "{\"time\":0.0,\"people\":[],\"events\":[]}\n");
    write_text(at("broken.jsonl"), "{\"time\":0.0,\"people\":[],\"events\":[]}\nnonsense\n");
  }

  void expect_each(const std::vector<BadInput>& table) const {
    for (const BadInput& bad : table) {
      const auto outcome = run(bad.arguments);
      const std::string command = bad.arguments.substr(0, bad.arguments.find(' '));
      EXPECT_EQ(outcome.exit_code, 1) << bad.arguments;
      EXPECT_EQ(outcome.err, fmt::format("wagonsight {}: {}\n", command, bad.message))
          << bad.arguments;
      EXPECT_EQ(outcome.out, "") << bad.arguments;
    }
  }
};

TEST_F(BadInputs, RecordingsAreRefusedByName) {
  expect_each({
      {"inspect none.mcap", "none.mcap cannot be opened: No such file or directory"},
      {"replay none.mcap --out o", "none.mcap cannot be opened: No such file or directory"},
      {"replay none --out o", "none is not a file"},
      {"replay empty.mcap --out o", "empty.mcap is empty; nothing was recorded"},
      {"replay text.mcap --out o",
       "text.mcap is not an MCAP recording (it does not begin with the MCAP mark)"},
      {"export newer.mcap --time 0 --out o.ply",
       "newer.mcap is MCAP of version '1', and only version '0' is known; convert it or update "
       "this program"},
      {"export text.mcap --time 0 --out cloud.xyz",
       "cloud.xyz ends neither in .ply nor in .pcd, so its form is not known"},
  });
}

TEST_F(BadInputs, ImagesAreRefusedByName) {
  const std::string rest = " --camera camera.toml --out o.mcap";
  expect_each({
      {"import --depth nowhere" + rest,
       "nowhere is not a folder that can be read: No such file or directory"},
      {"import --depth none" + rest,
       "none holds no .png, .pgm or .pcd file; give the folder that holds the depth images "
       "themselves"},
      {"import --depth png8" + rest,
       "png8/1.png is a PNG of 8-bit grey; depth must be 16-bit grey (millimetres, 0 for no "
       "reading)"},
      {"import --depth notpng" + rest, "notpng/1.png is not a PNG image, whatever its name says"},
      {"import --depth pgm8" + rest,
       "pgm8/1.pgm is a PGM with the maximum 255; depth must have 16 bits (a maximum of 256 to "
       "65535)"},
      {"import --depth size" + rest,
       "size/1.pgm is 2 x 1 pixels, but the camera file says 640 x 480"},
      {"import --depth short" + rest,
       "short/1.pgm is a damaged PGM: the file ends within the image"},
      {"import --depth mixed" + rest,
       "mixed/1.pgm and mixed/2.png are of different kinds; a folder must hold frames of one kind"},
      {"import --depth flat" + rest,
       "flat/1.pcd is 2 x 1 points, which is not organised; one point a pixel is needed"},
  });
}

TEST_F(BadInputs, CameraFilesAreRefusedByLineAndKey) {
  const auto with = [](const std::string& camera) {
    return "import --depth size --camera " + camera + " --out o.mcap";
  };
  expect_each({
      {with("typo.toml"),
       "typo.toml, line 9: focal is not known here; known are name, width, height, fx, fy, cx, cy, "
       "distortion, depth_unit_m, rate_hz, trim_m, pose"},
      {with("nofx.toml"), "nofx.toml, line 1: fx is missing"},
      {with("negative.toml"),
       "negative.toml, line 2: width is -640, but must be a whole number from 1 to 65535"},
      {with("trim.toml"),
       "trim.toml, line 9: trim_m is [4, 2], but must be [near, far] with 0 <= near < far <= 65"},
      {with("quaternion.toml"),
       "quaternion.toml, line 11: pose.rotation has the norm 90, but must be a unit quaternion "
       "[w, x, y, z]"},
  });
  EXPECT_EQ(run(with("notoml.toml")).exit_code, 1);
}

TEST_F(BadInputs, OthersAreRefusedByName) {
  expect_each({
      {"simulate --scene nosensor.toml --seconds 1 --out o.mcap",
       "nosensor.toml has no [[sensor]], so nothing sees its passengers; add one"},
      {"simulate --scene nowhere.toml --seconds 1 --out o.mcap",
       "nowhere.toml cannot be opened: No such file or directory"},
      {"evaluate --truth none.jsonl --people people.jsonl",
       "none.jsonl cannot be opened: No such file or directory"},
      {"simulate --scene scene.toml --seconds 1 --out /proc/nowhere/o.mcap",
       "/proc/nowhere/o.mcap cannot be written: No such file or directory"},
  });
  EXPECT_THAT(run("evaluate --truth broken.jsonl --people people.jsonl").err,
              ::testing::HasSubstr("broken.jsonl: "));
  EXPECT_THAT(run("inspect camera.toml").err,
              ::testing::HasSubstr("is neither a recording nor a calibration blob"));
}

}  // namespace
}  // namespace wagonsight

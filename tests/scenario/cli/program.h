#pragma once

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <string_view>

// Runs the real program in a folder of its own.
namespace wagonsight::testing {

namespace fs = std::filesystem;

struct Outcome {
  int exit_code = -1;
  std::string out, err;
};

inline std::string read_text(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

inline void write_text(const fs::path& path, std::string_view text) {
  fs::create_directories(path.parent_path());
  std::ofstream file(path, std::ios::binary);
  file.write(text.data(), static_cast<std::streamsize>(text.size()));
}

class ProgramTest : public ::testing::Test {
 protected:
  void SetUp() override {
    const auto* info = ::testing::UnitTest::GetInstance()->current_test_info();
    folder_ = fs::temp_directory_path() /
              fmt::format("wagonsight_{}_{}_{}", info->test_suite_name(), info->name(), ::getpid());
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  void TearDown() override {
    std::error_code ignored;
    fs::remove_all(folder_, ignored);
  }

  fs::path at(const std::string& name) const { return folder_ / name; }

  // `arguments` as typed in a shell whose folder is the test's.
  Outcome run(const std::string& arguments) const {
    return run_program(WAGONSIGHT_PROGRAM, arguments);
  }
  Outcome run_program(const char* program, const std::string& arguments) const {
    const fs::path out = folder_ / ".stdout";
    const fs::path err = folder_ / ".stderr";
    const std::string command =
        fmt::format("cd '{}' && '{}' {} > '{}' 2> '{}' < /dev/null", folder_.string(), program,
                    arguments, out.string(), err.string());
    const int status = std::system(command.c_str());  // NOLINT: a test's own command
    return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, read_text(out), read_text(err)};
  }

  // As run(), for steps that must succeed before the test itself begins.
  Outcome must_run(const std::string& arguments) const {
    Outcome outcome = run(arguments);
    EXPECT_EQ(outcome.exit_code, 0) << arguments << "\n" << outcome.err;
    return outcome;
  }

  fs::path folder_;
};

// A short corridor of a wagon with one camera and one passenger who walks through it.
inline constexpr std::string_view kSmallScene = R"(
[wagon]
length = 5.0
width = 2.7
height = 2.4
[[sensor]]
name = "k0"
kind = "kinect"
position = [0.1, 1.35, 2.2]
look_at = [3.0, 1.35, 0.6]
[[passenger]]
name = "p1"
height = 1.75
build = "adult"
start = [4.2, 0.8]
[[passenger.do]]
at = 0.5
act = "walk"
to = [1.8, 1.8]
)";

inline constexpr std::string_view kCamera = R"(name = "k0"
width = 640
height = 480
fx = 580.0
fy = 580.0
cx = 319.5
cy = 239.5
rate_hz = 30
)";

}  // namespace wagonsight::testing

#include <gmock/gmock.h>

#include <algorithm>

#include "program.h"

namespace wagonsight {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

class Usage : public testing::ProgramTest {};

constexpr std::array kCommands{"simulate", "import",   "record",  "replay", "evaluate", "inspect",
                               "export",   "diagnose", "devices", "bundle", "update"};

TEST_F(Usage, EveryCommandHasHelp) {
  const auto all = run("--help");
  EXPECT_EQ(all.exit_code, 0);
  for (const char* command : kCommands) {
    EXPECT_THAT(all.out, HasSubstr(command));
    const auto help = run(std::string(command) + " --help");
    EXPECT_EQ(help.exit_code, 0) << command;
    EXPECT_THAT(help.out, HasSubstr("Usage: wagonsight " + std::string(command)));
    EXPECT_EQ(help.err, "");
  }
}

TEST_F(Usage, VersionNamesTheBuild) {
  const auto version = run("--version");
  EXPECT_EQ(version.exit_code, 0);
  EXPECT_THAT(version.out, StartsWith("wagonsight 0."));
  EXPECT_THAT(version.out, HasSubstr("("));
}

TEST_F(Usage, WrongUsageIsTwoAndOneSentence) {
  for (const char* arguments :
       {"", "dance", "import", "import --depth", "replay", "replay a.mcap", "export a.mcap --out b",
        "export a.mcap --time soon --out b.ply", "simulate --scene s --seconds -1 --out r",
        "inspect", "inspect a b", "bundle", "bundle new-key", "update --to 10.0.0.1",
        "import --frames x", "evaluate --truth t"}) {
    const auto wrong = run(arguments);
    EXPECT_EQ(wrong.exit_code, 2) << arguments << ": " << wrong.err;
    EXPECT_EQ(wrong.out, "") << arguments;
    EXPECT_EQ(std::count(wrong.err.begin(), wrong.err.end(), '\n'), 1) << wrong.err;
    EXPECT_THAT(wrong.err, StartsWith("wagonsight"));
    EXPECT_THAT(wrong.err, HasSubstr("--help")) << arguments;
  }
}

}  // namespace
}  // namespace wagonsight

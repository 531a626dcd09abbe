#include "command_line.h"

#include <gmock/gmock.h>

#include <cstdlib>
#include <string>
#include <vector>

namespace wagonsight {
namespace {

using testing::HasSubstr;

Result<Command> read(std::vector<std::string> words) {
  words.insert(words.begin(), "wagonsightd");
  std::vector<char*> pointers;
  pointers.reserve(words.size() + 1);
  for (std::string& word : words) pointers.push_back(word.data());
  pointers.push_back(nullptr);
  return read_command(static_cast<int>(words.size()), pointers.data());
}

std::string complaint_about(std::vector<std::string> words) {
  const auto command = read(std::move(words));
  return command ? "none" : command.error().message;
}

TEST(CommandLine, EveryOptionArrives) {
  const auto command = read({"--config", "unit.toml", "--rig=rig.blob", "--port", "0", "--state",
                             "/run/w", "--updater", "/run/u"});
  ASSERT_TRUE(command) << command.error().message;
  EXPECT_EQ(command->kind, Command::Kind::kRun);
  EXPECT_EQ(command->options.config, "unit.toml");
  EXPECT_EQ(command->options.rig, "rig.blob");
  EXPECT_EQ(command->options.port, std::uint16_t{0});
  EXPECT_EQ(command->options.state_folder, "/run/w");
  EXPECT_EQ(command->options.updater, "/run/u");
}

TEST(CommandLine, WithoutAPortTheSettingsDecide) {
  const auto command = read({"--config", "unit.toml"});
  ASSERT_TRUE(command) << command.error().message;
  EXPECT_FALSE(command->options.port.has_value());
  EXPECT_FALSE(command->with_files);
}

TEST(CommandLine, ChecksInAnyOrder) {
  for (const auto& words : std::vector<std::vector<std::string>>{
           {"--config", "f", "--check-config", "--check-files"},
           {"--check-files", "--check-config", "--config", "f"}}) {
    const auto command = read(words);
    ASSERT_TRUE(command) << command.error().message;
    EXPECT_EQ(command->kind, Command::Kind::kCheck);
    EXPECT_TRUE(command->with_files);
  }
}

TEST(CommandLine, HelpAndVersionNeedNothingElse) {
  for (const char* word : {"--help", "-h"}) {
    const auto command = read({word});
    ASSERT_TRUE(command) << command.error().message;
    EXPECT_EQ(command->kind, Command::Kind::kHelp);
  }
  EXPECT_EQ(read({"--version"}).value().kind, Command::Kind::kVersion);
}

TEST(CommandLine, EachOptionIsInTheHelp) {
  for (const char* word : {"--config", "--rig", "--port", "--state", "--updater", "--check-config",
                           "--check-files", "--version", "--help"})
    EXPECT_THAT(std::string(kHelpText), HasSubstr(word));
}

TEST(CommandLine, MistakesAreNamed) {
  EXPECT_THAT(complaint_about({}), HasSubstr("--config is required"));
  EXPECT_THAT(complaint_about({"--config"}), HasSubstr("--config: its value is missing"));
  EXPECT_THAT(complaint_about({"--config", "f", "--prot", "1"}), HasSubstr("--prot: there is no"));
  EXPECT_THAT(complaint_about({"--config", "f", "-x"}), HasSubstr("-x: there is no"));
  EXPECT_THAT(complaint_about({"--config", "f", "stray"}), HasSubstr("stray: is not understood"));
  EXPECT_THAT(complaint_about({"--config", "f", "--check-config=yes"}),
              HasSubstr("--check-config"));
  for (const char* port : {"65536", "-1", "80x", "", "1e3"})
    EXPECT_THAT(complaint_about({"--config", "f", std::string("--port=") + port}),
                HasSubstr("must be a number from 0 to 65535"))
        << port;
}

TEST(CommandLine, SystemdsFolderGivesWayToTheOption) {
  setenv("RUNTIME_DIRECTORY", "/run/by-systemd", 1);
  EXPECT_EQ(read({"--config", "f"}).value().options.state_folder, "/run/by-systemd");
  EXPECT_EQ(read({"--config", "f", "--state", "/run/x"}).value().options.state_folder, "/run/x");
  unsetenv("RUNTIME_DIRECTORY");
}

}  // namespace
}  // namespace wagonsight

#include "linux/run_record.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>

namespace wagonsight {
namespace {

using testing::HasSubstr;

class RunRecordFile : public testing::Test {
 protected:
  void SetUp() override { std::filesystem::remove(path_); }
  void TearDown() override { std::filesystem::remove(path_); }

  // A run in a process of its own that comes to its end by `end`.
  template <class End>
  void run(End end) const {
    const pid_t child = fork();
    if (child == 0) {
      auto record = RunRecord::open(path_);
      if (!record) _exit(1);
      record->note_fatal_signals();
      record->alive(1.7e9);
      end(*record);
      _exit(0);
    }
    int status = 0;
    waitpid(child, &status, 0);
  }
  PreviousCrash next_run() const {
    auto record = RunRecord::open(path_);
    EXPECT_TRUE(record.has_value());
    const PreviousCrash previous = record->previous();
    record->ended();
    return previous;
  }

  std::string path_ = testing::TempDir() + "run_record_" + std::to_string(getpid());
};

TEST_F(RunRecordFile, FindsNothingTheFirstTimeAndAfterAGoodEnd) {
  EXPECT_FALSE(next_run().present);
  run([](RunRecord& record) { record.ended(); });
  EXPECT_FALSE(next_run().present);
}

TEST_F(RunRecordFile, NamesTheSignalAndTheTime) {
  run([](RunRecord&) { raise(SIGSEGV); });
  const PreviousCrash crash = next_run();
  EXPECT_TRUE(crash.present);
  EXPECT_EQ(crash.reason, "a bad memory access (SIGSEGV)");
  EXPECT_EQ(crash.unix_time, 1.7e9);
  EXPECT_LT(crash.age_s, 60);
  EXPECT_EQ(crash.recent, 1U);
}

TEST_F(RunRecordFile, LeavesTheSignalItsOwnEnding) {
  const pid_t child = fork();
  if (child == 0) {
    auto record = RunRecord::open(path_);
    record->note_fatal_signals();
    std::abort();
  }
  int status = 0;
  waitpid(child, &status, 0);
  EXPECT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGABRT);
  EXPECT_THAT(next_run().reason, HasSubstr("SIGABRT"));
}

TEST_F(RunRecordFile, TellsAKilledRunAndAFailedStart) {
  run([](RunRecord&) { raise(SIGKILL); });
  EXPECT_THAT(next_run().reason, HasSubstr("without a word"));
  run([](RunRecord& record) { record.failed("settings: line 3 is wrong"); });
  EXPECT_EQ(next_run().reason, "settings: line 3 is wrong");
}

TEST_F(RunRecordFile, CallsTheFourthCrashALoopAndAGoodEndNoCrash) {
  for (int i = 0; i < 3; ++i) run([](RunRecord&) { raise(SIGKILL); });
  {
    auto record = RunRecord::open(path_);
    EXPECT_EQ(record->previous().recent, 3U);
    EXPECT_FALSE(record->is_crash_loop());
  }  // goes without a word
  auto record = RunRecord::open(path_);
  EXPECT_TRUE(record->is_crash_loop());
  record->ended();
  EXPECT_EQ(next_run().recent, 4U);
}

TEST_F(RunRecordFile, StartsAnewWhereTheFileIsNoRecord) {
  std::ofstream(path_) << std::string(5000, 'x');
  EXPECT_FALSE(next_run().present);
  run([](RunRecord&) { raise(SIGKILL); });
  EXPECT_TRUE(next_run().present);
}

TEST(RunRecord, SaysWhyThereCanBeNone) {
  const auto record = RunRecord::open("/nowhere/run-record");
  ASSERT_FALSE(record.has_value());
  EXPECT_THAT(record.error().message, HasSubstr("/nowhere/run-record"));
}

}  // namespace
}  // namespace wagonsight

#pragma once

#include <cstdint>
#include <string>

#include "base/result.h"
#include "base/time.h"

namespace wagonsight {

// How the run before this one ended, when it did not end as it should.
struct PreviousCrash {
  bool present = false;
  double age_s = 0;          // since the last sign of life of the run that crashed
  double unix_time = 0;      // of that sign; 0: the clock was not synchronised
  std::string reason;        // "a bad memory access (SIGSEGV)"
  std::uint32_t recent = 0;  // crashes within the last kCrashLoopWindow, this one included
};

// A page of memory in a file that outlives the process, however it ends: the next run reads there
// when and why this one ended. It is to lie where a restart of the machine clears it (/run), for a
// power cut is no crash.
//
//   open() --- running ---+--- ended()          the next run finds nothing
//                         +--- failed(why)      ... finds why, as said
//                         +--- a fatal signal   ... finds its name
//                         +--- killed           ... finds that it ended without a word
class RunRecord {
 public:
  // The Error says why there can be no record; the unit runs without one as well. A file that is
  // not a record of this version is started anew.
  static Result<RunRecord> open(const std::string& path);
  RunRecord(RunRecord&& other) noexcept;
  RunRecord(const RunRecord&) = delete;
  RunRecord& operator=(const RunRecord&) = delete;
  RunRecord& operator=(RunRecord&&) = delete;
  ~RunRecord();  // says nothing: whoever ends well says so

  const PreviousCrash& previous() const { return previous_; }
  // So many crashes in so short a time that starting once more will not help.
  bool is_crash_loop() const { return previous_.recent >= kCrashLoopCount; }

  void alive(double unix_time);
  void ended();
  void failed(const std::string& why);
  // From now on a fatal signal writes its number here before it ends the process. One record a
  // process.
  void note_fatal_signals();

  static constexpr std::uint32_t kCrashLoopCount = 4;
  static constexpr Duration kCrashLoopWindow = std::chrono::minutes(3);

 private:
  struct Page;
  explicit RunRecord(Page* page);
  void read_previous();

  Page* page_;
  PreviousCrash previous_;
};

}  // namespace wagonsight

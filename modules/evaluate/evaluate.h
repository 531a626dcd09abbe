#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/result.h"
#include "evaluate/tracks.h"
#include "snapshot/snapshot.h"

// Holds what wagonsight says of people against the truth: who was there, where, in which posture,
// and whether each kept one identity. Works after the fact and allocates.
namespace wagonsight {

// What is scored of one person; a Person with all its views is a hundred times larger.
struct PersonSeen {
  std::uint32_t id = 0;
  std::array<double, 2> position{};  // on the floor, W, metres
  double height = 0;                 // metres; 0: not stated
  Posture posture = Posture::kUnknown;
};
struct Instant {
  double time = 0;  // seconds since the recording's start
  std::vector<PersonSeen> people;
};
Instant to_instant(const PeopleFrame& frame);

// A whole people file (INTERFACES: one JSON object a line). The Error names the line and what is
// wrong with it: not readable, time that goes backwards, the same person twice.
Result<std::vector<Instant>> parse_people_file(std::string_view text);

struct EvaluateOptions {
  double gate_m = 0.5;              // a match is at most this far apart
  double similarity_range_m = 1.0;  // similarity is 1 - distance / range, at least 0
};

struct CountScores {
  std::size_t instant_count = 0;
  double exact_share = 0;       // instants whose number of people is right; NaN without instants
  double off_by_one_share = 0;  // wrong by at most one
  double mean_error = 0;        // found minus truth: negative when people are missed
  double mean_absolute_error = 0;
  std::size_t empty_count = 0;              // instants without a soul
  std::size_t empty_with_people_count = 0;  // of these, where somebody was found
};

struct PositionScores {  // over the matches, metres; NaN without a match
  double mean_m = 0, median_m = 0, p95_m = 0, max_m = 0;
  double height_mean_absolute_m = 0;  // over matches with both heights stated
};

inline constexpr std::size_t kPostureCount = 4;  // as enum Posture
struct PostureScores {
  std::size_t compared_count = 0;  // matches whose true posture is known
  double agreed_share = 0;         // NaN without such a match
  // Truth by row, found by column, both as enum Posture.
  std::array<std::array<std::size_t, kPostureCount>, kPostureCount> confusion{};
};

struct AlignmentScores {
  std::size_t truth_count = 0;     // instants of the truth: all are scored
  std::size_t answered_count = 0;  // with a line of people within half a frame
  std::size_t unused_count = 0;    // lines of people that belong to no instant of the truth
  double frame_s = 0;              // the truth's median step
};

struct Scores {
  AlignmentScores alignment;
  ClearMot clear;  // motp in metres when the range is 1 m
  Identity identity;
  Hota hota;
  CountScores count;
  PositionScores position;
  PostureScores posture;
};

// Each instant of the truth is held against the nearest line of people in time, at most half a
// frame (the truth's median step) away; a line answers one instant only. An instant without an
// answer counts as one in which nobody was found. Both lists ascend in time.
Scores evaluate(std::span<const Instant> truth, std::span<const Instant> people,
                const EvaluateOptions& options = {});

// For a person: a table of lines. For a program: one JSON object; a score that does not exist
// (nothing to divide by) is null.
std::string to_table(const Scores& scores);
std::string to_json(const Scores& scores);

}  // namespace wagonsight

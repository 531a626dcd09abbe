#include "snapshot/json_lines.h"

#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "snapshot/json_text.h"

namespace wagonsight {
namespace {

double some_number() {
  return *rc::gen::inRange(-90'000'000, 90'000'000) / 1e5 / 3.0;
}

template <std::size_t N>
std::array<double, N> some_numbers() {
  std::array<double, N> values{};
  for (double& value : values) value = some_number();
  return values;
}

ViewAttributes some_view() {
  ViewAttributes view;
  view.sensor_index = *rc::gen::inRange<std::uint8_t>(0, kSensorsMax);
  view.pixels = *rc::gen::arbitrary<std::uint32_t>();
  for (int& edge : view.image_box) edge = *rc::gen::inRange(0, 2000);
  view.distance = static_cast<float>(some_number());
  view.visible_share = static_cast<float>(*rc::gen::inRange(0, 100)) / 100.0F;
  return view;
}

Person some_person() {
  Person person;
  person.id = *rc::gen::arbitrary<std::uint32_t>();
  person.position = some_numbers<2>();
  person.height = some_number();
  person.posture =
      *rc::gen::element(Posture::kUnknown, Posture::kStanding, Posture::kSitting, Posture::kLying);
  person.velocity = some_numbers<2>();
  person.sigma = some_numbers<2>();
  person.box = {some_numbers<3>(), some_numbers<3>(), some_number()};
  person.ellipsoid = {some_numbers<3>(), some_numbers<3>(), some_numbers<4>()};
  person.has_head = *rc::gen::arbitrary<bool>();
  if (person.has_head) person.head = some_numbers<3>();
  person.has_shoulders = *rc::gen::arbitrary<bool>();
  if (person.has_shoulders) {
    person.shoulder_left = some_numbers<3>();
    person.shoulder_right = some_numbers<3>();
  }
  const int views = *rc::gen::inRange(0, 3);
  for (int i = 0; i < views; ++i) person.views.push_back(some_view());
  person.since = some_number();
  person.last_seen = some_number();
  return person;
}

PeopleFrame some_frame() {
  PeopleFrame frame;
  frame.time = some_number();
  const int people = *rc::gen::inRange(0, 5);
  for (int i = 0; i < people; ++i) frame.people.push_back(some_person());
  const int events = *rc::gen::inRange(0, 4);
  for (int i = 0; i < events; ++i) {
    const auto kind = static_cast<EventKind>(*rc::gen::inRange(0, 8));
    // A damaged byte becomes the three of a replacement character, and a line that is read back is
    // cut at the evidence's capacity: only what fits even so comes back as it was.
    auto evidence = *rc::gen::string<std::string>();
    evidence.resize(std::min(evidence.size(), decltype(Event::evidence)::capacity() / 3));
    frame.events.push_back(
        {kind, *rc::gen::arbitrary<std::uint32_t>(), some_number(), evidence.c_str()});
  }
  const int skews = *rc::gen::inRange(0, 4);
  for (int i = 0; i < skews; ++i)
    frame.skews.push_back({Name("k" + std::to_string(9 - i)), some_number()});
  return frame;
}

std::string line_of(const PeopleFrame& frame) {
  std::string line;
  append_people_line(frame, true, line);
  return line;
}

TEST(PeopleLine, ComesBackAsItWas) {
  EXPECT_TRUE(rc::check("a line that is parsed and written again has the same bytes", [] {
    const PeopleFrame frame = some_frame();
    const std::string line = line_of(frame);
    RC_ASSERT(line.find('\n') == std::string::npos);
    const Result<PeopleFrame> back = parse_people_line(line);
    RC_ASSERT(back.has_value());
    RC_ASSERT(line_of(*back) == line);
    RC_ASSERT(back->people.size() == frame.people.size());
    for (std::size_t i = 0; i < frame.people.size(); ++i) {
      const Person &a = frame.people[i], &b = back->people[i];
      RC_ASSERT(a.id == b.id && a.posture == b.posture);
      RC_ASSERT(std::abs(a.position[0] - b.position[0]) <= 0.5001e-4);
      RC_ASSERT(std::abs(a.ellipsoid.rotation[3] - b.ellipsoid.rotation[3]) <= 0.5001e-6);
      RC_ASSERT(std::abs(a.box.size[2] - b.box.size[2]) <= 0.5001e-4);
      RC_ASSERT(a.has_head == b.has_head && a.views.size() == b.views.size());
    }
  }));
}

TEST(PeopleLine, IsTheFormOfTheContract) {
  PeopleFrame frame;
  frame.time = 12.345678;
  Person person;
  person.id = 3;
  person.position = {1.5, -0.00001};
  person.height = 1.74;
  person.posture = Posture::kStanding;
  frame.people.push_back(person);
  frame.events.push_back({EventKind::kFall, 3, 11.2, "low for 2 s"});
  frame.skews.push_back({"k1", 4.1});
  std::string truth;
  append_people_line(frame, false, truth);
  EXPECT_EQ(truth,
            R"({"time":12.345678,"people":[{"id":3,"position":[1.5000,0.0000],"height":1.7400,)"
            R"("posture":"standing","velocity":[0.0000,0.0000]}],"events":[{"kind":"fall",)"
            R"("person":3,"since":11.200000,"evidence":"low for 2 s"}],"skew_ms":{"k1":4.100}})");
}

TEST(PeopleLine, ReadsWhatAnotherProgramWrote) {
  const auto frame = parse_people_line(
      R"({"people":[{"id":7,"position":[1,2e0],"mood":"good"}],"time":3,"made_by":"x"})");
  ASSERT_TRUE(frame.has_value()) << frame.error().message;
  EXPECT_EQ(frame->people[0].id, 7U);
  EXPECT_DOUBLE_EQ(frame->people[0].position[1], 2.0);
}

TEST(PeopleLine, NamesTheKeyThatIsWrong) {
  const auto message = [](std::string_view line) {
    const auto frame = parse_people_line(line);
    return frame ? std::string("accepted") : frame.error().message;
  };
  EXPECT_EQ(message("{\"time\":"), "people line: is not JSON");
  EXPECT_EQ(message("[]"), "people line: line: must be an object");
  EXPECT_EQ(message(R"({"people":[]})"), "people line: time: is missing");
  EXPECT_EQ(message(R"({"time":1,"people":[{"id":-1,"position":[1,2]}]})"),
            "people line: people[0].id: must be a whole number of 32 bits, not negative");
  EXPECT_EQ(message(R"({"time":1,"people":[{"id":1,"position":[1,2]},{"id":2,"position":[1]}]})"),
            "people line: people[1].position: must be a list of 2 numbers");
  EXPECT_EQ(message(R"({"time":1,"people":[{"id":1,"position":[1,null]}]})"),
            "people line: people[0].position: must be a number");
  EXPECT_EQ(message(R"({"time":1,"people":[{"id":1,"position":[1,2],"posture":"flying"}]})"),
            "people line: people[0].posture: \"flying\" is not known");
}

TEST(PeopleLine, RefusesMoreThanFits) {
  std::string line = R"({"time":1,"people":[)";
  for (std::size_t i = 0; i <= kPeopleMax; ++i)
    line += std::string(i == 0 ? "" : ",") + R"({"id":1,"position":[1,2]})";
  const auto frame = parse_people_line(line + "]}");
  ASSERT_FALSE(frame.has_value());
  EXPECT_EQ(frame.error().message, "people line: people: has 129 entries, at most 128 fit");
}

TEST(JsonText, IsAlwaysValid) {
  EXPECT_TRUE(rc::check("any bytes become a valid JSON text", [] {
    const auto bytes = *rc::gen::container<std::string>(rc::gen::arbitrary<char>());
    std::string out;
    append_quoted(out, bytes);
    RC_ASSERT(nlohmann::json::accept(out));
  }));
}

TEST(JsonText, KeepsTextAsItIs) {
  EXPECT_TRUE(rc::check("what JSON's own writer accepts comes back unchanged", [] {
    const auto points = *rc::gen::container<std::vector<int>>(rc::gen::inRange(1, 0x800));
    std::string text;
    for (const int point : points) {
      if (point < 0x80) {
        text += static_cast<char>(point);
      } else {
        text += static_cast<char>(0xC0 | (point >> 6));
        text += static_cast<char>(0x80 | (point & 0x3F));
      }
    }
    std::string out;
    append_quoted(out, text);
    RC_ASSERT(nlohmann::json::parse(out).get<std::string>() == text);
  }));
}

// What the C++ library writes, without the sign of a zero.
std::string by_the_library(double value, int decimals) {
  std::array<char, 400> text{};
  const auto end = std::to_chars(text.data(), text.data() + text.size(), value,
                                 std::chars_format::fixed, decimals)
                       .ptr;
  std::string digits(text.data(), end);
  if (digits[0] == '-' && digits.find_first_not_of("-0.") == std::string::npos) digits.erase(0, 1);
  return digits;
}

TEST(JsonText, RoundsEveryNumberAsTheLibraryDoes) {
  ASSERT_TRUE(rc::check([] {
    const auto bits = *rc::gen::arbitrary<std::uint64_t>();
    const int decimals = *rc::gen::inRange(0, 12);
    const double any = std::bit_cast<double>(bits);
    // Every other one of a size that is measured, every third a tie.
    const double value = bits % 3 == 0 ? (static_cast<double>(bits >> 48U) + 0.5) /
                                             static_cast<double>(1U << (bits % 12U))
                         : bits % 2 == 0 || !std::isfinite(any)
                             ? static_cast<double>(static_cast<std::int64_t>(bits)) * 1e-15
                             : any;
    std::string out;
    append_number(out, value, decimals);
    RC_ASSERT(out == by_the_library(value, decimals));
  }));
}

TEST(JsonText, WritesNumbersWithoutSurprises) {
  const auto text = [](double value, int decimals) {
    std::string out;
    append_number(out, value, decimals);
    return out;
  };
  EXPECT_EQ(text(-0.00004, 4), "0.0000");
  EXPECT_EQ(text(-0.00006, 4), "-0.0001");
  EXPECT_EQ(text(-0.4, 0), "0");
  EXPECT_EQ(text(0.5, 0), "0");
  EXPECT_EQ(text(2.5, 0), "2");
  EXPECT_EQ(text(0.0625, 3), "0.062");
  EXPECT_EQ(text(9007199254740991.5, 1), "9007199254740992.0");
  EXPECT_EQ(text(9007199254740993e3, 0), "9007199254740993024");
  EXPECT_EQ(text(5e-324, 9), "0.000000000");
  EXPECT_EQ(text(1e22, 1), "10000000000000000000000.0");
  EXPECT_EQ(text(std::numeric_limits<double>::quiet_NaN(), 4), "null");
  EXPECT_EQ(text(std::numeric_limits<double>::infinity(), 4), "null");
}

}  // namespace
}  // namespace wagonsight

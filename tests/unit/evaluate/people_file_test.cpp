#include <gtest/gtest.h>

#include <memory>
#include <string>

#include "evaluate/evaluate.h"
#include "snapshot/json_lines.h"

namespace wagonsight {
namespace {

std::string line_of(double time, std::initializer_list<std::uint32_t> ids) {
  auto frame = std::make_unique<PeopleFrame>();
  frame->time = time;
  for (const std::uint32_t id : ids) {
    Person person;
    person.id = id;
    person.position = {1.25, 0.5};
    person.height = 1.7;
    person.posture = Posture::kSitting;
    EXPECT_TRUE(frame->people.try_push_back(person));
  }
  std::string line;
  append_people_line(*frame, true, line);
  return line + "\n";
}

TEST(PeopleFile, ReadsWhatIsWritten) {
  const auto instants = parse_people_file(line_of(0, {}) + "\n" + line_of(0.5, {3, 1}));
  ASSERT_TRUE(instants) << instants.error().message;
  ASSERT_EQ(instants->size(), 2U);
  EXPECT_TRUE((*instants)[0].people.empty());
  EXPECT_EQ((*instants)[1].time, 0.5);
  EXPECT_EQ((*instants)[1].people[0].id, 3U);
  EXPECT_EQ((*instants)[1].people[1].position[0], 1.25);
  EXPECT_EQ((*instants)[1].people[1].posture, Posture::kSitting);
}

TEST(PeopleFile, ReadsALastLineWithoutItsEnd) {
  std::string text = line_of(0, {1});
  text.pop_back();
  const auto instants = parse_people_file(text);
  ASSERT_TRUE(instants);
  EXPECT_EQ(instants->size(), 1U);
}

TEST(PeopleFile, NamesTheLineThatCannotBeRead) {
  const auto instants = parse_people_file(line_of(0, {1}) + "{\"time\":oops\n");
  ASSERT_FALSE(instants);
  EXPECT_EQ(instants.error().message.find("line 2: "), 0U) << instants.error().message;
}

TEST(PeopleFile, RefusesTimeThatGoesBack) {
  const auto instants = parse_people_file(line_of(1, {}) + line_of(0.5, {}));
  ASSERT_FALSE(instants);
  EXPECT_NE(instants.error().message.find("line 2: time goes back"), std::string::npos);
}

TEST(PeopleFile, RefusesAPersonTwiceInALine) {
  const auto instants = parse_people_file(line_of(1, {7, 2, 7}));
  ASSERT_FALSE(instants);
  EXPECT_NE(instants.error().message.find("person 7 is there twice"), std::string::npos);
}

}  // namespace
}  // namespace wagonsight

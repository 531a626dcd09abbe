#include <gmock/gmock.h>
#include <rapidcheck.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <rapidcheck/gtest.h>
#include <fstream>

#include "vehicle/vehicle_input.h"

namespace wagonsight {
namespace {

using ::testing::HasSubstr;

const std::vector<Name> kDoors{"left", "right front"};

std::string error_of(std::string_view line) {
  const auto signal = parse_signal_line(line, kDoors);
  return signal ? "" : signal.error().message;
}

TEST(SignalLine, TellsSpeedDoorsAndStops) {
  EXPECT_EQ(parse_signal_line("speed 13.9", kDoors)->speed, 13.9);
  const auto door = parse_signal_line("door right front open", kDoors);
  ASSERT_TRUE(door.has_value());
  EXPECT_EQ(door->door, 1U);
  EXPECT_EQ(door->door_state, DoorState::kOpen);
  EXPECT_EQ(parse_signal_line("door left closed", kDoors)->door_state, DoorState::kClosed);
  EXPECT_EQ(parse_signal_line("stop Bern Wankdorf", kDoors)->stop, "Bern Wankdorf");
  EXPECT_TRUE(parse_signal_line("stop -", kDoors)->stop.empty());
}

TEST(SignalLine, SaysWhatIsWrong) {
  EXPECT_THAT(error_of("speed fast"), HasSubstr("not a number"));
  EXPECT_THAT(error_of("speed 13.9 "), HasSubstr("not a number"));
  EXPECT_THAT(error_of("speed -1"), HasSubstr("between"));
  EXPECT_THAT(error_of("speed nan"), HasSubstr("between"));
  EXPECT_THAT(error_of("speed 1e300"), HasSubstr("between"));
  EXPECT_THAT(error_of("door left ajar"), HasSubstr("open or closed"));
  EXPECT_THAT(error_of("door middle open"), HasSubstr("no such door"));
  EXPECT_THAT(error_of("door open"), HasSubstr("needs a name"));
  EXPECT_THAT(error_of("stop"), HasSubstr("needs a name"));
  EXPECT_THAT(error_of(""), HasSubstr("none of"));
  EXPECT_THAT(error_of("speed\t3"), HasSubstr("printable"));
  EXPECT_THAT(error_of("stop " + std::string(60, 'x')), HasSubstr("too long"));
}

RC_GTEST_PROP(SignalLine, TakesAnyBytes, (const std::string& line)) {
  for (const char* word : {"", "speed ", "door ", "stop "})
    (void)parse_signal_line(word + line, kDoors);
}

// A train's gateway at the other end.
class Client {
 public:
  explicit Client(const std::string& path) : fd_(socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    path.copy(address.sun_path, sizeof address.sun_path - 1);
    connected_ = connect(fd_, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0;
  }
  ~Client() { close(fd_); }
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;
  bool connected() const { return connected_; }
  void say(std::string_view text) const {
    ASSERT_EQ(send(fd_, text.data(), text.size(), MSG_NOSIGNAL), static_cast<ssize_t>(text.size()));
  }
  bool was_closed() const {
    char byte = 0;
    return recv(fd_, &byte, 1, MSG_DONTWAIT) == 0;
  }

 private:
  int fd_;
  bool connected_ = false;
};

class Vehicle : public ::testing::Test {
 protected:
  void SetUp() override {
    path_ = ::testing::TempDir() + "vehicle_" + std::to_string(getpid()) + ".sock";
    unlink(path_.c_str());
    auto opened = VehicleInput::open({path_, kDoors, 10});
    ASSERT_TRUE(opened.has_value()) << opened.error().message;
    input_ = std::move(*opened);
  }
  const VehicleState& state() const { return input_->state(); }

  std::string path_;
  std::unique_ptr<VehicleInput> input_;
};

TEST_F(Vehicle, KnowsWhatItIsToldAndNothingElse) {
  EXPECT_FALSE(state().has_speed);
  EXPECT_EQ(state().doors[0], DoorState::kUnknown);
  const Client train(path_);
  train.say("speed 20\ndoor left closed\nsto");
  EXPECT_TRUE(input_->tick(100));
  EXPECT_TRUE(state().has_speed);
  EXPECT_EQ(state().speed, 20);
  EXPECT_EQ(state().doors[0], DoorState::kClosed);
  EXPECT_EQ(state().doors[1], DoorState::kUnknown);
  EXPECT_FALSE(state().has_stop);
  train.say("p Thun\nspeed 20\n");
  EXPECT_TRUE(input_->tick(101));
  EXPECT_EQ(state().stop, "Thun");
  train.say("speed 20\n");
  EXPECT_FALSE(input_->tick(102)) << "nothing new";
  EXPECT_EQ(state().lines, 5U);
  EXPECT_EQ(state().bad_lines, 0U);
}

TEST_F(Vehicle, ForgetsWhatIsNotRepeated) {
  const Client train(path_);
  train.say("speed 20\ndoor left open\nstop Thun\n");
  input_->tick(100);
  train.say("speed 21\n");
  input_->tick(105);
  EXPECT_TRUE(input_->tick(111));
  EXPECT_TRUE(state().has_speed);
  EXPECT_FALSE(state().has_stop);
  EXPECT_EQ(state().doors[0], DoorState::kUnknown);
  EXPECT_TRUE(input_->tick(116));
  EXPECT_FALSE(state().has_speed);
}

TEST_F(Vehicle, CountsAndNamesBadLinesAndGoesOn) {
  const Client train(path_);
  train.say("speed fast\n" + std::string(500, 'x') + "\nspeed 3\n\x01\x02\n");
  input_->tick(1);
  EXPECT_EQ(state().speed, 3);
  EXPECT_EQ(state().lines, 4U);
  EXPECT_EQ(state().bad_lines, 3U);
  EXPECT_EQ(state().last_bad, "\"??\": it is not printable ASCII");
  train.say("door back open\n");
  input_->tick(2);
  EXPECT_EQ(state().last_bad, "\"door back open\": the settings name no such door");
}

TEST_F(Vehicle, TakesAHundredLinesASecond) {
  const Client train(path_);
  std::string flood;
  for (int i = 1; i <= 300; ++i) flood += "speed " + std::to_string(i % 100) + "\n";
  train.say(flood);
  for (int i = 0; i < 5; ++i) input_->tick(1);
  EXPECT_EQ(state().lines, 300U);
  EXPECT_EQ(state().bad_lines, 200U);
  EXPECT_THAT(std::string(state().last_bad.view()), HasSubstr("100 lines a second"));
  train.say("speed 7\n");
  input_->tick(1.5);
  EXPECT_EQ(state().speed, 7);
}

TEST_F(Vehicle, ServesFourAndTakesAnotherWhenOneLeaves) {
  std::vector<std::unique_ptr<Client>> trains;
  for (int i = 0; i < 5; ++i) trains.push_back(std::make_unique<Client>(path_));
  input_->tick(1);
  EXPECT_EQ(state().refused_connections, 1U);
  EXPECT_TRUE(trains[4]->was_closed());
  EXPECT_FALSE(trains[3]->was_closed());
  trains.erase(trains.begin());
  input_->tick(2);
  const Client another(path_);
  another.say("speed 9\n");
  input_->tick(3);
  EXPECT_EQ(state().speed, 9);
}

TEST_F(Vehicle, ReplacesADeadSocketAndNothingElse) {
  struct stat status {};
  ASSERT_EQ(stat(path_.c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777U, 0660U);
  EXPECT_THAT(VehicleInput::open({path_, {}, 10}).error().message, HasSubstr("another program"));
  input_.reset();
  EXPECT_NE(stat(path_.c_str(), &status), 0) << "it is taken away";
  const int fd = socket(AF_UNIX, SOCK_STREAM, 0);  // bound by one who died
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  path_.copy(address.sun_path, sizeof address.sun_path - 1);
  ASSERT_EQ(bind(fd, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
  close(fd);
  EXPECT_TRUE(VehicleInput::open({path_, {}, 10}).has_value());
  std::ofstream(path_) << "a file";
  EXPECT_THAT(VehicleInput::open({path_, {}, 10}).error().message, HasSubstr("no socket"));
  unlink(path_.c_str());
  EXPECT_FALSE(VehicleInput::open({std::string(200, 'x'), {}, 10}).has_value());
}

}  // namespace
}  // namespace wagonsight

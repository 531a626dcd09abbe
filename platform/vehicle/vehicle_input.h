#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "base/result.h"
#include "vehicle/signal_line.h"

namespace wagonsight {

struct VehicleOptions {
  std::string socket;       // its path; a dead socket there is replaced, a living one is not
  std::vector<Name> doors;  // of the wagon, in its order
  double silence_s = 10;    // a signal that was not repeated for so long is unknown again
};

// Listens for a train's signals; see the README. One thread; nothing here ever waits.
class VehicleInput {
 public:
  static constexpr std::size_t kConnectionsMax = 4;
  static constexpr std::size_t kLineBytesMax = 96;
  static constexpr double kLinesPerSecondMax = 100;

  // The Error: the path cannot be used.
  static Result<std::unique_ptr<VehicleInput>> open(VehicleOptions options);
  ~VehicleInput();  // takes the socket away
  VehicleInput(const VehicleInput&) = delete;
  VehicleInput& operator=(const VehicleInput&) = delete;

  // Takes in what has come; true when the state is another than before. Some times a second.
  bool tick(double now_s);
  const VehicleState& state() const { return state_; }

 private:
  struct Connection {
    int fd = -1;
    std::array<char, kLineBytesMax> line{};
    std::size_t size = 0;
    bool is_overlong = false;  // the rest of the line is skipped
    double allowance = kLinesPerSecondMax;
    double allowed_s = 0;
  };

  VehicleInput(VehicleOptions options, int fd);
  void accept_connections(double now_s);
  void read(Connection& connection, double now_s);
  void take_byte(Connection& connection, char byte, double now_s);
  void take_line(Connection& connection, double now_s);
  void refuse(std::string_view line, std::string_view why);
  void apply(const VehicleSignal& signal, double now_s);
  void forget_silent(double now_s);

  VehicleOptions options_;
  int fd_;
  std::array<Connection, kConnectionsMax> connections_;
  VehicleState state_;
  bool changed_ = false;
  double speed_s_ = 0, stop_s_ = 0;  // when they were last told
  std::array<double, kDoorsMax> door_s_{};
};

}  // namespace wagonsight

#include "vehicle/vehicle_input.h"

#include <fmt/format.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

namespace wagonsight {
namespace {

constexpr std::size_t kBytesATick = 4096;  // of each connection; more waits in the socket
constexpr mode_t kMode = 0660;

sockaddr_un address_of(const std::string& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  path.copy(address.sun_path, sizeof address.sun_path - 1);
  return address;
}

// Whether somebody listens there.
bool is_alive(const sockaddr_un& address) {
  const int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  const int done = connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address);
  const bool refused = done != 0 && (errno == ECONNREFUSED || errno == ENOENT);
  close(fd);
  return !refused;
}

}  // namespace

Result<std::unique_ptr<VehicleInput>> VehicleInput::open(VehicleOptions options) {
  const std::string& path = options.socket;
  const auto failed = [&](std::string_view why) {
    return fail(fmt::format("vehicle.socket: {}: {}", path, why));
  };
  sockaddr_un address = address_of(path);
  if (path.size() >= sizeof address.sun_path) return failed("the path is too long for a socket");
  struct stat found {};
  if (lstat(path.c_str(), &found) == 0) {
    if (!S_ISSOCK(found.st_mode)) return failed("is there already and no socket");
    if (is_alive(address)) return failed("another program listens there");
    unlink(path.c_str());
  }
  const int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (fd < 0 || bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0 ||
      chmod(path.c_str(), kMode) != 0 || listen(fd, kConnectionsMax) != 0) {
    const int error = errno;
    if (fd >= 0) close(fd);
    return failed(std::strerror(error));
  }
  return std::unique_ptr<VehicleInput>(new VehicleInput(std::move(options), fd));
}

VehicleInput::VehicleInput(VehicleOptions options, int fd) : options_(std::move(options)), fd_(fd) {
  if (options_.doors.size() > kDoorsMax) options_.doors.resize(kDoorsMax);
  state_.is_listening = true;
  for (std::size_t i = 0; i < options_.doors.size(); ++i)
    state_.doors.push_back(DoorState::kUnknown);
}

VehicleInput::~VehicleInput() {
  for (const Connection& connection : connections_)
    if (connection.fd >= 0) close(connection.fd);
  close(fd_);
  unlink(options_.socket.c_str());
}

bool VehicleInput::tick(double now_s) {
  changed_ = false;
  accept_connections(now_s);
  for (Connection& connection : connections_)
    if (connection.fd >= 0) read(connection, now_s);
  forget_silent(now_s);
  return changed_;
}

void VehicleInput::accept_connections(double now_s) {
  for (std::size_t i = 0; i <= kConnectionsMax; ++i) {
    const int fd = accept4(fd_, nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK);
    if (fd < 0) return;
    auto* place = std::find_if(connections_.begin(), connections_.end(),
                               [](const Connection& connection) { return connection.fd < 0; });
    if (place == connections_.end()) {
      ++state_.refused_connections;
      close(fd);
      continue;
    }
    *place = {};
    place->fd = fd;
    place->allowed_s = now_s;
  }
}

void VehicleInput::read(Connection& connection, double now_s) {
  std::array<char, kBytesATick> bytes{};
  const ssize_t size = recv(connection.fd, bytes.data(), bytes.size(), MSG_DONTWAIT);
  if (size < 0 && (errno == EAGAIN || errno == EINTR)) return;
  if (size <= 0) {
    close(connection.fd);
    connection.fd = -1;
    return;
  }
  const double earned = kLinesPerSecondMax * std::max(0.0, now_s - connection.allowed_s);
  connection.allowance = std::min(kLinesPerSecondMax, connection.allowance + earned);
  connection.allowed_s = now_s;
  for (ssize_t i = 0; i < size; ++i)
    take_byte(connection, bytes[static_cast<std::size_t>(i)], now_s);
}

void VehicleInput::take_byte(Connection& connection, char byte, double now_s) {
  if (byte != '\n') {
    connection.is_overlong = connection.is_overlong || connection.size == connection.line.size();
    if (!connection.is_overlong) connection.line[connection.size++] = byte;
    return;
  }
  take_line(connection, now_s);
  connection.size = 0;
  connection.is_overlong = false;
}

void VehicleInput::take_line(Connection& connection, double now_s) {
  const std::string_view line(connection.line.data(), connection.size);
  ++state_.lines;
  if (connection.allowance < 1) return refuse(line, "there are more than 100 lines a second");
  connection.allowance -= 1;
  if (connection.is_overlong) return refuse(line, "it has more than 96 bytes");
  const auto signal = parse_signal_line(line, options_.doors);
  if (!signal) return refuse(line, signal.error().message);
  apply(*signal, now_s);
}

void VehicleInput::refuse(std::string_view line, std::string_view why) {
  ++state_.bad_lines;
  std::string shown(line.substr(0, 40));
  for (char& c : shown)
    if (c < ' ' || c > '~') c = '?';
  state_.last_bad = std::string_view(fmt::format("\"{}\": {}", shown, why));
}

void VehicleInput::apply(const VehicleSignal& signal, double now_s) {
  const VehicleState before = state_;
  switch (signal.kind) {
    case VehicleSignal::Kind::kSpeed:
      state_.has_speed = true;
      state_.speed = signal.speed;
      speed_s_ = now_s;
      break;
    case VehicleSignal::Kind::kDoor:
      state_.doors[signal.door] = signal.door_state;
      door_s_[signal.door] = now_s;
      break;
    case VehicleSignal::Kind::kStop:
      state_.has_stop = true;
      state_.stop = signal.stop;
      stop_s_ = now_s;
      break;
  }
  changed_ = changed_ || !says_the_same(before, state_);
}

// The train has gone silent, or whoever speaks for it: nothing is assumed.
void VehicleInput::forget_silent(double now_s) {
  const VehicleState before = state_;
  const auto is_old = [&](double told_s) { return now_s - told_s > options_.silence_s; };
  if (is_old(speed_s_)) state_.has_speed = false;
  if (is_old(stop_s_)) state_.has_stop = false;
  for (std::size_t i = 0; i < state_.doors.size(); ++i)
    if (is_old(door_s_[i])) state_.doors[i] = DoorState::kUnknown;
  changed_ = changed_ || !says_the_same(before, state_);
}

}  // namespace wagonsight

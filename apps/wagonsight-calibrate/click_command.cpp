// The click page's server, for as long as a person works on it.
#include <fmt/format.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <thread>

#include "calibrate/board_file.h"
#include "calibrate/imagers.h"
#include "click_site.h"
#include "commands.h"
#include "linux/files.h"
#include "linux/stop_signals.h"

namespace wagonsight {
namespace {

// By the name of the image's folder; both imagers of a stereo camera start alike.
Result<std::map<std::string, Camera>> read_cameras(const std::string& path) {
  std::map<std::string, Camera> cameras;
  if (path.empty()) return cameras;
  const auto text = read_file(path, kFileBytesMax);
  if (!text) return fail(text.error().message);
  const auto specs = parse_sensors(*text, path);
  if (!specs) return fail(specs.error().message);
  for (const Imager& imager : imagers_of(*specs)) {
    const auto& start = (*specs)[static_cast<std::size_t>(imager.sensor_index)].start;
    if (start) cameras[imager.name] = *start;
  }
  return cameras;
}

// What `solve` found is better than what was stated.
Result<void> take_solved(const std::string& path, std::map<std::string, Camera>& cameras) {
  if (path.empty()) return {};
  const auto solution = read_solution(path);
  if (!solution) return fail(solution.error().message);
  for (const ImagerSolution& imager : solution->imagers) cameras[imager.name] = imager.camera;
  return {};
}

}  // namespace

Result<void> run_click(const ClickArguments& arguments) {
  const StopSignals signals;
  const auto text = read_file(arguments.board, kFileBytesMax);
  if (!text) return fail(text.error().message);
  const auto board = parse_board_file(*text, arguments.board);
  if (!board) return fail(board.error().message);
  auto images = list_images(arguments.images);
  if (!images) return fail(images.error().message);
  auto cameras = read_cameras(arguments.sensors);
  if (!cameras) return fail(cameras.error().message);
  if (auto taken = take_solved(arguments.solution, *cameras); !taken) return taken;
  std::string targets = arguments.targets;
  if (targets.empty())
    targets =
        (std::filesystem::path(arguments.observations).parent_path() / "targets.json").string();
  auto session = ClickSession::open(*board, std::move(*images), {arguments.observations, targets});
  if (!session) return fail(session.error().message);
  const auto socket = listen_on("127.0.0.1", arguments.port);
  if (!socket) return fail(socket.error().message);
  ClickSite site(std::move(*session), std::move(*cameras), socket->port);
  HttpLimits limits;
  limits.body_bytes_max = std::size_t{4} << 20;  // the 40,000 corners of the largest board
  limits.write_time_max = std::chrono::seconds(60);
  HttpServer server(socket->fd, limits, site);
  fmt::print("http://127.0.0.1:{}/\n", socket->port);
  fmt::print(
      "Open this address in a browser; Ctrl-C ends. Every edit is saved at once to {} and {}.\n",
      arguments.observations, targets);
  std::fflush(stdout);
  std::thread serving([&] { server.run(); });
  while (!signals.wait(std::chrono::seconds(3600))) {
  }
  server.stop();
  serving.join();
  return {};
}

}  // namespace wagonsight

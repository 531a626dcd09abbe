// The real daemon with one simulated sensor: what happens to the frames when its web side is
// killed, stopped or flooded, and how it starts and ends. Waits are for things to happen.
#include <arpa/inet.h>
#include <dirent.h>
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spawn.h>
#include <sys/mman.h>
#include <sys/ptrace.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <memory>
#include <random>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "linux/clocks.h"
#include "recording/recording_reader.h"
#include "rig/blob.h"
#include "shared_block.h"
#include "simulate/room.h"
#include "simulate/scene.h"

namespace wagonsight {
namespace {

using testing::HasSubstr;
using testing::StartsWith;

constexpr auto kPause = std::chrono::milliseconds(20);
constexpr int kPauses = 6000;  // two minutes: a sanitizer on a busy machine is slow

template <class Condition>
bool comes_true(Condition condition) {
  for (int i = 0; i < kPauses; ++i) {
    if (condition()) return true;
    std::this_thread::sleep_for(kPause);
  }
  return false;
}

constexpr const char* kEmptyWagon = WAGONSIGHT_SOURCE_DIR "/config/scenes/empty.toml";

std::string settings_file(const std::string& more = "", const std::string& scene = kEmptyWagon) {
  std::string path = testing::TempDir() + "wagonsightd_test_" + std::to_string(getpid()) + ".toml";
  std::ofstream(path) << "[unit]\nname = \"test\"\n[demo]\nscene = \"" << scene
                      << "\"\n[[sensor]]\nname = \"k0\"\nkind = \"kinect\"\n"
                         "source = \"simulated\"\n[web]\nport = 0\n"
                      << more;
  return path;
}

struct Finished {
  int status = -1;
  std::string out, err;
};

// A child process whose outputs are pipes.
class Program {
 public:
  explicit Program(std::vector<std::string> arguments) {
    int out[2], err[2];
    if (pipe2(out, O_CLOEXEC) != 0 || pipe2(err, O_CLOEXEC) != 0) return;
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_adddup2(&actions, out[1], STDOUT_FILENO);
    posix_spawn_file_actions_adddup2(&actions, err[1], STDERR_FILENO);
    arguments.insert(arguments.begin(), WAGONSIGHTD);
    std::vector<char*> argv;
    argv.reserve(arguments.size() + 1);
    for (std::string& argument : arguments) argv.push_back(argument.data());
    argv.push_back(nullptr);
    posix_spawn(&pid_, WAGONSIGHTD, &actions, nullptr, argv.data(), environ);
    posix_spawn_file_actions_destroy(&actions);
    close(out[1]);
    close(err[1]);
    out_ = out[0];
    err_ = err[0];
  }
  ~Program() {
    if (pid_ > 0) {
      kill(pid_, SIGKILL);
      waitpid(pid_, nullptr, 0);
    }
    close(out_);
    close(err_);
  }
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;

  pid_t pid() const { return pid_; }
  std::string first_line() const {
    std::string line;
    char c = 0;
    while (read(out_, &c, 1) == 1 && c != '\n') line += c;
    return line;
  }
  Finished finish() {
    Finished done;
    int status = 0;
    std::thread errors([&] { done.err = rest(err_); });
    done.out = rest(out_);
    waitpid(pid_, &status, 0);
    errors.join();
    pid_ = -1;
    done.status = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    return done;
  }

 private:
  static std::string rest(int fd) {
    std::string text;
    char part[4096];
    for (ssize_t size = 0; (size = read(fd, part, sizeof part)) > 0;)
      text.append(part, static_cast<std::size_t>(size));
    return text;
  }
  pid_t pid_ = -1;
  int out_ = -1, err_ = -1;
};

std::string read_text(const std::string& path) {
  std::ifstream file(path);
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

// The daemon's shared memory, found as the kernel shows it and read as its readers do.
const SharedBlock* find_block(pid_t pid) {
  const std::string folder = "/proc/" + std::to_string(pid) + "/fd/";
  DIR* listing = opendir(folder.c_str());
  const SharedBlock* block = nullptr;
  while (const dirent* entry = listing != nullptr ? readdir(listing) : nullptr) {
    std::array<char, 256> target{};
    const std::string path = folder + entry->d_name;
    if (readlink(path.c_str(), target.data(), target.size() - 1) <= 0) continue;
    if (std::string_view(target.data()).find("memfd:wagonsight-snapshot") == std::string_view::npos)
      continue;
    const int fd = open(path.c_str(), O_RDONLY | O_CLOEXEC);
    if (auto mapped = map_shared_block(fd)) block = *mapped;
    close(fd);
    break;
  }
  if (listing != nullptr) closedir(listing);
  return block;
}

// How many frames of all sensors a recording holds.
std::uint64_t frames_of(const std::filesystem::path& path) {
  std::uint64_t frames = 0;
  const std::string text = read_text(path.string());
  auto reader = RecordingReader::open(std::as_bytes(std::span(text)), DamagePolicy::kStop);
  EXPECT_TRUE(reader.has_value());
  if (!reader) return frames;
  std::vector<std::byte> memory((*reader)->slot_bytes());
  FrameSlot slot;
  slot.bytes = memory;
  while (true) {
    const auto more = (*reader)->next(slot);
    EXPECT_TRUE(more.has_value()) << more.error().message;
    if (!more || !*more) return frames;
    ++frames;
  }
}

class Daemon : public testing::Test {
 protected:
  void SetUp() override {
    program_ = std::make_unique<Program>(std::vector<std::string>{"--config", settings()});
    const std::string address = program_->first_line();
    ASSERT_THAT(address, StartsWith("http://127.0.0.1:"));
    port_ = static_cast<std::uint16_t>(std::stoi(address.substr(17)));
    ASSERT_TRUE(comes_true([&] { return (block_ = find_block(program_->pid())) != nullptr; }));
    ASSERT_TRUE(comes_true([&] { return framesets() > 5; }));
    ASSERT_TRUE(comes_true([&] { return web_pid() > 0 && answers(); }));
  }
  virtual std::string settings() { return settings_file(); }
  void TearDown() override {
    if (block_ != nullptr) munmap(const_cast<SharedBlock*>(block_), sizeof(SharedBlock));
  }

  std::uint64_t framesets() { return block_->snapshot.load(*snapshot_) ? snapshot_->framesets : 0; }
  pid_t web_pid() const {
    const std::string id = std::to_string(program_->pid());
    const std::string children = read_text("/proc/" + id + "/task/" + id + "/children");
    return children.empty() ? 0 : std::stoi(children);
  }
  int connected() const {
    const int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    const timeval patience{1, 0};
    setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port_);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    (void)connect(fd, reinterpret_cast<sockaddr*>(&address), sizeof address);
    return fd;
  }
  std::string get(const std::string& path) const { return ask("GET", path); }
  std::string ask(const std::string& method, const std::string& path,
                  const std::string& headers = "") const {
    const int fd = connected();
    const std::string request = method + " " + path + " HTTP/1.1\r\nHost: 127.0.0.1\r\n" + headers +
                                "Connection: close\r\n\r\n";
    (void)send(fd, request.data(), request.size(), MSG_NOSIGNAL);
    std::string text;
    char part[4096];
    for (ssize_t size = 0; (size = recv(fd, part, sizeof part, 0)) > 0;)
      text.append(part, static_cast<std::size_t>(size));
    close(fd);
    return text;
  }
  // 0 when there is none.
  pid_t thread_named(const std::string& name) const {
    const std::string folder = "/proc/" + std::to_string(program_->pid()) + "/task/";
    DIR* listing = opendir(folder.c_str());
    pid_t found = 0;
    while (const dirent* entry = listing != nullptr ? readdir(listing) : nullptr)
      if (read_text(folder + entry->d_name + "/comm") == name + "\n")
        found = std::stoi(entry->d_name);
    if (listing != nullptr) closedir(listing);
    return found;
  }
  bool answers() const { return get("/livez").starts_with("HTTP/1.1 200"); }
  // Frames are worked on from here on, whatever happens to the web side.
  bool frames_go_on() {
    const std::uint64_t before = framesets();
    return comes_true([&] { return framesets() > before + 5; });
  }

  std::unique_ptr<Program> program_;
  std::uint16_t port_ = 0;
  const SharedBlock* block_ = nullptr;
  std::unique_ptr<Snapshot> snapshot_ = std::make_unique<Snapshot>();
};

// Whether this machine has USB or not, a Kinect with this serial number is not there.
class DaemonWithoutItsKinect : public Daemon {
  std::string settings() override {
    return settings_file(
        "[[sensor]]\nname = \"k1\"\nkind = \"kinect\"\nsource = \"device\"\n"
        "device = \"NO-SUCH-KINECT\"\n");
  }
};

TEST_F(DaemonWithoutItsKinect, WatchesWithTheOthersAndSaysWhatIsMissing) {
  EXPECT_TRUE(comes_true([&] {
    framesets();
    return snapshot_->sensors[1].state == SensorState::kLost &&
           !snapshot_->sensors[1].trouble.empty();
  }));
  EXPECT_TRUE(frames_go_on());
  EXPECT_TRUE(comes_true([&] {
    const std::string health = get("/api/v1/health");
    return health.find("Sensor k1 has never given a frame: ") != std::string::npos;
  }));
  EXPECT_EQ(snapshot_->allocations_sealed, 0U);
}

// As the paper groups frames; but a sensor that is not there hangs no barrier.
class DaemonWithABarrier : public Daemon {
  std::string settings() override {
    return settings_file(
        "[[sensor]]\nname = \"k1\"\nkind = \"kinect\"\nsource = \"device\"\n"
        "device = \"NO-SUCH-KINECT\"\n[capture]\ngrouping = \"barrier\"\n");
  }
};

TEST_F(DaemonWithABarrier, WatchesOnWithoutTheSensorThatIsNotThere) {
  EXPECT_TRUE(comes_true([&] {
    framesets();
    return snapshot_->sensors[1].state == SensorState::kLost;
  }));
  EXPECT_TRUE(frames_go_on());
  EXPECT_EQ(snapshot_->allocations_sealed, 0U);
}

// The stereo camera that is not there is to be triggered together with others.
class DaemonWithoutItsCamera : public Daemon {
  std::string settings() override {
    const std::string scene =
        testing::TempDir() + "wagonsightd_camera_" + std::to_string(getpid()) + ".toml";
    std::ofstream(scene) << read_text(kEmptyWagon)
                         << read_text(WAGONSIGHT_SOURCE_DIR "/config/rigs/six_stereo.toml");
    return settings_file(
        "[[sensor]]\nname = \"s0\"\nkind = \"stereo\"\nsource = \"device\"\n"
        "device = \"00b09d0100000000\"\ntrigger = \"together\"\n",
        scene);
  }
};

TEST_F(DaemonWithoutItsCamera, GivesItsPulsesAndWatchesOn) {
  EXPECT_TRUE(comes_true([&] {
    framesets();
    return snapshot_->sensors[1].state == SensorState::kLost &&
           !snapshot_->sensors[1].trouble.empty();
  }));
  EXPECT_TRUE(frames_go_on());
  EXPECT_NE(thread_named("trigger"), 0);
  EXPECT_EQ(snapshot_->allocations_sealed, 0U);
}

// A recording is asked for by the admin, and by nobody else.
class DaemonForTheDepot : public Daemon {
 protected:
  void SetUp() override {
    folder_ = testing::TempDir() + "wagonsightd_depot_" + std::to_string(getpid());
    std::filesystem::remove_all(folder_);
    Daemon::SetUp();
  }
  void TearDown() override {
    Daemon::TearDown();
    std::filesystem::remove_all(folder_);
  }
  std::string settings() override {
    return settings_file(
        "[web.tokens]\nread = \"reads-and-no-more\"\nadmin = \"may-do-everything\"\n"
        "[recording]\nfolder = \"" +
        folder_ + "/a/b\"\nminutes = 5\nfree_mb_min = 16\n");
  }
  RecordingState recording() {
    framesets();
    return snapshot_->recording.state;
  }
  static inline const std::string kAdmin = "Authorization: Bearer may-do-everything\r\n";
  static inline const std::string kReader = "Authorization: Bearer reads-and-no-more\r\n";
  std::string folder_;
};

TEST_F(DaemonForTheDepot, RecordsWhenTheAdminAsksAndSaysSo) {
  EXPECT_EQ(recording(), RecordingState::kOff);
  EXPECT_THAT(ask("POST", "/api/v1/recording?minutes=1"), HasSubstr(" 401 "));
  EXPECT_THAT(ask("POST", "/api/v1/recording?minutes=1", kReader), HasSubstr(" 403 "));
  EXPECT_THAT(ask("POST", "/api/v1/recording?minutes=6", kAdmin), HasSubstr(" 400 "));
  EXPECT_THAT(ask("POST", "/api/v1/recording?minutes=1", kAdmin), HasSubstr(" 202 "));
  ASSERT_TRUE(comes_true([&] { return recording() == RecordingState::kOn; }));
  EXPECT_LE(snapshot_->recording.ends_in_s, 60.0);
  EXPECT_THAT(get("/api/v1/health"), HasSubstr("\"recording\""));
  ASSERT_TRUE(comes_true([&] {
    framesets();
    return snapshot_->recording.frames > 20;
  }));
  EXPECT_EQ(snapshot_->allocations_sealed, 0U);
  EXPECT_THAT(ask("DELETE", "/api/v1/recording", kAdmin), HasSubstr(" 202 "));
  ASSERT_TRUE(comes_true([&] { return recording() == RecordingState::kOff; }));
  const std::uint64_t frames = snapshot_->recording.frames;
  std::uint64_t read = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder_ + "/a/b"))
    read += frames_of(entry.path());
  EXPECT_EQ(read, frames);
}

// That this is at most the last second where the disk and the processor keep up is
// DepotRecorder's to show; here both are shared with other tests.
TEST_F(DaemonForTheDepot, LosesNothingThatItToldToBeOnTheDiskWhenItIsKilled) {
  ASSERT_THAT(ask("POST", "/api/v1/recording?minutes=1", kAdmin), HasSubstr(" 202 "));
  ASSERT_TRUE(comes_true([&] {
    framesets();
    return snapshot_->recording.frames > 20;
  }));
  std::this_thread::sleep_for(std::chrono::milliseconds(std::random_device{}() % 1000));
  framesets();
  const std::uint64_t told = snapshot_->recording.frames;
  ASSERT_EQ(kill(program_->pid(), SIGKILL), 0);
  program_->finish();
  const auto& files = std::filesystem::directory_iterator(folder_ + "/a/b");
  EXPECT_GE(frames_of(files->path()), told);
}

// Sensor k0 is knocked by 2 cm once the empty wagon is known.
class KnockedDaemon : public Daemon {
 protected:
  std::string settings() override {
    const std::string scene = testing::TempDir() + "knocked_" + std::to_string(getpid()) + ".toml";
    std::ofstream(scene)
        << read_text(kEmptyWagon)
        << "[[fault]]\nat = 35\nsensor = \"k0\"\nkind = \"moved\"\namount = 0.02\n";
    return settings_file("", scene);
  }
};

TEST_F(KnockedDaemon, SaysWhichSensorMovedAndByHowMuch) {
  const auto drift = [&] {
    (void)block_->snapshot.load(*snapshot_);
    return snapshot_->calibration;
  };
  EXPECT_TRUE(
      comes_true([&] { return drift().drift_text.view().find("learn") != std::string::npos; }));
  EXPECT_FALSE(drift().drift_alarm);
  ASSERT_TRUE(comes_true([&] { return drift().drift_alarm; }));
  const std::string text(drift().drift_text.view());
  ASSERT_THAT(text, StartsWith("k0 by "));
  EXPECT_NEAR(std::stod(text.substr(6)), 20, 3) << text;
  EXPECT_THAT(get("/api/v1/calibration"), HasSubstr("\"alarm\":true"));
  EXPECT_THAT(get("/api/v1/health"), HasSubstr("since it was calibrated: k0 by "));
  EXPECT_THAT(get("/metrics"), HasSubstr("wagonsight_drift_alarm 1"));
}

// Its new calibration blob was cut off by a power cut; the one before is there.
class OldBlobDaemon : public Daemon {
 protected:
  std::string settings() override {
    const auto scene = parse_scene(read_text(kEmptyWagon), kEmptyWagon);
    Rig rig = rig_of(*scene);
    rig.provenance.created_unix = 1'700'000'000;
    rig.sensors[0].rms_px = 0.27;
    const auto bytes = pack_blob(rig);
    path_ = testing::TempDir() + "old_" + std::to_string(getpid()) + ".blob";
    write(path_, bytes.size() / 2, bytes);
    write(path_ + ".previous", bytes.size(), bytes);
    return settings_file("[rig]\nblob = \"" + path_ + "\"\n");
  }
  static void write(const std::string& path, std::size_t size,
                    const std::vector<std::byte>& bytes) {
    std::ofstream(path, std::ios::binary)
        .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(size));
  }
  std::string path_;
};

TEST_F(OldBlobDaemon, TakesABlobOnlyWholeAndSaysItsAgeAndError) {
  const std::string calibration = get("/api/v1/calibration");
  EXPECT_THAT(calibration, HasSubstr("\"created_unix\":1700000000"));
  EXPECT_THAT(calibration, HasSubstr("\"rms_px\":0.27"));
  EXPECT_THAT(calibration, HasSubstr("\"age_s\":"));
  auto log = std::make_unique<LogTail>();
  ASSERT_TRUE(block_->log.load(*log));
  std::string lines;
  for (const LogLine& line : log->lines) lines += std::string(line.text.view()) + "\n";
  EXPECT_THAT(lines, HasSubstr(path_ + ".previous is used instead"));
  // The static wagon is learned for it and kept beside it.
  EXPECT_TRUE(comes_true([&] { return !read_text(path_ + ".previous.static").empty(); }));
}

TEST_F(Daemon, WorksOnWhileItsWebSideIsKilledAndBringsItBack) {
  const pid_t first = web_pid();
  ASSERT_EQ(kill(first, SIGKILL), 0);
  EXPECT_TRUE(frames_go_on());
  EXPECT_TRUE(comes_true([&] { return web_pid() > 0 && web_pid() != first; }));
  EXPECT_TRUE(comes_true([&] { return answers(); }));
  framesets();
  EXPECT_EQ(snapshot_->web_restarts, 1U);
}

TEST_F(Daemon, WorksOnWhileItsWebSideHangsAndReplacesIt) {
  const pid_t first = web_pid();
  ASSERT_EQ(kill(first, SIGSTOP), 0);
  EXPECT_TRUE(frames_go_on());
  EXPECT_TRUE(comes_true([&] { return web_pid() > 0 && web_pid() != first; }));
  EXPECT_TRUE(comes_true([&] { return answers(); }));
}

TEST_F(Daemon, WorksOnWhileItsWebSideIsFlooded) {
  std::atomic<bool> done{false};
  std::vector<std::thread> flood;
  flood.reserve(4);
  for (int i = 0; i < 4; ++i)
    flood.emplace_back([&] {
      std::vector<int> open;
      while (!done) {
        open.push_back(connected());
        const std::string_view request = "GET /metrics HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n";
        for (const int fd : open)
          (void)send(fd, request.data(), request.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
        if (open.size() < 100) continue;
        for (const int fd : open) close(fd);
        open.clear();
      }
      for (const int fd : open) close(fd);
    });
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(frames_go_on());
  done = true;
  for (std::thread& thread : flood) thread.join();
  EXPECT_TRUE(comes_true([&] { return answers(); }));
}

TEST_F(Daemon, GivesItsWebSideNoPrivileges) {
  const std::string status = read_text("/proc/" + std::to_string(web_pid()) + "/status");
  EXPECT_THAT(status, HasSubstr("NoNewPrivs:\t1"));
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
  EXPECT_THAT(status, HasSubstr("Seccomp:\t2"));
#endif
  if (geteuid() == 0) {
    EXPECT_THAT(status, HasSubstr("Uid:\t65534\t65534\t65534"));
    EXPECT_THAT(status, HasSubstr("CapEff:\t0000000000000000"));
  }
}

TEST_F(Daemon, EndsWithZeroAndTakesItsWebSideAlong) {
  const pid_t web = web_pid();
  ASSERT_EQ(kill(program_->pid(), SIGTERM), 0);
  const Finished done = program_->finish();
  EXPECT_EQ(done.status, 0) << done.err;
  EXPECT_TRUE(comes_true([&] { return kill(web, 0) != 0; }));
}

TEST_F(Daemon, TakesItsWebSideAlongWhenItIsKilled) {
  const pid_t web = web_pid();
  ASSERT_EQ(kill(program_->pid(), SIGKILL), 0);
  program_->finish();
  EXPECT_TRUE(comes_true([&] {
    // It is nobody's child now; where nobody reaps orphans it stays as a zombie.
    const std::string status = read_text("/proc/" + std::to_string(web) + "/status");
    return status.empty() || status.find("State:\tZ") != std::string::npos;
  }));
}

// Stops the tracking thread alone, as a debugger does.
TEST_F(Daemon, SaysThatTrackingHangs) {
  const pid_t tracking = thread_named("tracking");
  ASSERT_GT(tracking, 0);
  if (ptrace(PTRACE_SEIZE, tracking, nullptr, nullptr) != 0)
    GTEST_SKIP() << "this system lets nobody stop another's thread: " << std::strerror(errno);
  ASSERT_EQ(ptrace(PTRACE_INTERRUPT, tracking, nullptr, nullptr), 0);
  ASSERT_EQ(waitpid(tracking, nullptr, __WALL), tracking);
  // The web side lives meanwhile, and says what is wrong.
  EXPECT_TRUE(
      comes_true([&] { return get("/api/v1/health").find("pipeline_late") != std::string::npos; }));
  EXPECT_THAT(get("/readyz"), StartsWith("HTTP/1.1 503"));
  ASSERT_EQ(ptrace(PTRACE_DETACH, tracking, nullptr, nullptr), 0) << std::strerror(errno);
  EXPECT_TRUE(frames_go_on());
}

TEST_F(Daemon, HoldsAllMemoryOfItsDataPathFromTheStart) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "a sanitizer's memory is not ours";
#endif
  ASSERT_TRUE(comes_true([&] { return framesets() > 120; }));
  // Code of shared libraries that runs for the first time is not memory of ours.
  EXPECT_LE(snapshot_->page_faults, 16U);
}

TEST_F(Daemon, KeepsItsHeapSealed) {
  ASSERT_TRUE(comes_true([&] { return framesets() > 60; }));
  EXPECT_EQ(snapshot_->allocations_sealed, 0U);
}

TEST(CommandLine, ChecksSettingsWithoutStarting) {
  Program good({"--config", settings_file(), "--check-config"});
  EXPECT_EQ(good.finish().status, 0);
  Program bad({"--config", settings_file("ports = 3\n"), "--check-config"});
  const Finished done = bad.finish();
  EXPECT_EQ(done.status, 1);
  EXPECT_THAT(done.err, HasSubstr(":11: "));
  EXPECT_THAT(done.err, HasSubstr("web.ports"));
}

TEST(CommandLine, TellsWrongUsageFromFailure) {
  EXPECT_EQ(Program({}).finish().status, 2);
  EXPECT_EQ(Program({"--nonsense"}).finish().status, 2);
  const Finished absent = Program({"--config", "/nowhere/wagon.toml"}).finish();
  EXPECT_EQ(absent.status, 1);
  EXPECT_THAT(absent.err, HasSubstr("/nowhere/wagon.toml"));
  const Finished by_hand = Program({"--web-side"}).finish();
  EXPECT_EQ(by_hand.status, 2);
  EXPECT_THAT(Program({"--help"}).finish().out, HasSubstr("--check-config"));
}

TEST(SharedMemory, CanBeReadButNotWrittenByOthers) {
  const auto unit = std::make_unique<UnitInfo>();
  unit->name = "seven";
  auto writer = SharedBlockWriter::create(*unit);
  ASSERT_TRUE(writer.has_value());
  const auto reader = map_shared_block(writer->fd());
  ASSERT_TRUE(reader.has_value());
  EXPECT_EQ((*reader)->unit.name, "seven");
  EXPECT_EQ(mmap(nullptr, sizeof(SharedBlock), PROT_READ | PROT_WRITE, MAP_SHARED, writer->fd(), 0),
            MAP_FAILED);
  EXPECT_NE(ftruncate(writer->fd(), 1), 0);
  munmap(const_cast<SharedBlock*>(*reader), sizeof(SharedBlock));
}

}  // namespace
}  // namespace wagonsight

// usbip_kinects DAEMON SETTINGS STILLS RECORDINGS
// Plugs emulated Kinects into the kernel it runs on, each into a bus of its own, runs the daemon
// with them and holds what its page says against what the Kinects sent: steady, recorded and
// compared pixel by pixel, one unplugged, and back. Prints a table; exits with 1 when something
// does not hold. Root, for vhci_hcd. In the guest of scripts/lib/usbip its clock is the
// processor's, not the wall's.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <thread>

#include "daemon_run.h"
#include "kinect_rack.h"

namespace wagonsight::device::usbip {
namespace {

using std::chrono::duration;
using std::chrono::milliseconds;
using std::chrono::seconds;
using Clock = std::chrono::steady_clock;

constexpr const char* kToken = "may-do-everything-here";  // of the settings in scripts/lib/usbip
constexpr auto kLook = milliseconds(50);                  // between questions to the page
constexpr std::size_t kKinects = 4;
constexpr auto kSteady = seconds(4), kSteadyAgain = seconds(2);
constexpr auto kRecorded = milliseconds(1500);
constexpr auto kLosing = seconds(2);
constexpr double kLost = 1.0 / 500;  // of its packets
constexpr auto kAway = seconds(3);
constexpr auto kReadyMax = seconds(20);
constexpr auto kNoticedMax = seconds(1);
// Looked for every half second, opened within three, and its first frame; of one that stalls, the
// first frame is waited for in vain for two seconds before it is reset.
constexpr auto kBackMax = seconds(5);
constexpr auto kHealthyMax = seconds(30);
constexpr auto kWrittenMax = seconds(60);
constexpr double kFpsMin = 29.5;
// Frames between what the page says and what is on the wire: it is some tens of milliseconds old.
constexpr std::uint64_t kUnderWay = 6;

double seconds_since(Clock::time_point begin) {
  return duration<double>(Clock::now() - begin).count();
}

class Drill {
 public:
  Drill(KinectRack& rack, DaemonRun& daemon, std::string recordings)
      : rack_(rack), daemon_(daemon), recordings_(std::move(recordings)) {}

  bool run();

 private:
  // What the daemon says of a sensor, and what its Kinect has sent.
  struct Account {
    nlohmann::json said;
    KinectRack::Sent sent;
  };
  using Accounts = std::vector<Account>;
  static std::uint64_t count(const Account& account, const char* what) {
    return account.said.value(what, std::uint64_t{0});
  }

  void hold(bool is_so, const char* what) {
    if (is_so) return;
    std::printf("usbip: DOES NOT HOLD: %s\n", what);
    all_hold_ = false;
  }
  Accounts accounts();
  bool all_are_ok();
  bool comes_true(Clock::duration patience, const std::function<bool()>& is_so);
  // Every frame of these Kinects since `before` must be used; what is said now.
  Accounts judge(const char* when, const Accounts& before, Clock::time_point since,
                 const std::vector<std::size_t>& kinects);
  // Every one of this Kinect's must be used or counted.
  void judge_count(const Account& before, const Account& after);
  void await_trouble(std::size_t kinect, Clock::time_point since);
  void await_frames(std::size_t kinect, Clock::time_point since);
  bool become_ready();
  void stay_steady(Clock::duration time);
  void compare_pixels();
  void lose_packets();
  void unplug_and_stall();

  KinectRack& rack_;
  DaemonRun& daemon_;
  std::string recordings_;
  bool had_faults_ = false;
  bool all_hold_ = true;
};

// In the rack's order; nothing where the page does not answer.
Drill::Accounts Drill::accounts() {
  const DaemonRun::Answer answer = daemon_.ask("GET", "/api/v1/sensors", kToken);
  if (answer.status != 200 || !answer.body.is_object()) return {};
  Accounts accounts(rack_.size());
  for (const auto& said : answer.body["sensors"])
    for (std::size_t i = 0; i < rack_.size(); ++i)
      if (said.value("name", "") == rack_.name(i)) accounts[i] = {said, rack_.sent(i)};
  return accounts;
}

bool Drill::all_are_ok() {
  const Accounts now = accounts();
  return !now.empty() && std::all_of(now.begin(), now.end(), [](const Account& account) {
    return account.said.value("state", "") == "ok";
  }) && daemon_.ask("GET", "/readyz", kToken).status == 200;
}

bool Drill::comes_true(Clock::duration patience, const std::function<bool()>& is_so) {
  const auto begin = Clock::now();
  while (!is_so()) {
    if (Clock::now() - begin > patience) return false;
    std::this_thread::sleep_for(kLook);
  }
  return true;
}

Drill::Accounts Drill::judge(const char* when, const Accounts& before, Clock::time_point since,
                             const std::vector<std::size_t>& kinects) {
  Accounts after = accounts();
  const double took_s = seconds_since(since);
  hold(!before.empty() && !after.empty(), "the page answers");
  if (before.empty() || after.empty()) return {};
  for (const std::size_t i : kinects) {
    std::printf("%-10s %4.1f s  %s ", when, took_s, rack_.name(i).c_str());
    judge_count(before[i], after[i]);
    hold(after[i].sent.torn == before[i].sent.torn &&
             count(after[i], "damaged") == count(before[i], "damaged") &&
             count(after[i], "dropped") == count(before[i], "dropped"),
         "no frame is lost");
  }
  return after;
}

void Drill::judge_count(const Account& before, const Account& after) {
  const auto grown = [&](const char* what) { return count(after, what) - count(before, what); };
  const std::uint64_t whole = after.sent.whole - before.sent.whole;
  const std::uint64_t torn = after.sent.torn - before.sent.torn;
  const std::uint64_t frames = grown("frames");
  const std::uint64_t dropped = grown("dropped");
  const std::uint64_t damaged = grown("damaged");
  std::printf("sent %s whole, %s torn; used %s, dropped %s, damaged %s; %.2f fps\n",
              std::to_string(whole).c_str(), std::to_string(torn).c_str(),
              std::to_string(frames).c_str(), std::to_string(dropped).c_str(),
              std::to_string(damaged).c_str(), after.said.value("fps", 0.0));
  hold(frames + dropped + kUnderWay >= whole && frames + dropped <= whole + kUnderWay,
       "every whole frame is used, or counted as dropped");
  hold(damaged + kUnderWay >= torn && damaged <= torn + kUnderWay,
       "every torn frame is counted as damaged");
}

void Drill::await_trouble(std::size_t kinect, Clock::time_point since) {
  const bool is_told = comes_true(kNoticedMax, [&] {
    const Accounts now = accounts();
    return !now.empty() && !now[kinect].said["trouble"].is_null();
  });
  std::printf("told       after %.2f s\n", seconds_since(since));
  hold(is_told, "it is told within a second");
}

void Drill::await_frames(std::size_t kinect, Clock::time_point since) {
  const Accounts before = accounts();
  const bool is_back = comes_true(kBackMax, [&] {
    const Accounts now = accounts();
    return !before.empty() && !now.empty() &&
           count(now[kinect], "frames") > count(before[kinect], "frames") + 2;
  });
  std::printf("back       frames again after %.2f s\n", seconds_since(since));
  hold(is_back, "it gives frames again");
}

bool Drill::become_ready() {
  const auto begin = Clock::now();
  const bool is_ready = comes_true(kReadyMax, [&] { return all_are_ok(); });
  hold(is_ready, "all sensors become ok and /readyz says 200");
  if (is_ready)
    std::printf("ready      %.1f s after the daemon's start\n", seconds_since(begin));
  else
    std::printf("%s\n", daemon_.ask("GET", "/api/v1/health", kToken).body.dump().c_str());
  return is_ready;
}

void Drill::stay_steady(Clock::duration time) {
  const Accounts before = accounts();
  const auto begin = Clock::now();
  std::this_thread::sleep_for(time);
  // The page's rate is that of the last seconds: after a fault it still knows of that.
  for (const Account& account : judge("steady", before, begin, {0, 1, 2, 3}))
    hold(had_faults_ || account.said.value("fps", 0.0) >= kFpsMin, "frames come at full rate");
}

void Drill::compare_pixels() {
  hold(daemon_.ask("POST", "/api/v1/recording?minutes=1", kToken).status == 202,
       "a recording begins");
  std::this_thread::sleep_for(kRecorded);
  daemon_.ask("DELETE", "/api/v1/recording", kToken);
  const auto is_off = [&] {
    const auto said = daemon_.ask("GET", "/api/v1/recording", kToken).body;
    return said.is_object() && said.value("state", "") == "off";
  };
  hold(comes_true(kWrittenMax, is_off), "the recording ends");
  KinectRack::Comparison all;
  for (const auto& entry : std::filesystem::directory_iterator(recordings_)) {
    const auto compared = rack_.compare(entry.path());
    if (!compared) return hold(false, compared.error().message.c_str());
    all.add(*compared);
  }
  std::printf("recorded   %s frames, %s pixels, %s of them wrong, %s frames missing\n",
              std::to_string(all.frames).c_str(), std::to_string(all.pixels).c_str(),
              std::to_string(all.wrong_pixels).c_str(), std::to_string(all.missing).c_str());
  hold(all.frames >= rack_.size() * 30, "a second of frames is recorded");
  hold(all.wrong_pixels == 0, "every pixel is what the Kinect sent");
  hold(all.missing == 0, "no frame is missing in the recording");
}

void Drill::lose_packets() {
  constexpr std::size_t kLossy = 2;
  had_faults_ = true;
  std::printf("lossy      %s: one packet in 500 is lost\n", rack_.name(kLossy).c_str());
  const Accounts before = accounts();
  const auto begin = Clock::now();
  rack_.spoil(kLossy, [](KinectFaults& faults) { faults.lost = kLost; });
  std::this_thread::sleep_for(kLosing);
  rack_.spoil(kLossy, [](KinectFaults& faults) { faults.lost = 0; });
  std::this_thread::sleep_for(kLook * 4);  // until the page has said so
  judge("meanwhile", before, begin, {0, 1, 3});
  const Accounts after = accounts();
  if (before.empty() || after.empty()) return;
  std::printf("%-10s %4.1f s  %s ", "itself", seconds_since(begin), rack_.name(kLossy).c_str());
  judge_count(before[kLossy], after[kLossy]);
  hold(after[kLossy].sent.torn > before[kLossy].sent.torn + kUnderWay, "frames are torn");
}

void Drill::unplug_and_stall() {
  constexpr std::size_t kAwayOne = 1, kStalled = 3;
  Accounts before = accounts();
  auto begin = Clock::now();
  std::printf("unplugged  %s\n", rack_.name(kAwayOne).c_str());
  rack_.unplug(kAwayOne);
  await_trouble(kAwayOne, begin);
  std::this_thread::sleep_until(begin + kAway);
  judge("meanwhile", before, begin, {0, 2, 3});

  before = accounts();
  begin = Clock::now();
  std::printf("plugged    %s, into another port\n", rack_.name(kAwayOne).c_str());
  if (const auto done = rack_.plug(kAwayOne); !done)
    return hold(false, done.error().message.c_str());
  await_frames(kAwayOne, begin);

  const auto stalled = Clock::now();
  std::printf("stalled    %s: sends nothing until it is reset\n", rack_.name(kStalled).c_str());
  rack_.spoil(kStalled, [](KinectFaults& faults) { faults.silent = true; });
  await_trouble(kStalled, stalled);
  await_frames(kStalled, stalled);
  hold(comes_true(kHealthyMax, [&] { return all_are_ok(); }), "all of them are ok again");
  std::printf("ready      again after %.1f s\n", seconds_since(stalled));
  judge("meanwhile", before, begin, {0, 2});
}

bool Drill::run() {
  if (become_ready()) {
    stay_steady(kSteady);
    compare_pixels();
    lose_packets();
    unplug_and_stall();
    stay_steady(kSteadyAgain);
  }
  const int code = daemon_.stop();
  std::printf("stopped    with exit code %d\n", code);
  hold(code == 0, "the daemon ends when it is told to");
  return all_hold_;
}

int run(const std::vector<std::string>& words) {
  if (words.size() != 4) {
    std::fprintf(stderr, "usage: usbip_kinects DAEMON SETTINGS STILLS RECORDINGS\n");
    return 2;
  }
  const auto refuse = [](const Error& error) {
    std::printf("usbip: %s\n", error.message.c_str());
    return 1;
  };
  auto rack = KinectRack::open(words[2]);
  if (!rack) return refuse(rack.error());
  if ((*rack)->size() != kKinects) return refuse({words[2] + ": does not show four Kinects"});
  for (std::size_t i = 0; i < (*rack)->size(); ++i)
    if (auto plugged = (*rack)->plug(i); !plugged) return refuse(plugged.error());
  auto daemon = DaemonRun::start(words[0], words[1], "/run/wagonsight");
  if (!daemon) return refuse(daemon.error());
  return Drill(**rack, *daemon, words[3]).run() ? 0 : 1;
}

}  // namespace
}  // namespace wagonsight::device::usbip

int main(int argc, char** argv) {
  std::setvbuf(stdout, nullptr, _IOLBF, 0);
  return wagonsight::device::usbip::run({argv + 1, argv + argc});
}

// usbip_kinects DAEMON SETTINGS STILLS RECORDINGS
// Plugs emulated Kinects into the kernel it runs on, each into a bus of its own, runs the daemon
// with them and holds what its page says against what the Kinects sent: steady, recorded and
// compared pixel by pixel, one unplugged, and back. Prints a table; exits with 1 when something
// does not hold. Root, for vhci_hcd. In the guest of scripts/lib/usbip its clock is the
// processor's, not the wall's.
#include <algorithm>
#include <chrono>
#include <cstdarg>
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
constexpr auto kSteady = seconds(5);
constexpr auto kRecorded = milliseconds(1500);
constexpr auto kAway = seconds(3);
constexpr auto kReadyMax = seconds(60);
constexpr auto kNoticedMax = seconds(1);
// Looked for every half second, opened within three, and its first frame.
constexpr auto kBackMax = seconds(5);
constexpr auto kLearnedMax = seconds(30);
constexpr auto kWrittenMax = seconds(60);
constexpr double kFpsMin = 29.5;
// Frames between what the page says and what is on the wire: it is some tens of milliseconds old.
constexpr std::uint64_t kUnderWay = 6;
constexpr std::size_t kUnplugged = 1;

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
  void judge(const char* when, const Accounts& before, const Accounts& after, double took_s,
             bool without_unplugged);
  bool become_ready();
  void stay_steady();
  void compare_pixels();
  void unplug_and_return();

  KinectRack& rack_;
  DaemonRun& daemon_;
  std::string recordings_;
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

void Drill::judge(const char* when, const Accounts& before, const Accounts& after, double took_s,
                  bool without_unplugged) {
  if (before.empty() || after.empty()) return hold(false, "the page answers");
  for (std::size_t i = 0; i < rack_.size(); ++i) {
    if (without_unplugged && i == kUnplugged) continue;
    const auto grown = [&](const char* what) {
      return count(after[i], what) - count(before[i], what);
    };
    const std::uint64_t whole = after[i].sent.whole - before[i].sent.whole;
    const std::uint64_t torn = after[i].sent.torn - before[i].sent.torn;
    const std::uint64_t frames = grown("frames");
    const std::uint64_t dropped = grown("dropped");
    const std::uint64_t damaged = grown("damaged");
    std::printf(
        "%-9s %-3s %5.1f s  sent %4llu whole %2llu torn  used %4llu dropped %2llu damaged %2llu  "
        "%.2f fps\n",
        when, rack_.name(i).c_str(), took_s, static_cast<unsigned long long>(whole),
        static_cast<unsigned long long>(torn), static_cast<unsigned long long>(frames),
        static_cast<unsigned long long>(dropped), static_cast<unsigned long long>(damaged),
        after[i].said.value("fps", 0.0));
    hold(frames + dropped + kUnderWay >= whole && frames + dropped <= whole + kUnderWay,
         "every whole frame is used, or counted as dropped");
    hold(damaged + kUnderWay >= torn && damaged <= torn + kUnderWay,
         "every torn frame is counted as damaged");
    hold(torn == 0 && damaged == 0 && dropped == 0, "no frame is lost");
    hold(after[i].said.value("fps", 0.0) >= kFpsMin, "frames come at full rate");
  }
}

bool Drill::become_ready() {
  const auto begin = Clock::now();
  const bool is_ready = comes_true(kReadyMax, [&] { return all_are_ok(); });
  hold(is_ready, "all sensors become ok and /readyz says 200");
  if (is_ready)
    std::printf("ready     %.1f s after the daemon's start\n", seconds_since(begin));
  else
    std::printf("%s\n", daemon_.ask("GET", "/api/v1/health", kToken).body.dump().c_str());
  return is_ready;
}

void Drill::stay_steady() {
  const Accounts before = accounts();
  const auto begin = Clock::now();
  std::this_thread::sleep_for(kSteady);
  const Accounts after = accounts();
  judge("steady", before, after, seconds_since(begin), false);
}

void Drill::compare_pixels() {
  hold(daemon_.ask("POST", "/api/v1/recording?minutes=1", kToken).status == 202,
       "a recording begins");
  std::this_thread::sleep_for(kRecorded);
  daemon_.ask("DELETE", "/api/v1/recording", kToken);
  hold(
      comes_true(kWrittenMax,
                 [&] {
                   return daemon_.ask("GET", "/api/v1/recording", kToken).body.value("state", "") ==
                          "off";
                 }),
      "the recording ends");
  KinectRack::Comparison all;
  for (const auto& entry : std::filesystem::directory_iterator(recordings_)) {
    const auto compared = rack_.compare(entry.path());
    if (!compared) return hold(false, compared.error().message.c_str());
    all.add(*compared);
  }
  std::printf("recorded  %llu frames, %llu pixels, %llu of them wrong, %llu frames missing\n",
              static_cast<unsigned long long>(all.frames),
              static_cast<unsigned long long>(all.pixels),
              static_cast<unsigned long long>(all.wrong_pixels),
              static_cast<unsigned long long>(all.missing));
  hold(all.frames >= rack_.size() * 30, "a second of frames is recorded");
  hold(all.wrong_pixels == 0, "every pixel is what the Kinect sent");
}

void Drill::unplug_and_return() {
  const Accounts before = accounts();
  auto begin = Clock::now();
  rack_.unplug(kUnplugged);
  const bool is_noticed = comes_true(kNoticedMax, [&] {
    const Accounts now = accounts();
    return !now.empty() && !now[kUnplugged].said["trouble"].is_null();
  });
  std::printf("unplugged %s: told after %.2f s\n", rack_.name(kUnplugged).c_str(),
              seconds_since(begin));
  hold(is_noticed, "an unplugged Kinect is told within a second");
  std::this_thread::sleep_until(begin + kAway);
  judge("meanwhile", before, accounts(), seconds_since(begin), true);
  const Accounts at_return = accounts();
  const auto plugged = Clock::now();
  const auto done = rack_.plug(kUnplugged);
  if (!done) return hold(false, done.error().message.c_str());
  const bool is_back = comes_true(kBackMax, [&] {
    const Accounts now = accounts();
    return !now.empty() &&
           count(now[kUnplugged], "frames") > count(at_return[kUnplugged], "frames");
  });
  std::printf("back      %s: frames again after %.2f s\n", rack_.name(kUnplugged).c_str(),
              seconds_since(plugged));
  hold(is_back, "it gives frames again, in another port");
  hold(comes_true(kLearnedMax, [&] { return all_are_ok(); }), "all of them are ok again");
  judge("meanwhile", at_return, accounts(), seconds_since(plugged), true);
}

bool Drill::run() {
  if (become_ready()) {
    stay_steady();
    compare_pixels();
    unplug_and_return();
    stay_steady();
  }
  const int code = daemon_.stop();
  std::printf("stopped   with exit code %d\n", code);
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

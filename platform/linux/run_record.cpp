#include "linux/run_record.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <ctime>
#include <utility>

#include "base/fixed_string.h"

namespace wagonsight {

// Only ever grown at its end, with a new magic number.
struct RunRecord::Page {
  static constexpr std::uint64_t kMagic = 0x31'64'72'6F'63'65'72'77;  // "wrecord1"
  static constexpr std::size_t kCrashes = 8;
  enum class State : std::uint32_t { kEnded, kRunning, kFailed };

  std::uint64_t magic = kMagic;
  State state = State::kEnded;
  std::atomic<std::int32_t> signal{0};
  double alive_s = 0, alive_unix = 0;        // seconds since the machine's start
  std::array<double, kCrashes> crashed_s{};  // the newest last; 0: none
  FixedString<200> reason;
};

namespace {

constexpr std::array kFatal = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT, SIGSYS};

// Where the signal handler writes; there is one record a process.
constinit std::atomic<std::atomic<std::int32_t>*> fatal_signal{nullptr};

void on_fatal_signal(int signal) {
  if (auto* place = fatal_signal.load()) place->store(signal);
  // What comes next is the signal's own ending.
  std::signal(signal, SIG_DFL);
  raise(signal);
}

// Goes on while the machine sleeps, and starts anew with it.
double boot_seconds() {
  timespec now{};
  clock_gettime(CLOCK_BOOTTIME, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

std::string signal_text(int signal) {
  switch (signal) {
    case 0:
      return "it ended without a word (killed, or out of memory)";
    case SIGSEGV:
      return "a bad memory access (SIGSEGV)";
    case SIGBUS:
      return "a file that was cut off or failing memory (SIGBUS)";
    case SIGABRT:
      return "a broken internal contract, or the watchdog (SIGABRT)";
    default:
      return fmt::format("signal {}", signal);
  }
}

}  // namespace

RunRecord::RunRecord(Page* page) : page_(page) {}

RunRecord::RunRecord(RunRecord&& other) noexcept
    : page_(std::exchange(other.page_, nullptr)), previous_(std::move(other.previous_)) {}

RunRecord::~RunRecord() {
  if (page_ == nullptr) return;
  auto* mine = &page_->signal;
  fatal_signal.compare_exchange_strong(mine, nullptr);
  munmap(page_, sizeof(Page));
}

Result<RunRecord> RunRecord::open(const std::string& path) {
  const auto failed = [&](const char* step) {
    return fail(fmt::format("{}: {}: {}; a crash will not be told by the next run", path, step,
                            std::strerror(errno)));
  };
  const int fd = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
  if (fd < 0) return failed("cannot be opened");
  void* memory = MAP_FAILED;
  if (ftruncate(fd, sizeof(Page)) == 0)
    memory = mmap(nullptr, sizeof(Page), PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
  const int error = errno;
  ::close(fd);
  errno = error;
  if (memory == MAP_FAILED) return failed("cannot be mapped");
  auto* page = static_cast<Page*>(memory);
  const bool is_sound = page->magic == Page::kMagic && page->state <= Page::State::kFailed &&
                        page->reason.view().size() <= page->reason.capacity();
  if (!is_sound) page = new (memory) Page;
  RunRecord record(page);
  record.read_previous();
  return record;
}

void RunRecord::read_previous() {
  const double now_s = boot_seconds();
  Page& page = *page_;
  // Times of another run of the machine mean nothing.
  for (double& crashed_s : page.crashed_s)
    if (!(crashed_s <= now_s)) crashed_s = 0;
  if (page.state != Page::State::kEnded) {
    previous_.present = true;
    previous_.age_s = std::max(0.0, now_s - page.alive_s);
    previous_.unix_time = page.alive_unix;
    previous_.reason = page.state == Page::State::kFailed ? std::string(page.reason.view())
                                                          : signal_text(page.signal.load());
    std::rotate(page.crashed_s.begin(), page.crashed_s.begin() + 1, page.crashed_s.end());
    page.crashed_s.back() = now_s;
  }
  const double window_s = to_seconds(kCrashLoopWindow);
  previous_.recent = static_cast<std::uint32_t>(std::count_if(
      page.crashed_s.begin(), page.crashed_s.end(),
      [&](double crashed_s) { return crashed_s > 0 && now_s - crashed_s < window_s; }));
  page.state = Page::State::kRunning;
  page.signal.store(0);
  page.reason = "";
  alive(0);
}

void RunRecord::alive(double unix_time) {
  page_->alive_s = boot_seconds();
  page_->alive_unix = unix_time;
}

void RunRecord::ended() {
  page_->state = Page::State::kEnded;
}

void RunRecord::failed(const std::string& why) {
  page_->reason = std::string_view(why);
  page_->state = Page::State::kFailed;
}

void RunRecord::note_fatal_signals() {
  fatal_signal.store(&page_->signal);
  struct sigaction action {};
  action.sa_handler = on_fatal_signal;
  action.sa_flags = SA_NODEFER;
  for (const int signal : kFatal) sigaction(signal, &action, nullptr);
}

}  // namespace wagonsight

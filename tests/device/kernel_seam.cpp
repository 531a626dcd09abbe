#include "kernel_seam.h"

#include <dirent.h>
#include <dlfcn.h>
#include <fcntl.h>
#include <poll.h>
#include <sys/mman.h>
#include <sys/statfs.h>
#include <sys/timerfd.h>
#include <sys/vfs.h>
#include <time.h>  // NOLINT(modernize-deprecated-headers): POSIX clocks
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdarg>
#include <cstring>
#include <map>

#include "linux/sealed_heap.h"

namespace wagonsight::device {
namespace {

constexpr std::size_t kFilesMax = 1024;
constexpr long kSysfsMagic = 0x62656572;

struct Seam {
  std::array<std::shared_ptr<EmulatedFile>, kFilesMax> files;
  std::map<std::string, PathOpener> openers;
  std::map<std::string, std::function<std::vector<std::string>()>> folders;
};

Seam& seam() {
  static auto* seam = new Seam;  // outlives every static destructor that closes a file
  return *seam;
}

template <class F>
F* real(F* /*type*/, const char* name) {
  return reinterpret_cast<F*>(dlsym(RTLD_NEXT, name));
}
#define REAL(name)                               \
  ([] {                                          \
    static auto* const f = real(&::name, #name); \
    return f;                                    \
  }())

std::shared_ptr<EmulatedFile> file_of(int fd) {
  if (fd < 0 || static_cast<std::size_t>(fd) >= kFilesMax) return nullptr;
  return seam().files[static_cast<std::size_t>(fd)];
}

int answer(long value) {
  if (value >= 0) return static_cast<int>(value);
  errno = static_cast<int>(-value);
  return -1;
}

// A descriptor of the real kernel, so that its number is nobody else's.
int place(std::shared_ptr<EmulatedFile> file) {
  const int fd = memfd_create("emulated", MFD_CLOEXEC);
  if (fd >= 0 && static_cast<std::size_t>(fd) < kFilesMax)
    seam().files[static_cast<std::size_t>(fd)] = std::move(file);
  return fd;
}

int place_text(const std::string& text) {
  const int fd = memfd_create("emulated", MFD_CLOEXEC);
  if (fd < 0) return fd;
  if (REAL(write)(fd, text.data(), text.size()) < 0) return -1;
  lseek(fd, 0, SEEK_SET);
  return fd;
}

// True when somebody serves the path; `fd` is then what open() is to return.
bool open_emulated(const char* path, int& fd) {
  if (path == nullptr || path[0] != '/') return false;
  const std::lock_guard hold(VirtualTime::instance().mutex());
  for (const auto& [prefix, opener] : seam().openers) {
    if (std::strncmp(path, prefix.c_str(), prefix.size()) != 0) continue;
    Opened opened = opener(path);
    if (opened.file)
      fd = place(std::move(opened.file));
    else if (opened.text)
      fd = place_text(*opened.text);
    else if (opened.error != 0)
      fd = answer(opened.error);
    else
      continue;
    return true;
  }
  return false;
}

// A timerfd of an actor.
class VirtualTimer final : public EmulatedFile {
 public:
  short events() override { return VirtualTime::instance().now() >= expiry_ ? POLLIN : 0; }
  Nanoseconds next_change() override { return expiry_; }
  ssize_t read(void* buffer, std::size_t bytes) override {
    if (events() == 0) return -EAGAIN;
    const std::uint64_t expirations = 1;
    if (bytes < sizeof expirations) return -EINVAL;
    std::memcpy(buffer, &expirations, sizeof expirations);
    expiry_ = VirtualTime::kNever;
    return sizeof expirations;
  }
  void set(int flags, const itimerspec& setting) {
    const Nanoseconds value = setting.it_value.tv_sec * 1'000'000'000LL + setting.it_value.tv_nsec;
    const bool absolute = (flags & TFD_TIMER_ABSTIME) != 0;
    expiry_ =
        value == 0 ? VirtualTime::kNever : value + (absolute ? 0 : VirtualTime::instance().now());
  }

 private:
  Nanoseconds expiry_ = VirtualTime::kNever;
};

short real_events(const pollfd& wanted) {
  pollfd one = wanted;
  one.revents = 0;
  return REAL(poll)(&one, 1, 0) > 0 ? one.revents : static_cast<short>(0);
}

int look(pollfd* fds, nfds_t count) {
  int ready = 0;
  for (nfds_t i = 0; i < count; ++i) {
    const auto file = file_of(fds[i].fd);
    const short wanted = static_cast<short>(fds[i].events | POLLERR | POLLHUP);
    fds[i].revents = file ? static_cast<short>(file->events() & wanted) : real_events(fds[i]);
    ready += fds[i].revents != 0 ? 1 : 0;
  }
  return ready;
}

// What the emulated kernel allocates is not the program's.
int poll_in_virtual_time(pollfd* fds, nfds_t count, VirtualTime::Nanoseconds timeout) {
  const HeapExemption exempt;
  VirtualTime& time = VirtualTime::instance();
  VirtualTime::Lock lock(time.mutex());
  const auto deadline =
      timeout < 0 || timeout == VirtualTime::kNever ? VirtualTime::kNever : time.now() + timeout;
  int ready = 0;
  time.wait(
      lock, deadline,
      [&] {
        ready = look(fds, count);
        return ready != 0;
      },
      [&] {
        auto next = VirtualTime::kNever;
        for (nfds_t i = 0; i < count; ++i)
          if (const auto file = file_of(fds[i].fd)) next = std::min(next, file->next_change());
        return next;
      });
  return ready;
}

bool some_are_emulated(const pollfd* fds, nfds_t count) {
  const std::lock_guard hold(VirtualTime::instance().mutex());
  for (nfds_t i = 0; i < count; ++i)
    if (file_of(fds[i].fd)) return true;
  return false;
}

}  // namespace

int EmulatedFile::ioctl(unsigned long /*request*/, void* /*argument*/) {
  return -ENOTTY;
}
ssize_t EmulatedFile::read(void* /*buffer*/, std::size_t /*bytes*/) {
  return -EBADF;
}
ssize_t EmulatedFile::write(const void* /*bytes*/, std::size_t /*count*/) {
  return -EBADF;
}
void* EmulatedFile::map(std::size_t /*bytes*/) {
  return nullptr;
}

void serve_paths(const std::string& prefix, PathOpener opener) {
  const std::lock_guard hold(VirtualTime::instance().mutex());
  if (opener)
    seam().openers[prefix] = std::move(opener);
  else
    seam().openers.erase(prefix);
}

void serve_folder(const std::string& folder, std::function<std::vector<std::string>()> names) {
  const std::lock_guard hold(VirtualTime::instance().mutex());
  seam().folders[folder] = std::move(names);
}

}  // namespace wagonsight::device

// ---- the system calls

using wagonsight::device::VirtualTime;
using namespace wagonsight::device;  // NOLINT(google-build-using-namespace): what follows is C

extern "C" {

int open(const char* path, int flags, ...) {
  int fd = -1;
  if (open_emulated(path, fd)) return fd;
  va_list rest;
  va_start(rest, flags);
  const auto mode = va_arg(rest, mode_t);
  va_end(rest);
  return REAL(open)(path, flags, mode);
}

// What open() becomes in programs that were built with _FORTIFY_SOURCE.
int __open_2(const char* path, int flags);  // NOLINT(bugprone-reserved-identifier)
int __open_2(const char* path, int flags) {
  return open(path, flags);
}

int close(int fd) {
  std::shared_ptr<EmulatedFile> gone;
  {
    const std::lock_guard hold(VirtualTime::instance().mutex());
    if (file_of(fd)) gone.swap(seam().files[static_cast<std::size_t>(fd)]);
    gone.reset();
  }
  return REAL(close)(fd);
}

int ioctl(int fd, unsigned long request, ...) noexcept {
  va_list rest;
  va_start(rest, request);
  void* const argument = va_arg(rest, void*);
  va_end(rest);
  {
    const wagonsight::HeapExemption exempt;
    const std::lock_guard hold(VirtualTime::instance().mutex());
    if (const auto file = file_of(fd)) return answer(file->ioctl(request, argument));
  }
  return REAL(ioctl)(fd, request, argument);
}

int poll(pollfd* fds, nfds_t count, int timeout) {
  if (!VirtualTime::this_thread_acts() || (timeout < 0 && !some_are_emulated(fds, count)))
    return REAL(poll)(fds, count, timeout);
  return poll_in_virtual_time(fds, count, timeout < 0 ? -1 : timeout * 1'000'000LL);
}

ssize_t read(int fd, void* buffer, std::size_t bytes) {
  VirtualTime& time = VirtualTime::instance();
  if (fd >= 0) {
    const wagonsight::HeapExemption exempt;
    VirtualTime::Lock lock(time.mutex());
    if (const auto file = file_of(fd)) {
      ssize_t got = file->read(buffer, bytes);
      const bool waits = dynamic_cast<VirtualTimer*>(file.get()) == nullptr;
      if (got == -EAGAIN && waits && VirtualTime::this_thread_acts())
        time.wait(
            lock, VirtualTime::kNever,
            [&] {
              got = file->read(buffer, bytes);
              return got != -EAGAIN;
            },
            [&] { return file->next_change(); });
      return answer(got);
    }
  }
  return REAL(read)(fd, buffer, bytes);
}

ssize_t write(int fd, const void* bytes, std::size_t count) {
  if (fd > STDERR_FILENO) {
    const std::lock_guard hold(VirtualTime::instance().mutex());
    if (const auto file = file_of(fd)) return answer(file->write(bytes, count));
  }
  return REAL(write)(fd, bytes, count);
}

void* mmap(void* address, std::size_t bytes, int protection, int flags, int fd,
           off_t offset) noexcept {
  if (fd >= 0) {
    const std::lock_guard hold(VirtualTime::instance().mutex());
    if (const auto file = file_of(fd)) {
      void* const memory = file->map(bytes);
      if (memory == nullptr) errno = ENODEV;
      return memory == nullptr ? MAP_FAILED : memory;
    }
  }
  static auto* const real_mmap =
      reinterpret_cast<void* (*)(void*, std::size_t, int, int, int, off_t)>(
          dlsym(RTLD_NEXT, "mmap"));
  return real_mmap(address, bytes, protection, flags, fd, offset);
}

int clock_gettime(clockid_t clock, timespec* out) noexcept {
  if (!VirtualTime::this_thread_acts()) return REAL(clock_gettime)(clock, out);
  const auto now = VirtualTime::instance().now();
  *out = {now / 1'000'000'000, now % 1'000'000'000};
  return 0;
}

int nanosleep(const timespec* wanted, timespec* left) {
  if (!VirtualTime::this_thread_acts()) return REAL(nanosleep)(wanted, left);
  VirtualTime& time = VirtualTime::instance();
  time.sleep_until(time.now() + wanted->tv_sec * 1'000'000'000 + wanted->tv_nsec);
  return 0;
}

int clock_nanosleep(clockid_t clock, int flags, const timespec* wanted, timespec* left) {
  if (!VirtualTime::this_thread_acts()) return REAL(clock_nanosleep)(clock, flags, wanted, left);
  VirtualTime& time = VirtualTime::instance();
  const auto value = wanted->tv_sec * 1'000'000'000 + wanted->tv_nsec;
  time.sleep_until((flags & TIMER_ABSTIME) != 0 ? value : time.now() + value);
  return 0;
}

int usleep(useconds_t microseconds) {
  const timespec wanted{microseconds / 1'000'000,
                        static_cast<long>(microseconds % 1'000'000) * 1000};
  return nanosleep(&wanted, nullptr);
}

int timerfd_create(int clock, int flags) noexcept {
  if (!VirtualTime::this_thread_acts()) return REAL(timerfd_create)(clock, flags);
  const std::lock_guard hold(VirtualTime::instance().mutex());
  return place(std::make_shared<VirtualTimer>());
}

int timerfd_settime(int fd, int flags, const itimerspec* setting, itimerspec* old) noexcept {
  {
    const std::lock_guard hold(VirtualTime::instance().mutex());
    if (const auto timer = std::dynamic_pointer_cast<VirtualTimer>(file_of(fd))) {
      timer->set(flags, *setting);
      return 0;
    }
  }
  return REAL(timerfd_settime)(fd, flags, setting, old);
}

// libusb asks whether /sys is there; the emulated one always is.
int statfs(const char* path, struct statfs* out) noexcept {
  if (std::strcmp(path, "/sys") != 0 && std::strcmp(path, "/sys/") != 0)
    return REAL(statfs)(path, out);
  *out = {};
  out->f_type = kSysfsMagic;
  return 0;
}

// After the last real entry of a served folder, its emulated ones.
dirent* readdir(DIR* folder) {
  dirent* const entry = REAL(readdir)(folder);
  if (entry != nullptr) return entry;
  thread_local dirent invented;
  thread_local DIR* last_folder = nullptr;
  thread_local std::size_t told = 0;
  if (folder != last_folder) told = 0;
  last_folder = folder;
  const std::string link = "/proc/self/fd/" + std::to_string(dirfd(folder));
  std::array<char, 256> path{};
  if (readlink(link.c_str(), path.data(), path.size() - 1) < 0) return nullptr;
  const std::lock_guard hold(VirtualTime::instance().mutex());
  const auto found = seam().folders.find(path.data());
  if (found == seam().folders.end()) return nullptr;
  const auto names = found->second();
  if (told >= names.size()) {
    last_folder = nullptr;
    return nullptr;
  }
  std::strncpy(invented.d_name, names[told++].c_str(), sizeof invented.d_name - 1);
  return &invented;
}

}  // extern "C"

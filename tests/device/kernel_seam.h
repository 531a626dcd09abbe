#pragma once

#include <sys/types.h>

#include <cstddef>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "virtual_time.h"

// The seam between the real libraries and the emulated devices: the system calls by which libusb
// and libdc1394 (Debian's own builds, unchanged) reach the kernel. This program defines open(),
// ioctl(), poll() and so on itself; the dynamic loader binds the libraries' calls to them. Paths
// that nothing is registered for, and files that are not emulated, go to the real kernel.
//
// For actors of the virtual time the clocks, timers and sleeps are virtual, too.
namespace wagonsight::device {

// What stands behind a file descriptor. Every call comes with VirtualTime's mutex held.
class EmulatedFile {
 public:
  virtual ~EmulatedFile() = default;
  // 0 or more, or -errno.
  virtual int ioctl(unsigned long request, void* argument);
  // poll()'s events as they are now, whatever was asked for.
  virtual short events() { return 0; }
  // When they may change by themselves.
  virtual Nanoseconds next_change() { return VirtualTime::kNever; }
  // Bytes, or -errno; -EAGAIN makes a reader wait.
  virtual ssize_t read(void* buffer, std::size_t bytes);
  virtual ssize_t write(const void* bytes, std::size_t count);
  // Memory for mmap(); nullptr: cannot be mapped.
  virtual void* map(std::size_t bytes);
};

// Opens a path: an emulated file, or the text of a plain file, or neither and -errno. Called with
// the mutex held. Returning nothing at all (all empty, error 0) passes the path to the kernel.
struct Opened {
  std::shared_ptr<EmulatedFile> file;
  std::unique_ptr<std::string> text;
  int error = 0;
};
using PathOpener = std::function<Opened(const std::string& path)>;
// Everything below `prefix` is asked of `opener` from now on; an empty opener takes that back.
void serve_paths(const std::string& prefix, PathOpener opener);

// Names that readdir() adds to those of a real folder.
void serve_folder(const std::string& folder, std::function<std::vector<std::string>()> names);

}  // namespace wagonsight::device

#pragma once

#include "base/result.h"

namespace wagonsight {

// Takes from this process everything that serving a page does not need: it dies with the daemon,
// runs behind it (nice), is nobody when it was root, gains no privilege any more, is limited in
// memory and descriptors, and can no longer open a file, make a socket, start a program or touch
// another process (seccomp). One way.
Result<void> confine_web_side(int daemon_pid);

}  // namespace wagonsight

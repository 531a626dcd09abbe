#pragma once

#include <string>
#include <vector>

#include "slots/updater.h"

namespace wagonsight {

// Answers calls at a socket (SOCK_SEQPACKET, see update/updater_call.h) until SIGTERM. The socket
// belongs to `group`, so that the daemon can open it, which hands it to the page's process.
// `restart` is run when a restart of the machine is asked for.
Result<void> serve(Updater& updater, const std::string& socket, int group,
                   const std::vector<std::string>& restart);

}  // namespace wagonsight

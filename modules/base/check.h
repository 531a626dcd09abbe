#pragma once

#include <cstdio>
#include <cstdlib>

// Always-on check of an internal contract. Prints the condition and, printf-style, the values that
// broke it, then aborts; the watchdog restarts the daemon. Input from outside is never CHECKed: it
// gets a Result.
#define WS_CHECK(condition, ...)                                                            \
  do {                                                                                      \
    if (!(condition)) [[unlikely]] {                                                        \
      std::fprintf(stderr, "%s:%d: broken contract: %s: ", __FILE__, __LINE__, #condition); \
      std::fprintf(stderr, __VA_ARGS__);                                                    \
      std::fputc('\n', stderr);                                                             \
      std::abort();                                                                         \
    }                                                                                       \
  } while (false)

#pragma once

#include <cstddef>
#include <cstdint>

// What the page's process asks the updater, over a socket that keeps messages apart: this header
// and, with a block, its bytes. The answer is an UpdaterAnswer and, behind it, JSON. One answer a
// call.
namespace wagonsight {

enum class UpdaterWish : std::uint8_t {
  kTell,          // how it is
  kBlock,         // the next bytes of a bundle
  kDiscard,       // forget what has come of it
  kRestart,       // the machine, so that what was taken counts
  kFactoryReset,  // at the next start only identity and calibration are left
};

struct UpdaterCall {
  UpdaterWish wish = UpdaterWish::kTell;
  std::uint64_t offset = 0;  // of the block in the bundle's file
  std::uint64_t total = 0;   // of that file; 0: not known
};

struct UpdaterAnswer {
  std::uint16_t status = 200;  // of HTTP
};

inline constexpr std::size_t kUpdaterBlockBytesMax = 65'536;
inline constexpr std::size_t kUpdaterAnswerBytesMax = 8192;

}  // namespace wagonsight

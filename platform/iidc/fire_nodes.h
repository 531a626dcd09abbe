#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace wagonsight {

// A node of an IEEE 1394 bus as the kernel knows it, without a word to the node itself.
struct FireNode {
  std::string path;  // "/dev/fw1"
  std::uint64_t guid = 0;
  std::uint32_t card = 0;  // its bus
  bool is_camera = false;  // IIDC
};

struct FireNodes {
  std::vector<FireNode> nodes;
  bool some_forbidden = false;  // a node that may not be opened
  // libdc1394 2.2.6 reads every node's configuration ROM and crashes on a name of no length, or
  // reads memory that it never filled. While such a device is plugged in, it must not look.
  bool some_malformed = false;

  const FireNode* find(std::uint64_t guid) const;
  int cameras_on(std::uint32_t card) const;
};

// Opens each /dev/fw* for a moment. Allocates.
FireNodes find_fire_nodes();

// Makes a bus reset on the node's bus; false: the kernel refused.
bool reset_fire_bus(const FireNode& node);

// "00b09d0100a00000", with or without "0x" before it; 0: that is no GUID.
std::uint64_t parse_guid(std::string_view text);

}  // namespace wagonsight

#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace wagonsight {

// A packet as the bus delivered it.
struct IsoPacket {
  int length = 0;  // as its header says
  bool begins_image = false;
  std::uint16_t stamp = 0;             // seconds modulo 8 and cycle of its arrival
  std::span<const std::byte> payload;  // as much of it as there was room for
};

// How two images of one camera lie in what it sends.
enum class PairLayout { kLeftAboveRight, kLeftBesideRight };

struct PairShape {
  int width = 0, height = 0;  // of one image
  PairLayout layout = PairLayout::kLeftAboveRight;
  int packet_bytes = 0, packets = 0;
  int shift = 0;  // to the right, of values that use the upper bits
};

// Puts the packets of a camera together to pairs of images and knows whether each is whole, which
// neither the bus nor libdc1394 tells: it is when it has a begin and all packets have their length
// and came in successive cycles, as IIDC cameras send them. One thread; never allocates.
class PairAssembly {
 public:
  explicit PairAssembly(const PairShape& shape = {}) : shape_(shape) {}

  struct Step {
    bool lost_one = false;   // an image that had begun, or of which only parts came, ended damaged
    bool begins = false;     // this packet begins an image
    bool completes = false;  // this packet completes an image without a fault
  };
  // Takes in a packet; its pixels go into `out`, as a Gray16 pair: the left image, then the right
  // one. `out` may be empty: then the image is judged, but not kept. It must stay the same from an
  // image's begin to its end.
  Step add(const IsoPacket& packet, std::span<std::uint16_t> out);

  // Whether an image has begun and is not complete.
  bool is_open() const { return is_open_; }
  // Whether a begin now would tell that the image before it is lost.
  bool ends_badly() const { return is_open_ || has_orphans_; }

 private:
  void copy(std::span<const std::byte> payload, std::span<std::uint16_t> out) const;

  PairShape shape_;
  bool is_open_ = false, is_good_ = false, has_orphans_ = false;
  int count_ = 0;
  std::uint16_t last_stamp_ = 0;
};

}  // namespace wagonsight

#include "foreground/pixel_memory.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdlib>
#include <cstring>

namespace wagonsight {
namespace {

constexpr float kStillUnit_s = 0.02F;
// Unknown depth that stays for so long is a surface that was uncovered.
constexpr float kSettled_s = 0.4F;
// Nobody walks away faster; a larger step is from somebody to what was behind him.
constexpr float kSpeedMax_m_s = 2.0F;
constexpr float kJump_m = 0.3F;
// Two moves are somebody; one is a surface that was uncovered.
constexpr std::uint8_t kMovesMin = 2;
constexpr int kMovesMax = 3, kStillMax = 63;  // what is counted
// A flicker adds so much unrest, a round of a quarter of a second takes one away: two flickers
// within four seconds make a pixel restless, and it stays so while it flickers every ten seconds.
constexpr int kUnrestPerFlicker = 40;
constexpr int kUnrestMax = 60;
constexpr int kUnrestOfEdges = 72;
constexpr int kEdgeReach = 2;  // pixels
// One word of 64 pixels in so many can have motions at a time (557 of 4,800 in scene rush), and a
// few more where images are small.
constexpr std::size_t kWordsPerMotions = 4;
constexpr std::size_t kMotionsMin = 64;

template <class Visit>
void visit_bits(std::uint64_t bits, Visit&& visit) {
  for (; bits != 0; bits &= bits - 1) visit(static_cast<std::size_t>(std::countr_zero(bits)));
}

}  // namespace

PixelMemory::PixelMemory(const SensorView& view)
    : motions_at_((view.pixel_count() + 63) / 64),
      unknown_before_(motions_at_.capacity()),
      foreground_before_(unknown_before_.capacity()),
      restless_(unknown_before_.capacity()),
      unrest_(view.pixel_count()) {
  const std::size_t motions = std::min(unknown_before_.capacity() / kWordsPerMotions + kMotionsMin,
                                       unknown_before_.capacity());
  motions_ = BoundedVector<Motions>(std::min<std::size_t>(motions, kNone));
  motions_.resize(motions_.capacity());
  free_motions_ = BoundedVector<std::uint16_t>(motions_.capacity());
  for (std::size_t i = motions_.capacity(); i > 0; --i) {
    (void)free_motions_.try_push_back(static_cast<std::uint16_t>(i - 1));
  }
  motions_at_.resize(motions_at_.capacity());
  std::fill(motions_at_.begin(), motions_at_.end(), kNone);
  unrest_.resize(unrest_.capacity());
  for (auto* bits : {&unknown_before_, &foreground_before_, &restless_}) {
    bits->resize(bits->capacity());
  }
}

void PixelMemory::distrust_edges(const SensorView& view, DepthImage image, int first_row,
                                 int end_row) {
  const DepthModel& depth = view.depth();
  for (int v = first_row; v < end_row; ++v) {
    for (int u = 0; u < image.width; ++u) {
      const std::uint16_t here = image.at(u, v);
      const std::uint16_t known = std::min(here, depth.raw_far());
      bool edge = here == 0;
      for (int i = -kEdgeReach; i <= kEdgeReach && !edge; i += kEdgeReach) {
        for (int j = -kEdgeReach; j <= kEdgeReach && !edge; j += kEdgeReach) {
          if (u + i < 0 || v + j < 0 || u + i >= image.width || v + j >= image.height) continue;
          const std::uint16_t there = image.at(u + i, v + j);
          edge = there == 0 || std::abs(depth.z(std::min(there, depth.raw_far())) -
                                        depth.z(known)) > 2 * depth.tolerance(known);
        }
      }
      if (!edge) continue;
      const std::size_t pixel = image.index(u, v);
      unrest_[pixel] = kUnrestOfEdges;
      restless_[pixel / 64] |= std::uint64_t{1} << (pixel % 64);
    }
  }
}

void PixelMemory::promote_moving(const SensorView& view, DepthImage image, float frame_s,
                                 std::span<std::uint64_t> foreground,
                                 std::span<std::uint64_t> unknown) {
  const int step = std::clamp(static_cast<int>(frame_s / kStillUnit_s + 0.5F), 1, 255);
  const int settled = static_cast<int>(kSettled_s / kStillUnit_s);
  const float jump_m = std::max(kJump_m, frame_s * kSpeedMax_m_s);
  for (std::size_t word = 0; word < unknown.size(); ++word) {
    const std::uint64_t now = unknown[word], before = unknown_before_[word];
    if ((now | before) == 0) continue;
    const std::uint16_t at = now == 0 ? kNone : motions_of(word);
    if (at == kNone) {
      release_motions(word);
      unknown_before_[word] = 0;
      continue;
    }
    Motions& motions = motions_[at];
    visit_bits(now, [&](std::size_t place) {
      const std::size_t pixel = word * 64 + place;
      std::uint16_t& moved_to = motions.moved_to[place];
      Motion& motion = motions.motion[place];
      const std::uint16_t raw = image.pixels[pixel];
      const float moved = std::abs(view.depth().z(raw) - view.depth().z(moved_to));
      if (((before >> place) & 1) == 0 || moved > jump_m) {
        moved_to = raw;
        motion = {};
        return;
      }
      if (moved > view.depth().tolerance(raw)) {
        moved_to = raw;
        motion.still = 0;
        motion.moves = static_cast<std::uint8_t>(std::min(motion.moves + 1, kMovesMax)) & 3U;
      } else {
        motion.still = static_cast<std::uint8_t>(std::min(motion.still + step, kStillMax)) & 63U;
        if (motion.still >= settled) motion.moves = 0;
      }
      if (motion.moves < kMovesMin) return;
      foreground[word] |= std::uint64_t{1} << place;
      unknown[word] &= ~(std::uint64_t{1} << place);
    });
    unknown_before_[word] = now;
  }
}

std::uint16_t PixelMemory::motions_of(std::size_t word) {
  if (motions_at_[word] != kNone) return motions_at_[word];
  if (free_motions_.empty()) {
    ++motions_refused_;
    return kNone;
  }
  motions_at_[word] = free_motions_[free_motions_.size() - 1];
  free_motions_.resize(free_motions_.size() - 1);
  return motions_at_[word];
}

void PixelMemory::release_motions(std::size_t word) {
  if (motions_at_[word] == kNone) return;
  (void)free_motions_.try_push_back(motions_at_[word]);
  motions_at_[word] = kNone;
}

void PixelMemory::set_aside(std::span<std::uint64_t> foreground,
                            std::span<std::uint64_t> restless) const {
  for (std::size_t word = 0; word < foreground.size(); ++word) {
    restless[word] = foreground[word] & restless_[word];
    foreground[word] &= ~restless_[word];
  }
}

void PixelMemory::observe(std::span<const std::uint64_t> small, std::span<const std::uint64_t> all,
                          float round_share) {
  for (std::size_t word = 0; word < small.size(); ++word) {
    visit_bits(small[word] & ~foreground_before_[word], [&](std::size_t place) {
      std::uint8_t& unrest = unrest_[word * 64 + place];
      unrest = static_cast<std::uint8_t>(std::min(255, unrest + kUnrestPerFlicker));
      if (unrest > kUnrestMax) restless_[word] |= std::uint64_t{1} << place;
    });
    foreground_before_[word] = all[word];
  }
  const std::size_t words = restless_.size();
  auto count = static_cast<std::size_t>(std::ceil(round_share * static_cast<float>(words)));
  for (; count > 0; --count, ++next_word_) {
    if (next_word_ >= words) next_word_ = 0;
    const std::size_t end = std::min(unrest_.size(), next_word_ * 64 + 64);
    for (std::size_t pixel = next_word_ * 64; pixel < end; ++pixel) {
      if (pixel % 8 == 0 && pixel + 8 <= end) {  // most are calm: eight at a look
        std::uint64_t eight = 0;
        std::memcpy(&eight, &unrest_[pixel], sizeof eight);
        if (eight == 0) {
          pixel += 7;
          continue;
        }
      }
      if (unrest_[pixel] == 0) continue;
      if (--unrest_[pixel] == kUnrestMax) {
        restless_[next_word_] &= ~(std::uint64_t{1} << (pixel % 64));
      }
    }
  }
}

}  // namespace wagonsight

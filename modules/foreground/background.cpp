#include "foreground/background.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

namespace wagonsight {
namespace {

constexpr double kRound_s = 0.25;
// Hits saturate here: 15 s of evidence; what is older counts no more.
constexpr int kHitsMax = 60;
// A leaf that was hit h times goes when seen through in 2 + h / 6 rounds more often than there:
// half a second for what was only assumed, three seconds for the wall.
constexpr int kFreesMin = 2;
constexpr int kHitsPerFree = 6;
// Noise must come back for so many rounds to become background.
constexpr int kNoiseHits = 5;
// What comes back less often than every so many rounds never becomes background.
constexpr float kFadeRounds = 8;
// Well-known leaves are looked at every so many rounds, each look counting as many times.
constexpr std::uint32_t kStrongRounds = 4;
// Whole learning: background was there at least in this share of the frames that could tell, and
// in so many frames.
constexpr double kThereShare = 0.5;
constexpr int kThereFramesMin = 3;

template <class Visit>
void visit_pixels(std::span<const std::uint64_t> bits, Visit&& visit) {
  for (std::size_t word = 0; word < bits.size(); ++word) {
    for (std::uint64_t rest = bits[word]; rest != 0; rest &= rest - 1) {
      visit(word * 64 + static_cast<std::size_t>(std::countr_zero(rest)));
    }
  }
}

}  // namespace

Background::Background(const SensorView& view, std::size_t evidence_nodes_max)
    : leaves_(view.grid(), evidence_nodes_max / 2),
      evidence_(view.grid(), evidence_nodes_max),
      thresholds_(view),
      empty_rounds_(std::make_unique<std::uint8_t[]>(view.pixel_count())),
      candidates_(evidence_.brick_capacity()),
      candidate_(std::make_unique<std::uint64_t[]>(view.grid().block_count())) {}

void Background::gather(const SensorView& view, DepthImage image) {
  vote_ += 2;  // of this frame, whatever was seen before
  ++gathered_;
  for (std::size_t pixel = 0; pixel < image.pixel_count(); ++pixel) {
    const std::uint16_t raw = image.pixels[pixel];
    if (raw < view.depth().raw_near() || raw > view.depth().raw_far()) continue;
    if (!view.has_ray(pixel)) continue;
    const LeafAddress leaf = view.leaf_of(pixel, raw);
    if (leaf == kNoLeaf) continue;
    LeafEvidence* evidence = evidence_.find_or_add(leaf);
    if (evidence == nullptr || !evidence_.see(leaf, vote_)) continue;
    if (evidence->hits == UINT8_MAX) {  // keeps the ratio and forgets slowly
      evidence->hits /= 2;
      evidence->frees /= 2;
    }
    ++evidence->hits;
  }
  for (const BrickAddress brick : evidence_.bricks()) {
    evidence_.visit_brick(brick, [&](LeafAddress leaf, LeafEvidence& evidence) {
      if (evidence.hits == 0 || evidence_.seen(leaf, vote_)) return;
      if (look(view, image, view.grid().leaf_at(leaf)) != Seen::kThrough) return;
      if (evidence.frees == UINT8_MAX) {
        evidence.hits /= 2;
        evidence.frees /= 2;
      }
      ++evidence.frees;
    });
  }
}

void Background::forget_candidates() {
  for (const BrickAddress brick : candidates_) candidate_[brick / 64] = 0;
  candidates_.clear();
}

void Background::decide(const SensorView& view) {
  forget_candidates();
  leaves_.clear();
  vote_ += 2;
  const int frames_min = std::min(kThereFramesMin, static_cast<int>(gathered_));
  for (const BrickAddress brick : evidence_.bricks()) {
    evidence_.visit_brick(brick, [&](LeafAddress leaf, LeafEvidence& evidence) {
      const double told = evidence.hits + evidence.frees;
      if (evidence.hits >= frames_min && evidence.hits >= kThereShare * told) {
        leaves_.insert(leaf);
        evidence.hits = static_cast<std::uint8_t>(std::min<int>(evidence.hits, kHitsMax));
        evidence.frees = 0;
      } else {
        evidence = {};
      }
    });
  }
  for (std::size_t i = evidence_.bricks().size(); i > 0; --i) {
    release_if_idle(evidence_.bricks()[i - 1]);
  }
  redo_thresholds(view);
  for (std::size_t pixel = 0; pixel < view.pixel_count(); ++pixel) {
    if (!thresholds_.has_background(pixel)) thresholds_.set_open(pixel);
  }
  rounds_ = std::max(rounds_, gathered_);
  gathered_ = 0;
}

LeafAddress Background::assume_reading(const SensorView& view, DepthImage image,
                                       std::size_t pixel) {
  const std::uint16_t raw = image.pixels[pixel];
  if (raw < view.depth().raw_near() || raw > view.depth().raw_far()) return kNoLeaf;
  if (!view.has_ray(pixel)) return kNoLeaf;
  const LeafAddress leaf = view.leaf_of(pixel, raw);
  if (leaf == kNoLeaf || !leaves_.insert(leaf)) return kNoLeaf;
  if (LeafEvidence* evidence = evidence_.find_or_add(leaf)) evidence->hits = 1;
  return leaf;
}

void Background::assume(const SensorView& view, DepthImage image) {
  for (std::size_t pixel = 0; pixel < image.pixel_count(); ++pixel) {
    (void)assume_reading(view, image, pixel);
  }
  assumed_rows_ = image.height;
  redo_thresholds(view);
}

std::size_t Background::assume_rows(const SensorView& view, DepthImage image,
                                    std::size_t work_max) {
  std::size_t work = 0;
  while (assumed_rows_ < image.height && (work == 0 || work < work_max)) {
    const std::size_t first = image.index(0, assumed_rows_++);
    const std::size_t end = first + static_cast<std::size_t>(image.width);
    work += end - first;
    for (std::size_t pixel = first; pixel < end; ++pixel) {
      const LeafAddress leaf = assume_reading(view, image, pixel);
      if (leaf != kNoLeaf) work += thresholds_.leaf_added(view, leaves_, leaf);
    }
  }
  return work;
}

void Background::redo_thresholds(const SensorView& view) {
  thresholds_.reset();
  leaves_.visit([&](LeafAddress leaf) { (void)thresholds_.leaf_added(view, leaves_, leaf); });
}

float Background::advance(HostTime instant) {
  if (!started_) {
    started_ = true;
    last_instant_ = round_start_ = instant;
    rounds_ += 1;
    return 1.0F;
  }
  const double frame_s = std::max(0.0, to_seconds(instant - last_instant_));
  last_instant_ = instant;
  slow_frames_ = frame_s > 0.6 * kRound_s;
  // Half a frame of slack, so that clock jitter does not make a round a frame longer.
  if (to_seconds(instant - round_start_) + 0.5 * frame_s >= kRound_s) {
    round_start_ = instant;
    ++rounds_;
    ++vote_;
  }
  const auto share = static_cast<float>(std::min(1.0, frame_s / kRound_s));
  fade_candidates(share);
  return share;
}

// What is not background and was not seen in this round or the last loses a hit, every kFadeRounds.
void Background::fade_candidates(float round_share) {
  fade_share_ += round_share * static_cast<float>(candidates_.size()) / kFadeRounds;
  for (; fade_share_ >= 1 && !candidates_.empty(); fade_share_ -= 1) {
    if (next_candidate_ >= candidates_.size()) next_candidate_ = 0;
    const BrickAddress brick = candidates_[next_candidate_];
    bool any = false;
    evidence_.visit_brick(brick, [&](LeafAddress leaf, LeafEvidence& evidence) {
      if (evidence.hits == 0 || leaves_.contains(leaf)) return;
      any = true;
      if (!evidence_.seen_lately(leaf, vote_)) --evidence.hits;
    });
    if (any) {
      ++next_candidate_;
      continue;
    }
    candidate_[brick / 64] &= ~(std::uint64_t{1} << (brick % 64));
    candidates_[next_candidate_] = candidates_[candidates_.size() - 1];
    candidates_.resize(candidates_.size() - 1);
    release_if_idle(brick);
  }
}

void Background::release_if_idle(BrickAddress brick) {
  if (!leaves_.brick_occupied(brick) && !is_candidate(brick)) evidence_.forget(brick);
}

void Background::add_leaf(const SensorView& view, LeafAddress leaf) {
  if (leaves_.insert(leaf)) (void)thresholds_.leaf_added(view, leaves_, leaf);
}

void Background::remove_leaf(const SensorView& view, LeafAddress leaf) {
  if (leaves_.erase(leaf)) thresholds_.leaf_removed(view, leaf);
  if (LeafEvidence* evidence = evidence_.find(leaf)) *evidence = {};
}

void Background::hit(const SensorView& view, LeafAddress leaf, int hits_needed) {
  if (leaf == kNoLeaf) return;
  LeafEvidence* evidence = evidence_.find_or_add(leaf);
  if (evidence == nullptr || !evidence_.see(leaf, vote_)) return;
  evidence->hits = static_cast<std::uint8_t>(std::min(evidence->hits + 1, kHitsMax));
  if (evidence->hits >= hits_needed) {
    evidence->frees = 0;
    add_leaf(view, leaf);
    return;
  }
  const BrickAddress brick = leaf / static_cast<std::uint32_t>(kBrickLeaves);
  if (is_candidate(brick)) return;
  candidate_[brick / 64] |= std::uint64_t{1} << (brick % 64);
  (void)candidates_.try_push_back(brick);  // there is room for every brick that has evidence
}

void Background::observe_new(const SensorView& view, DepthImage image,
                             std::span<const std::uint64_t> unknown,
                             std::span<const std::uint64_t> noise) {
  const int unknown_hits = slow_frames_ ? 2 : 3;
  visit_pixels(unknown, [&](std::size_t pixel) {
    hit(view, view.leaf_of(pixel, image.pixels[pixel]), unknown_hits);
  });
  visit_pixels(noise, [&](std::size_t pixel) {
    hit(view, view.leaf_of(pixel, image.pixels[pixel]), kNoiseHits);
  });
}

Background::Seen Background::look(const SensorView& view, DepthImage image,
                                  const LeafIndex& leaf) const {
  const Eigen::Vector3f centre = view.grid().centre(leaf).cast<float>();
  const auto seen = view.project(centre);
  if (!seen) return Seen::kNothing;
  const float half = 0.5F * static_cast<float>(view.grid().leaf_m());
  const int reach = std::max(1, static_cast<int>(half * view.focal() / seen->z));
  const DepthModel& depth = view.depth();
  // The centre and four corners of what the leaf covers: a leaf at an edge is only half seen
  // through.
  constexpr std::array<std::array<int, 2>, 5> kCorners{
      {{0, 0}, {-1, -1}, {1, -1}, {-1, 1}, {1, 1}}};
  int through = 0;
  for (const auto& corner : kCorners) {
    const int u = seen->u + corner[0] * reach, v = seen->v + corner[1] * reach;
    if (u < 0 || v < 0 || u >= image.width || v >= image.height) continue;
    const std::uint16_t raw = image.at(u, v);
    if (raw == 0) {
      if (&corner == kCorners.data()) return Seen::kNothing;
      continue;
    }
    const std::uint16_t known = std::min(raw, depth.raw_far());
    const float z = depth.z(known), tolerance = depth.tolerance(known);
    if (z + tolerance < seen->z - 2 * half) {  // something is before it
      if (&corner == kCorners.data()) return Seen::kNothing;
      continue;
    }
    if (z - tolerance <= seen->z + 2 * half) return Seen::kThere;
    ++through;
  }
  return through >= 3 ? Seen::kThrough : Seen::kNothing;
}

void Background::observe_free(const SensorView& view, DepthImage image, float round_share) {
  const auto bricks = leaves_.touched();
  if (bricks.empty()) return;
  auto count = static_cast<std::size_t>(std::ceil(round_share * static_cast<float>(bricks.size())));
  for (; count > 0; --count) {
    if (next_leaf_brick_ >= bricks.size()) next_leaf_brick_ = 0;
    const BrickAddress brick = bricks[next_leaf_brick_++];
    if (!leaves_.brick_occupied(brick)) {
      release_if_idle(brick);
      continue;
    }
    const LeafIndex first = view.grid().leaf_at(brick * static_cast<std::uint32_t>(kBrickLeaves));
    leaves_.visit_brick(brick, [&](LeafAddress leaf) {
      LeafEvidence* evidence = evidence_.find_or_add(leaf);
      if (evidence == nullptr) return;
      const bool strong = evidence->hits == kHitsMax;
      if (strong && (rounds_ + brick) % kStrongRounds != 0) return;
      switch (look(view, image, LeafGrid::leaf_in_brick(first, leaf))) {
        case Seen::kNothing:
          return;
        case Seen::kThere:
          evidence->hits = static_cast<std::uint8_t>(std::min(evidence->hits + 1, kHitsMax));
          evidence->frees = evidence->frees > 2 ? static_cast<std::uint8_t>(evidence->frees - 2)
                                                : std::uint8_t{0};
          return;
        case Seen::kThrough:
          evidence->frees =
              static_cast<std::uint8_t>(evidence->frees + (strong ? kStrongRounds : 1));
          if (evidence->frees >= kFreesMin + evidence->hits / kHitsPerFree) {
            remove_leaf(view, leaf);
          }
          return;
      }
    });
  }
  thresholds_.settle(view, leaves_);
}

void Background::observe_empty(const SensorView& view, DepthImage image, float round_share,
                               int rounds_needed) {
  auto count =
      static_cast<std::size_t>(std::ceil(round_share * static_cast<float>(image.pixel_count())));
  const std::uint16_t far = view.depth().raw_far();
  for (; count > 0; --count, ++next_pixel_) {
    if (next_pixel_ >= image.pixel_count()) next_pixel_ = 0;
    while (next_pixel_ % 64 == 0 && count > 64 && next_pixel_ + 64 <= image.pixel_count() &&
           thresholds_.unknown_rays(next_pixel_ / 64) == 0) {
      next_pixel_ += 64;
      count -= 64;
      if (next_pixel_ >= image.pixel_count()) next_pixel_ = 0;
    }
    const std::size_t pixel = next_pixel_;
    if (thresholds_.has_background(pixel) || thresholds_.is_open(pixel)) continue;
    const std::uint16_t raw = image.pixels[pixel];
    std::uint8_t& rounds = empty_rounds_[pixel];
    const bool beyond = raw > far || (raw != 0 && view.leaf_of(pixel, raw) == kNoLeaf);
    if (raw != 0 && !beyond) {
      rounds = 0;
    } else if (++rounds >= rounds_needed || (beyond && rounds * 2 >= rounds_needed)) {
      thresholds_.set_open(pixel);
    }
  }
}

double Background::known_share(const SensorView& view) const {
  std::size_t known = 0;
  for (std::size_t pixel = 0; pixel < view.pixel_count(); ++pixel) {
    if (thresholds_.has_background(pixel) || thresholds_.is_open(pixel)) ++known;
  }
  return static_cast<double>(known) / static_cast<double>(view.pixel_count());
}

}  // namespace wagonsight

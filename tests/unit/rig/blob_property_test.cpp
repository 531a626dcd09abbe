#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <bit>

#include "rig/blob.h"
#include "support/blob_reseal.h"
#include "support/sample_rig.h"

namespace wagonsight {
namespace {

double real_in(double low, double high) {
  constexpr int kSteps = 1'000'000;
  return low + (high - low) * *rc::gen::inRange(0, kSteps + 1) / kSteps;
}

Rigid any_rigid() {
  const OmegaPhiKappa angles{real_in(-3.14, 3.14), real_in(-1.57, 1.57), real_in(-3.14, 3.14)};
  return {from_omega_phi_kappa(angles), {real_in(-20, 20), real_in(-20, 20), real_in(-3, 3)}};
}

Rig any_rig() {
  Rig rig;
  const int count = *rc::gen::inRange(0, static_cast<int>(kSensorsMax) + 1);
  for (int i = 0; i < count; ++i) {
    RigSensor s;
    s.name.assign("sensor-" + std::to_string(i));
    s.kind = *rc::gen::element(SensorKind::kKinect, SensorKind::kStereo);
    s.camera.width = *rc::gen::inRange(1, 20);
    s.camera.height = *rc::gen::inRange(1, 20);
    const double side = std::max(s.camera.width, s.camera.height);
    s.camera.fx = real_in(0.2 * side, 3 * side);
    s.camera.fy = real_in(0.2 * side, 3 * side);
    s.camera.cx = real_in(0, s.camera.width);
    s.camera.cy = real_in(0, s.camera.height);
    for (double& k : s.camera.distortion) k = real_in(-1, 1);
    s.X_BS = any_rigid();
    s.X_WS = any_rigid();
    s.has_pose = *rc::gen::arbitrary<bool>();
    s.stereo.baseline = real_in(0.01, 1);
    if (*rc::gen::arbitrary<bool>()) {
      s.stereo.left = s.stereo.right = s.camera;
      s.stereo.X_LR = any_rigid();
    }
    s.trim_near = real_in(0, 2);
    s.trim_far = real_in(2.1, 10);
    s.rate_hz = real_in(1, 60);
    s.depth_offset = real_in(-0.1, 0.1);
    if (*rc::gen::arbitrary<bool>()) s.stamp_delay = {real_in(0, 0.05), real_in(1e-5, 0.001)};
    for (int d = 0; d < 6; ++d) s.covariance(d, d) = real_in(0, 1e-3);
    s.covariance(0, 5) = s.covariance(5, 0) = real_in(-1e-4, 1e-4);
    rig.sensors.push_back(s);
  }
  rig.georeference.present = *rc::gen::arbitrary<bool>();
  const Rigid X_WB = any_rigid();
  rig.georeference.X_WB = {real_in(0.5, 2), X_WB.rotation, X_WB.position};
  rig.provenance.created_unix = *rc::gen::inRange(0, 2'000'000'000);
  return rig;
}

// Opening and packing again gives the same bytes: nothing is lost and nothing invented.
RC_GTEST_PROP(BlobProperty, RoundTripKeepsEveryByte, ()) {
  const Rig rig = any_rig();
  const auto bytes = pack_blob(rig);
  const auto blob = open_blob(bytes);
  if (!blob) RC_FAIL(blob.error().message);
  RC_ASSERT(blob->rig.sensors.size() == rig.sensors.size());
  for (std::size_t i = 0; i < rig.sensors.size(); ++i)
    RC_ASSERT(blob->rig.sensors[i].has_pose == rig.sensors[i].has_pose &&
              blob->rig.sensors[i].stamp_delay.delay_s == rig.sensors[i].stamp_delay.delay_s);
  RC_ASSERT(pack_blob(blob->rig) == bytes);
}

// Of a small blob every single bit is tried, so nothing in it is without a sum.
TEST(BlobProperty, EveryFlippedBitIsRefused) {
  Rig rig = test::sample_rig(3, 2);
  auto bytes = pack_blob(rig);
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    for (unsigned bit = 0; bit < 8; ++bit) {
      bytes[i] ^= std::byte(1U << bit);
      ASSERT_FALSE(open_blob(bytes)) << "bit " << bit << " of byte " << i;
      bytes[i] ^= std::byte(1U << bit);
    }
  }
}

TEST(BlobProperty, EveryTruncationIsRefused) {
  const auto bytes = pack_blob(test::sample_rig(3, 2));
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    // A copy of just that size, so that the address sanitizer sees a read beyond it.
    const std::vector<std::byte> cut(bytes.begin(),
                                     bytes.begin() + static_cast<std::ptrdiff_t>(size));
    ASSERT_FALSE(open_blob(cut)) << size;
  }
}

// Behind the sums: a blob that was changed and sealed again is refused or holds a rig that the
// pipeline may use.
RC_GTEST_PROP(BlobProperty, ResealedChangesAreRefusedOrSane, ()) {
  auto bytes = pack_blob(test::sample_rig(3, 2));
  const int changes = *rc::gen::inRange(1, 5);
  for (int i = 0; i < changes; ++i) {
    const auto at = *rc::gen::inRange<std::size_t>(0, bytes.size() - 32);
    bytes[at] = std::byte(*rc::gen::arbitrary<std::uint8_t>());
  }
  test::reseal_blob(bytes);
  const auto blob = open_blob(bytes);
  if (!blob) {
    RC_ASSERT(!blob.error().message.empty());
    return;
  }
  RC_ASSERT(check_rig(blob->rig).has_value());
  for (std::size_t i = 0; i < blob->rig.sensors.size(); ++i) {
    const RigSensor& sensor = blob->rig.sensors[i];
    const RayTable rays = blob->rays[i];
    const auto pixel_count = static_cast<std::size_t>(sensor.camera.width * sensor.camera.height);
    RC_ASSERT(rays.size() == (sensor.kind == SensorKind::kKinect ? pixel_count : 0));
    if (rays.empty()) continue;
    const auto* first = reinterpret_cast<const std::byte*>(rays.data());
    const bool inside =
        first >= bytes.data() && first + rays.size_bytes() <= bytes.data() + bytes.size();
    RC_ASSERT(inside);
  }
}

}  // namespace
}  // namespace wagonsight

#include "rig/blob.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <limits>

#include "support/blob_reseal.h"
#include "support/sample_rig.h"

namespace wagonsight {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

std::string refusal(std::span<const std::byte> bytes) {
  const auto blob = open_blob(bytes);
  return blob ? "accepted" : blob.error().message;
}

std::string refusal_of(const Rig& rig) {
  return refusal(pack_blob(rig));
}

void put_u64(std::span<std::byte> bytes, std::size_t at, std::uint64_t value) {
  std::memcpy(bytes.data() + at, &value, sizeof value);
}

void expect_same(const Rigid& a, const Rigid& b) {
  EXPECT_EQ(a.rotation.coeffs(), b.rotation.coeffs());
  EXPECT_EQ(a.position, b.position);
}

TEST(Blob, KeepsEveryFieldOfEverySensor) {
  const Rig rig = test::sample_rig();
  const auto bytes = pack_blob(rig);
  const auto blob = open_blob(bytes);
  ASSERT_TRUE(blob) << blob.error().message;
  ASSERT_EQ(blob->rig.sensors.size(), 3U);
  for (std::size_t i = 0; i < 3; ++i) {
    const RigSensor &a = rig.sensors[i], &b = blob->rig.sensors[i];
    EXPECT_EQ(a.name, b.name);
    EXPECT_EQ(a.kind, b.kind);
    EXPECT_EQ(a.camera.width, b.camera.width);
    EXPECT_EQ(a.camera.height, b.camera.height);
    EXPECT_EQ(a.camera.fx, b.camera.fx);
    EXPECT_EQ(a.camera.fy, b.camera.fy);
    EXPECT_EQ(a.camera.cx, b.camera.cx);
    EXPECT_EQ(a.camera.cy, b.camera.cy);
    EXPECT_EQ(a.camera.distortion, b.camera.distortion);
    expect_same(a.X_BS, b.X_BS);
    EXPECT_EQ(a.has_pose, b.has_pose);
    expect_same(a.X_WS, b.X_WS);
    EXPECT_EQ(a.noise.a, b.noise.a);
    EXPECT_EQ(a.noise.b, b.noise.b);
    EXPECT_EQ(a.noise.c, b.noise.c);
    EXPECT_EQ(a.noise.quantisation_per_z2, b.noise.quantisation_per_z2);
    EXPECT_EQ(a.stereo.baseline, b.stereo.baseline);
    EXPECT_EQ(a.stereo.has_lenses(), b.stereo.has_lenses());
    EXPECT_EQ(a.stereo.left.distortion, b.stereo.left.distortion);
    EXPECT_EQ(a.stereo.right.cx, b.stereo.right.cx);
    expect_same(a.stereo.X_LR, b.stereo.X_LR);
    EXPECT_EQ(a.trim_near, b.trim_near);
    EXPECT_EQ(a.trim_far, b.trim_far);
    EXPECT_EQ(a.rate_hz, b.rate_hz);
    EXPECT_EQ(a.depth_scale, b.depth_scale);
    EXPECT_EQ(a.depth_offset, b.depth_offset);
    EXPECT_EQ(a.rms_px, b.rms_px);
    EXPECT_EQ(a.covariance, b.covariance);
  }
}

TEST(Blob, KeepsGeoreferenceAndProvenance) {
  const Rig rig = test::sample_rig();
  const auto bytes = pack_blob(rig);
  const auto blob = open_blob(bytes);
  ASSERT_TRUE(blob) << blob.error().message;
  EXPECT_TRUE(blob->rig.georeference.present);
  EXPECT_EQ(blob->rig.georeference.X_WB.scale, rig.georeference.X_WB.scale);
  EXPECT_EQ(blob->rig.georeference.X_WB.rotation.coeffs(), rig.georeference.X_WB.rotation.coeffs());
  EXPECT_EQ(blob->rig.georeference.X_WB.position, rig.georeference.X_WB.position);
  EXPECT_EQ(blob->rig.georeference.covariance, rig.georeference.covariance);
  EXPECT_EQ(blob->rig.georeference.rms_m, rig.georeference.rms_m);
  EXPECT_EQ(blob->rig.provenance.made_by, rig.provenance.made_by);
  EXPECT_EQ(blob->rig.provenance.created_unix, rig.provenance.created_unix);
  EXPECT_EQ(blob->rig.provenance.note, rig.provenance.note);
}

TEST(Blob, HandsOutRaysWhereTheyLie) {
  const Rig rig = test::sample_rig();
  const auto bytes = pack_blob(rig);
  const auto blob = open_blob(bytes);
  ASSERT_TRUE(blob);
  for (const std::size_t i : {0U, 1U}) {
    const auto expected = make_ray_table(rig.sensors[i].camera);
    const RayTable rays = blob->rays[i];
    ASSERT_EQ(rays.size(), expected.size());
    EXPECT_EQ(std::memcmp(rays.data(), expected.data(), rays.size_bytes()), 0);
    const auto* first = reinterpret_cast<const std::byte*>(rays.data());
    EXPECT_GE(first, bytes.data());
    EXPECT_LE(first + rays.size_bytes(), bytes.data() + bytes.size());
    EXPECT_EQ((first - bytes.data()) % 64, 0);
  }
  EXPECT_TRUE(blob->rays[2].empty()) << "a rectified stereo image needs no table";
}

TEST(Blob, IsTheSameBytesEveryTime) {
  EXPECT_EQ(pack_blob(test::sample_rig()), pack_blob(test::sample_rig()));
}

TEST(Blob, OfAnEmptyRigIsStillABlob) {
  EXPECT_TRUE(open_blob(pack_blob(Rig{})));
}

TEST(Blob, IsRefusedWhenItIsNone) {
  EXPECT_THAT(refusal({}), StartsWith("too short: 0 bytes"));
  std::vector<std::byte> text(4096, std::byte{'x'});
  EXPECT_THAT(refusal(text), StartsWith("not a calibration blob"));
}

TEST(Blob, IsRefusedByNameWhenNewer) {
  auto bytes = pack_blob(test::sample_rig());
  bytes[8] = std::byte{kBlobVersion + 1};
  test::reseal_blob(bytes);
  EXPECT_THAT(refusal(bytes), StartsWith("made by a newer version: format 2"));
  bytes[8] = std::byte{0};
  EXPECT_THAT(refusal(bytes), StartsWith("format 0 was never"));
}

TEST(Blob, NamesTheSectionThatIsDamaged) {
  auto bytes = pack_blob(test::sample_rig());
  const auto blob = open_blob(bytes);
  ASSERT_TRUE(blob);
  const auto at = reinterpret_cast<const std::byte*>(blob->rays[1].data()) - bytes.data();
  bytes[static_cast<std::size_t>(at) + 5] ^= std::byte{1};
  EXPECT_THAT(refusal(bytes), StartsWith("section k1/rays is damaged"));
}

TEST(Blob, IsRefusedWhenCutShortOrAppendedTo) {
  auto bytes = pack_blob(test::sample_rig());
  bytes.push_back(std::byte{0});
  EXPECT_THAT(refusal(bytes), HasSubstr("cut short or appended to"));
  bytes.pop_back();
  bytes.pop_back();
  EXPECT_THAT(refusal(bytes), HasSubstr("cut short or appended to"));
}

TEST(Blob, IsRefusedWhenASectionLiesOutside) {
  const auto good = pack_blob(test::sample_rig());
  constexpr std::size_t kFirstOffset = 64 + 8, kFirstLength = 64 + 16;
  for (const std::uint64_t offset :
       {std::uint64_t{0}, std::uint64_t{64}, std::uint64_t{good.size()}, UINT64_MAX - 63}) {
    auto bytes = good;
    put_u64(bytes, kFirstOffset, offset);
    test::reseal_blob(bytes);
    EXPECT_THAT(refusal(bytes), StartsWith("section 0 lies outside")) << offset;
  }
  for (const std::uint64_t length : {std::uint64_t{good.size()}, UINT64_MAX}) {
    auto bytes = good;
    put_u64(bytes, kFirstLength, length);
    test::reseal_blob(bytes);
    EXPECT_THAT(refusal(bytes), StartsWith("section 0 lies outside")) << length;
  }
}

TEST(Blob, IsRefusedWhenItsSectionsAreTooMany) {
  auto bytes = pack_blob(test::sample_rig());
  const std::uint32_t many = 0xFFFFFFFF;
  std::memcpy(bytes.data() + 12, &many, sizeof many);
  EXPECT_THAT(refusal(bytes), StartsWith("its 4294967295 sections do not fit"));
}

TEST(Blob, NeedsAlignedBytes) {
  auto bytes = pack_blob(test::sample_rig());
  bytes.insert(bytes.begin(), std::byte{0});
  EXPECT_THAT(refusal(std::span(bytes).subspan(1)), HasSubstr("not 4-byte aligned"));
}

struct BadValue {
  const char* what;
  void (*spoil)(Rig&);
  const char* message;
};

class BlobBadValue : public ::testing::TestWithParam<BadValue> {};

TEST_P(BlobBadValue, IsRefusedByName) {
  Rig rig = test::sample_rig();
  GetParam().spoil(rig);
  EXPECT_THAT(refusal_of(rig), StartsWith(GetParam().message));
}

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();

INSTANTIATE_TEST_SUITE_P(
    All, BlobBadValue,
    ::testing::Values(
        BadValue{"fx_nan", [](Rig& r) { r.sensors[0].camera.fx = kNan; }, "k0: fx is nan"},
        BadValue{"cx_inf", [](Rig& r) { r.sensors[0].camera.cx = kInf; }, "k0: cx is inf"},
        BadValue{"no_width", [](Rig& r) { r.sensors[2].camera.width = 0; }, "s0: width is 0"},
        BadValue{"huge",
                 [](Rig& r) { r.sensors[2].camera.width = r.sensors[2].camera.height = 4000; },
                 "s0: width times height is 16000000"},
        BadValue{"k1_nan", [](Rig& r) { r.sensors[1].camera.distortion[4] = kNan; },
                 "k1: a distortion coefficient is nan"},
        BadValue{"rotation", [](Rig& r) { r.sensors[0].X_WS.rotation.w() = 3; },
                 "k0: the norm of X_WS's rotation"},
        BadValue{"position", [](Rig& r) { r.sensors[0].X_WS.position.z() = 2300; },
                 "k0: X_WS's z is 2300"},
        BadValue{"board", [](Rig& r) { r.sensors[0].X_BS.position.x() = kNan; },
                 "k0: X_BS's x is nan"},
        BadValue{"trims", [](Rig& r) { r.sensors[0].trim_near = 6; },
                 "k0: trim_near must be below trim_far"},
        BadValue{"noise", [](Rig& r) { r.sensors[0].noise.b = -0.1; },
                 "k0: its depth noise is not above zero"},
        BadValue{"rate", [](Rig& r) { r.sensors[0].rate_hz = 0; }, "k0: rate_hz is 0"},
        BadValue{"scale", [](Rig& r) { r.sensors[0].depth_scale = 1000; },
                 "k0: depth_scale is 1000"},
        BadValue{"baseline", [](Rig& r) { r.sensors[2].stereo.baseline = 0; }, "s0: baseline is 0"},
        BadValue{"lens", [](Rig& r) { r.sensors[2].stereo.right.fy = kNan; }, "s0: fy is nan"},
        BadValue{"pair", [](Rig& r) { r.sensors[2].stereo.X_LR.position.x() = 5000; },
                 "s0: X_LR's x is 5000"},
        BadValue{"variance", [](Rig& r) { r.sensors[0].covariance(3, 3) = -1; },
                 "k0: its covariance has a negative variance"},
        BadValue{"asymmetric", [](Rig& r) { r.sensors[0].covariance(0, 3) = 0.1; },
                 "k0: its covariance is not symmetric"},
        BadValue{"twins", [](Rig& r) { r.sensors[1].name = "k0"; },
                 "k0: two sensors have this name"},
        BadValue{"nameless", [](Rig& r) { r.sensors[0].name = "a/b"; }, "a/b: a sensor's name"},
        BadValue{"lambda", [](Rig& r) { r.georeference.X_WB.scale = 1000; },
                 "georeference: scale is 1000"},
        BadValue{"created", [](Rig& r) { r.provenance.created_unix = -5; },
                 "provenance: created_unix is -5"}),
    [](const auto& parameter) { return std::string(parameter.param.what); });

TEST(Rig, FindsASensorByName) {
  const Rig rig = test::sample_rig();
  EXPECT_EQ(find_sensor(rig, "s0"), 2);
  EXPECT_EQ(find_sensor(rig, "s"), -1);
}

}  // namespace
}  // namespace wagonsight

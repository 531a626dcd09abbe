#include "iidc/iidc_device.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <span>
#include <thread>

namespace wagonsight {
namespace {

constexpr auto kMode = DC1394_VIDEO_MODE_FORMAT7_0;
// Registers of IIDC 1.31 that libdc1394 wraps only together with a handshake that may never end.
constexpr std::uint64_t kImagePosition = 0x008, kImageSize = 0x00c, kColorCoding = 0x010,
                        kPacketBytes = 0x044, kValueSetting = 0x07c;
constexpr std::uint32_t kSettingPresent = 0x80000000, kSettingPending = 0x40000000,
                        kFormatError = 0x00800000;
constexpr int kHandshakeMax_ms = 100;
constexpr auto kAfterReset = std::chrono::milliseconds(300);
// Point Grey's register for what is put into an image's first pixels (from memory of its manual).
constexpr std::uint32_t kPointGrey = 0x00b09d, kPresent = 0x80000000, kCounterInImage = 0x40;
constexpr std::uint64_t kFrameInfo = 0x12f8;
constexpr int kBitsUsed = 12;
// Near 14 Hz; each leaves room for another, which may be plugged in later.
constexpr int kCamerasOfBus = 2;

constexpr auto kNoGuid =
    "the setting `device` is no GUID of 16 digits; take it from `wagonsight devices`";
constexpr auto kAbsent =
    "no IEEE 1394 camera with this GUID is plugged in; check its power supply and its cable, and "
    "compare with `wagonsight devices`";
constexpr auto kForbidden =
    "the camera may not be opened; give the service's user access to /dev/fw* (udev rule)";
constexpr auto kMalformed =
    "a device on the IEEE 1394 buses describes itself wrongly; unplug devices until this goes away";
constexpr auto kMute = "the stereo camera does not answer; it is being reset";
constexpr auto kOtherFormat =
    "the camera's images have another size than was calibrated, or not 16 bits; check its model "
    "and calibrate it";
constexpr auto kNotTaken = "the camera does not take its image format; it is being reset";
constexpr auto kNotSmall =
    "the camera cannot make its packets small enough for its bus; give it a bus of its own";
constexpr auto kNoTrigger = "the camera cannot be triggered as the settings want; change them";
constexpr auto kCrowded =
    "more than two cameras share this IEEE 1394 bus, so each is slower; spread them over more "
    "cards";

// libdc1394 writes to standard error what is said by trouble() here.
void silence_library() {
  for (const auto level : {DC1394_LOG_ERROR, DC1394_LOG_WARNING, DC1394_LOG_DEBUG})
    dc1394_log_register_handler(level, nullptr, nullptr);
}

}  // namespace

IidcDevice::Trouble IidcDevice::find(const IidcWish& wish, FireNode& node) {
  if (wish.guid == 0) return kNoGuid;
  const FireNodes nodes = find_fire_nodes();
  const FireNode* const found = nodes.find(wish.guid);
  if (found == nullptr) return nodes.some_forbidden ? kForbidden : kAbsent;
  is_plugged_ = true;
  if (nodes.some_malformed) return kMalformed;
  node = *found;
  cameras_on_bus_ = nodes.cameras_on(node.card);
  remark_ = cameras_on_bus_ > kCamerasOfBus ? kCrowded : nullptr;
  return nullptr;
}

IidcDevice::Trouble IidcDevice::open(const IidcWish& wish, Cure cure) {
  close(false);
  is_plugged_ = is_mute_ = false;
  FireNode node;
  if (const Trouble trouble = find(wish, node)) return trouble;
  if (cure == Cure::kBusReset && reset_fire_bus(node)) std::this_thread::sleep_for(kAfterReset);
  silence_library();
  library_ = dc1394_new();
  camera_ = library_ == nullptr ? nullptr : dc1394_camera_new(library_, wish.guid);
  is_mute_ = camera_ == nullptr;
  if (!is_mute_ && cure == Cure::kInitialise) is_mute_ = dc1394_camera_reset(camera_) != 0;
  Trouble trouble = is_mute_ ? kMute : set_up(wish);
  if (trouble == nullptr) trouble = receiver_.start(node.path, plan_.packet_bytes, plan_.units);
  if (trouble == nullptr && (dc1394_video_set_iso_channel(
                                 camera_, static_cast<std::uint32_t>(receiver_.channel())) != 0 ||
                             dc1394_video_set_transmission(camera_, DC1394_ON) != 0))
    trouble = kMute;
  if (trouble == kMute) is_mute_ = true;
  if (trouble != nullptr) close(!is_mute_);
  return trouble;
}

void IidcDevice::close(bool is_answering) {
  if (camera_ != nullptr) {
    if (is_answering) (void)dc1394_video_set_transmission(camera_, DC1394_OFF);
    dc1394_camera_free(camera_);
  }
  receiver_.stop();
  if (library_ != nullptr) dc1394_free(library_);
  camera_ = nullptr;
  library_ = nullptr;
}

IidcDevice::Trouble IidcDevice::set_up(const IidcWish& wish) {
  // It may still send as somebody left it.
  if (dc1394_video_set_transmission(camera_, DC1394_OFF) != 0 ||
      dc1394_video_set_iso_speed(camera_, DC1394_ISO_SPEED_400) != 0 ||
      dc1394_video_set_mode(camera_, kMode) != 0)
    return kMute;
  Trouble trouble = set_format(wish);
  if (trouble == nullptr) trouble = set_packets(wish);
  if (trouble == nullptr) trouble = set_trigger(wish.trigger);
  if (trouble == nullptr) trouble = set_features();
  if (trouble == nullptr) count_images();
  return trouble;
}

IidcDevice::Trouble IidcDevice::set_format(const IidcWish& wish) {
  std::uint32_t width = 0;
  std::uint32_t height = 0;
  dc1394color_codings_t codings{};
  if (dc1394_format7_get_max_image_size(camera_, kMode, &width, &height) != 0 ||
      dc1394_format7_get_color_codings(camera_, kMode, &codings) != 0)
    return kMute;
  const auto w = static_cast<std::uint32_t>(wish.width);
  const auto h = static_cast<std::uint32_t>(wish.height);
  const bool is_above = width == w && height == 2 * h;
  const bool is_beside = width == 2 * w && height == h;
  const std::span<const dc1394color_coding_t> known(codings.codings, codings.num);
  const bool has_16_bits =
      std::find(known.begin(), known.end(), DC1394_COLOR_CODING_MONO16) != known.end();
  if (!(is_above || is_beside) || !has_16_bits) return kOtherFormat;
  const std::uint32_t coding = DC1394_COLOR_CODING_MONO16 - DC1394_COLOR_CODING_MIN;
  if (dc1394_set_format7_register(camera_, kMode, kImagePosition, 0) != 0 ||
      dc1394_set_format7_register(camera_, kMode, kImageSize, width << 16U | height) != 0 ||
      dc1394_set_format7_register(camera_, kMode, kColorCoding, coding << 24U) != 0)
    return kMute;
  shape_ = {wish.width,
            wish.height,
            is_above ? PairLayout::kLeftAboveRight : PairLayout::kLeftBesideRight,
            0,
            0,
            0};
  return take_format();
}

// The handshake of IIDC 1.30, where the camera has it.
IidcDevice::Trouble IidcDevice::take_format() {
  std::uint32_t setting = 0;
  if (dc1394_get_format7_register(camera_, kMode, kValueSetting, &setting) != 0) return kMute;
  if ((setting & kSettingPresent) == 0) return nullptr;
  if (dc1394_set_format7_register(camera_, kMode, kValueSetting, kSettingPending) != 0)
    return kMute;
  for (int waited_ms = 0; waited_ms < kHandshakeMax_ms; ++waited_ms) {
    if (dc1394_get_format7_register(camera_, kMode, kValueSetting, &setting) != 0) return kMute;
    if ((setting & kSettingPending) == 0)
      return (setting & kFormatError) == 0 ? nullptr : kNotTaken;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return kNotTaken;
}

IidcDevice::Trouble IidcDevice::set_packets(const IidcWish& wish) {
  std::uint32_t unit = 0;
  std::uint32_t most = 0;
  std::uint32_t bits = 0;
  if (dc1394_format7_get_packet_parameters(camera_, kMode, &unit, &most) != 0) return kMute;
  PacketWish packets;
  packets.image_bytes = std::int64_t{wish.width} * wish.height * 4;
  packets.cameras_on_bus = std::max(cameras_on_bus_, kCamerasOfBus);
  packets.rate_hz_max = wish.rate_hz_max;
  packets.unit_bytes = static_cast<int>(unit);
  packets.packet_bytes_max = static_cast<int>(most);
  plan_ = plan_packets(packets);
  if (plan_.packet_bytes == 0) return kNotSmall;
  const auto bytes = static_cast<std::uint32_t>(plan_.packet_bytes);
  if (dc1394_set_format7_register(camera_, kMode, kPacketBytes, bytes << 16U) != 0) return kMute;
  if (const Trouble trouble = take_format()) return trouble;
  std::uint32_t taken = 0;
  if (dc1394_format7_get_packet_size(camera_, kMode, &taken) != 0) return kMute;
  if (taken != bytes) return kNotTaken;
  if (dc1394_video_get_data_depth(camera_, &bits) != 0) return kMute;
  shape_.packet_bytes = plan_.packet_bytes;
  shape_.packets = plan_.packets;
  shape_.shift = std::max(0, std::min(16, static_cast<int>(bits)) - kBitsUsed);
  return nullptr;
}

IidcDevice::Trouble IidcDevice::set_trigger(IidcTrigger trigger) {
  std::uint32_t value = 0;
  constexpr std::uint64_t kTriggerInquiry = 0x530;
  if (dc1394_get_control_register(camera_, kTriggerInquiry, &value) != 0) return kMute;
  if ((value & kPresent) == 0) return trigger == IidcTrigger::kFree ? nullptr : kNoTrigger;
  const bool is_on = trigger != IidcTrigger::kFree;
  if (is_on && (dc1394_external_trigger_set_mode(camera_, DC1394_TRIGGER_MODE_0) != 0 ||
                dc1394_external_trigger_set_source(camera_, trigger == IidcTrigger::kSoftware
                                                                ? DC1394_TRIGGER_SOURCE_SOFTWARE
                                                                : DC1394_TRIGGER_SOURCE_0) != 0))
    return kMute;
  return dc1394_external_trigger_set_power(camera_, is_on ? DC1394_ON : DC1394_OFF) != 0 ? kMute
                                                                                         : nullptr;
}

// Shutter and gain in seconds and decibels, held still until set_exposure(). False: not so here.
bool IidcDevice::take_absolute(dc1394feature_t feature, Limits& limits) {
  dc1394bool_t is_present = DC1394_FALSE;
  dc1394bool_t is_absolute = DC1394_FALSE;
  return dc1394_feature_is_present(camera_, feature, &is_present) == 0 && is_present != 0 &&
         dc1394_feature_has_absolute_control(camera_, feature, &is_absolute) == 0 &&
         is_absolute != 0 &&
         dc1394_feature_set_mode(camera_, feature, DC1394_FEATURE_MODE_MANUAL) == 0 &&
         dc1394_feature_set_absolute_control(camera_, feature, DC1394_ON) == 0 &&
         dc1394_feature_get_absolute_boundaries(camera_, feature, &limits.low, &limits.high) == 0 &&
         std::isfinite(limits.low) && std::isfinite(limits.high) && limits.low <= limits.high;
}

IidcDevice::Trouble IidcDevice::set_features() {
  exposure_ = {};
  shutter_s_ = gain_db_ = {};
  has_gain_ = take_absolute(DC1394_FEATURE_GAIN, gain_db_);
  // In other units nobody knows what the camera does: it is left to its own exposure.
  if (!take_absolute(DC1394_FEATURE_SHUTTER, shutter_s_)) {
    shutter_s_ = {};
    return nullptr;
  }
  constexpr Exposure kStart{2000, 0};  // a mean of day and tunnel
  return set_exposure(kStart) ? nullptr : kMute;
}

bool IidcDevice::set_exposure(const Exposure& wanted) {
  if (shutter_s_.high <= 0) return true;
  constexpr float kMicro = 1e-6F;
  const float shutter_s = std::clamp(wanted.shutter_us * kMicro, shutter_s_.low, shutter_s_.high);
  const float gain_db = has_gain_ ? std::clamp(wanted.gain_db, gain_db_.low, gain_db_.high) : 0;
  const Exposure next{shutter_s / kMicro, gain_db};
  if (next.shutter_us == exposure_.shutter_us && next.gain_db == exposure_.gain_db) return true;
  // dc1394_feature_set_absolute_value() says success whatever happened.
  constexpr std::uint64_t kValue = 0x008;
  if (dc1394_set_absolute_register(camera_, DC1394_FEATURE_SHUTTER, kValue,
                                   std::bit_cast<std::uint32_t>(shutter_s)) != 0 ||
      (has_gain_ && dc1394_set_absolute_register(camera_, DC1394_FEATURE_GAIN, kValue,
                                                 std::bit_cast<std::uint32_t>(gain_db)) != 0))
    return false;
  exposure_ = next;
  return true;
}

void IidcDevice::count_images() {
  counts_images_ = false;
  std::uint32_t value = 0;
  if (camera_->vendor_id != kPointGrey ||
      dc1394_get_control_register(camera_, kFrameInfo, &value) != 0 || (value & kPresent) == 0)
    return;
  if (dc1394_set_control_register(camera_, kFrameInfo, kPresent | kCounterInImage) == 0 &&
      dc1394_get_control_register(camera_, kFrameInfo, &value) == 0)
    counts_images_ = (value & kCounterInImage) != 0;
}

}  // namespace wagonsight

#include "kinect_rack.h"

#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <map>
#include <optional>

#include "linux/clocks.h"
#include "linux/files.h"
#include "recording/recording_reader.h"
#include "vhci_ports.h"

namespace wagonsight::device::usbip {
namespace {

constexpr std::uint32_t kPictures = 16;  // until they repeat
constexpr std::uint16_t kRawMax = 1090;  // the last sensible disparity: 10 m and more
constexpr int kSocketBytes = 1 << 20;    // several transfers of 28 kB

// One step up or not, by picture and pixel: a bit each of a number for the pixel.
std::uint16_t flickered(std::uint16_t raw, std::uint32_t pixel, std::uint32_t picture) {
  if (raw == KinectUnit::kNoReading) return raw;
  const std::uint32_t mixed = (pixel * 0x9E3779B1U) ^ (pixel >> 7U) * 0x85EBCA6BU;
  return static_cast<std::uint16_t>(raw + ((mixed >> (8 + picture % kPictures)) & 1U));
}

// The disparity of each depth in millimetres, as nearly as there is one.
std::vector<std::uint16_t> raw_by_millimetres(const KinectUnit& unit) {
  std::vector<std::uint16_t> nearest(65'536, KinectUnit::kNoReading);
  std::uint16_t raw = 0;
  for (unsigned depth = 400; depth < 9'000; ++depth) {
    while (raw < kRawMax && unit.millimetres(raw) < depth) ++raw;
    nearest[depth] = raw;
  }
  return nearest;
}

struct OpenRecording {
  MappedFile file;
  std::unique_ptr<RecordingReader> reader;
  std::vector<std::byte> bytes;
};
Result<OpenRecording> open_recording(const std::string& path) {
  auto file = MappedFile::open(path, MappedFile::Pages::kOnDemand);
  if (!file) return tl::unexpected(file.error());
  OpenRecording recording{std::move(*file), nullptr, {}};
  auto reader = RecordingReader::open(recording.file.bytes(), DamagePolicy::kStop);
  if (!reader) return fail(path + ": " + reader.error().message);
  recording.reader = std::move(*reader);
  recording.bytes.resize(recording.reader->slot_bytes());
  return recording;
}

}  // namespace

std::string rack_serial(std::size_t index) {
  return "A0044444444" + std::to_string(index) + "A";
}

Result<std::unique_ptr<KinectRack>> KinectRack::open(const std::string& stills) {
  auto recording = open_recording(stills);
  if (!recording) return tl::unexpected(recording.error());
  std::map<std::uint8_t, std::vector<std::uint16_t>> images;
  for (;;) {
    FrameSlot slot;
    slot.bytes = recording->bytes;
    const auto came = recording->reader->next(slot);
    if (!came) return fail(stills + ": " + came.error().message);
    if (!*came) break;
    const auto pixels = slot.depth_pixels();
    if (pixels.size() == KinectUnit::kPixels)
      images.try_emplace(slot.sensor_index, pixels.begin(), pixels.end());
  }
  const auto& sensors = recording->reader->rig().sensors;
  if (images.size() != sensors.size())
    return fail(stills + ": does not show a depth image of each Kinect");
  std::unique_ptr<KinectRack> rack(new KinectRack);
  rack->kinects_.reserve(sensors.size());
  for (const auto& [index, image] : images)
    rack->add(std::string(sensors[index].name.view()), image);
  return rack;
}

void KinectRack::add(const std::string& name, std::span<const std::uint16_t> still_mm) {
  const std::size_t index = kinects_.size();
  Kinect& kinect = kinects_.emplace_back();
  kinect.name = name;
  kinect.serial = rack_serial(index);
  kinect.still.resize(KinectUnit::kPixels);
  KinectUnit::Options options;
  options.serial = kinect.serial;
  options.drift_ppm = 20.0 * static_cast<double>(index) - 30.0;
  options.phase = static_cast<Nanoseconds>(index) * 7'300'000;
  options.first_ticks = 0xF0000000U + static_cast<std::uint32_t>(index) * 0x01234567U;
  options.optics.shift = static_cast<std::uint16_t>(198 + index);  // no two are the same
  options.repeats_after = kPictures;
  options.feed = [&still = kinect.still](std::uint32_t number, Nanoseconds /*light*/,
                                         std::span<std::uint16_t> raw) {
    for (std::uint32_t i = 0; i < raw.size(); ++i) raw[i] = flickered(still[i], i, number);
  };
  kinect.unit = std::make_unique<KinectUnit>(options);
  const auto nearest = raw_by_millimetres(*kinect.unit);
  for (std::size_t i = 0; i < still_mm.size(); ++i) kinect.still[i] = nearest[still_mm[i]];
  for (std::uint16_t raw = 0; raw < 2048; ++raw)
    kinect.millimetres.push_back(kinect.unit->millimetres(raw));
}

Result<void> KinectRack::plug(std::size_t index) {
  Kinect& kinect = kinects_[index];
  std::array<int, 2> ends{};
  if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends.data()) != 0)
    return fail("usbip: no pair of sockets can be had");
  setsockopt(ends[0], SOL_SOCKET, SO_SNDBUF, &kSocketBytes, sizeof kSocketBytes);
  kinect.line = std::make_unique<UsbipLine>(*kinect.unit, mutex_, ends[0]);
  const auto port = plug_into_kernel(static_cast<int>(index), ends[1], kinect.port);
  close(ends[1]);
  if (!port) return tl::unexpected(port.error());
  kinect.port = *port;
  return {};
}

void KinectRack::spoil(std::size_t index, const std::function<void(KinectFaults&)>& change) {
  const std::lock_guard hold(mutex_);
  change(kinects_[index].unit->faults);
}

KinectRack::Sent KinectRack::sent(std::size_t index) {
  const std::lock_guard hold(mutex_);
  const auto& frames = kinects_[index].unit->sent();
  Sent sent;
  for (std::size_t i = 0; i + 1 < frames.size(); ++i) {
    ++(frames[i].whole ? sent.whole : sent.torn);
    // A frame of which not even the first packet was fetched. A pause in the stream is none.
    const std::uint32_t step = frames[i + 1].number - frames[i].number;
    if (step > 1 && step < 15) sent.torn += step - 1;
  }
  return sent;
}

void KinectRack::Comparison::add(const Comparison& other) {
  frames += other.frames;
  pixels += other.pixels;
  wrong_pixels += other.wrong_pixels;
  missing += other.missing;
}

Result<KinectRack::Comparison> KinectRack::compare(const std::string& path) {
  auto recording = open_recording(path);
  if (!recording) return tl::unexpected(recording.error());
  const auto& sensors = recording->reader->rig().sensors;
  Comparison all;
  std::map<std::size_t, std::uint32_t> last;  // number of a Kinect's frame before
  for (;;) {
    FrameSlot slot;
    slot.bytes = recording->bytes;
    const auto came = recording->reader->next(slot);
    if (!came) return fail(path + ": " + came.error().message);
    if (!*came) return all;
    if (slot.damaged) continue;
    const std::string_view name = sensors[slot.sensor_index].name.view();
    const auto kinect = std::find_if(kinects_.begin(), kinects_.end(),
                                     [&](const Kinect& k) { return k.name == name; });
    if (kinect == kinects_.end()) return fail(path + ": shows a sensor that nobody plugged in");
    const Nanoseconds now = host_now().time_since_epoch().count();
    const std::uint32_t number = kinect->unit->frame_of_ticks(slot.device_ticks, now);
    const auto index = static_cast<std::size_t>(kinect - kinects_.begin());
    if (const auto before = last.find(index); before != last.end())
      all.missing += number - before->second - 1;
    last[index] = number;
    ++all.frames;
    const auto pixels = slot.depth_pixels();
    all.pixels += pixels.size();
    for (std::uint32_t i = 0; i < pixels.size(); ++i) {
      const std::uint16_t raw = flickered(kinect->still[i], i, number);
      all.wrong_pixels += pixels[i] == kinect->millimetres[raw] ? 0U : 1U;
    }
  }
}

}  // namespace wagonsight::device::usbip

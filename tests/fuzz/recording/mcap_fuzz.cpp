#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <vector>

#include "recording/recording_reader.h"
#include "recording/recording_writer.h"

// A recording from anywhere: refused with a sentence, or read to its end without a byte out of
// place. Three ways in: the input as a file; a good recording with edits; a sound file whose
// messages were edited before they were packed.
namespace {

using namespace wagonsight;  // NOLINT(google-build-using-namespace): one short target

constexpr int kWidth = 8;
constexpr int kHeight = 6;

void require(bool holds) {
  if (!holds) std::abort();
}

Rig tiny_rig() {
  Rig rig;
  RigSensor sensor;
  sensor.name = "k0";
  sensor.camera = {.width = kWidth, .height = kHeight, .fx = 8, .fy = 8, .cx = 4, .cy = 3};
  rig.sensors.push_back(sensor);
  sensor.name = "s0";
  sensor.kind = SensorKind::kStereo;
  sensor.stereo.baseline = 0.2;
  rig.sensors.push_back(sensor);
  return rig;
}

std::vector<std::byte> good_recording() {
  MemorySink sink;
  RecordingOptions options;
  options.mcap.chunk_bytes = 1024;
  auto writer = RecordingWriter::create(sink, tiny_rig(), options);
  std::vector<std::byte> memory(std::size_t{kWidth} * kHeight * 2);
  FrameSlot slot;
  slot.bytes = memory;
  slot.width = kWidth;
  slot.height = kHeight;
  for (std::uint32_t i = 0; i < 8; ++i) {
    slot.sensor_index = static_cast<std::uint8_t>(i % 2);
    slot.format = i % 2 == 0 ? PixelFormat::kDepth16 : PixelFormat::kGray8;
    slot.sequence = i;
    slot.instant = slot.arrival = HostTime{Duration{i * 1'000'000}};
    std::fill(memory.begin(), memory.end(), static_cast<std::byte>(i * 37));
    require((*writer)->write(slot).has_value());
  }
  require((*writer)->finish().has_value());
  return {sink.bytes().begin(), sink.bytes().end()};
}

void read_all(std::span<const std::byte> bytes) {
  for (const DamagePolicy policy : {DamagePolicy::kSkip, DamagePolicy::kStop}) {
    auto reader = RecordingReader::open(bytes, policy);
    if (!reader) return require(!reader.error().message.empty());
    require(!(*reader)->rig().sensors.empty());
    std::vector<std::byte> memory((*reader)->slot_bytes());
    FrameSlot slot;
    slot.bytes = memory;
    while (true) {
      const auto more = (*reader)->next(slot);
      if (!more) {
        require(!more.error().message.empty());
        continue;  // goes on behind what was wrong
      }
      if (!*more) break;
      require(slot.sensor_index < (*reader)->rig().sensors.size());
      require(slot.image_bytes() <= slot.bytes.size());
    }
  }
}

// Three bytes an edit: where (16 bit) and what.
void edit(std::span<std::byte> bytes, const std::uint8_t* data, std::size_t size) {
  for (std::size_t i = 0; i + 3 <= size && !bytes.empty(); i += 3)
    bytes[(data[i] * 256U + data[i + 1]) % bytes.size()] = std::byte(data[i + 2]);
}

// The same schemas, channels and messages, the messages edited, in a file whose sums are right.
std::vector<std::byte> rewritten(std::span<const std::byte> good, bool with_blob,
                                 const std::uint8_t* data, std::size_t size) {
  const auto reader = McapReader::open(good);
  MemorySink sink;
  auto writer = McapWriter::create(sink, {});
  if (with_blob) {
    const auto blob = reader->find_attachment(kRigAttachment);
    require((*writer)->add_attachment(**blob).has_value());
  }
  for (const McapSchema& schema : reader->schemas())
    require((*writer)->add_schema(schema.name, schema.encoding, schema.data).has_value());
  for (const McapChannel& channel : reader->channels())
    require((*writer)
                ->add_channel(channel.schema_id, channel.topic, channel.message_encoding,
                              channel.metadata)
                .has_value());
  McapCursor cursor(*reader, DamagePolicy::kStop);
  McapMessage message;
  for (std::size_t number = 0; *cursor.next(message); ++number) {
    std::vector<std::byte> body(message.data.begin(), message.data.end());
    const std::size_t from = std::min(size, number * 3);
    if (number % 4 == size % 4) edit(body, data + from, std::min<std::size_t>(size - from, 9));
    (*writer)->add_message(message, {body});
  }
  require((*writer)->finish().has_value());
  return {sink.bytes().begin(), sink.bytes().end()};
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto input = std::as_bytes(std::span(data, size));
  const std::vector<std::byte> raw(input.begin(), input.end());  // ends where its memory ends
  read_all(raw);

  static const std::vector<std::byte> good = good_recording();
  std::vector<std::byte> edited = good;
  edit(edited, data, size);
  read_all(edited);
  // Without the summary's sum, a summary that lies is believed to begin with.
  const std::size_t crc_at = edited.size() - kMcapMagic.size() - sizeof(std::uint32_t);
  std::fill_n(edited.begin() + static_cast<std::ptrdiff_t>(crc_at), sizeof(std::uint32_t),
              std::byte{0});
  read_all(edited);

  read_all(rewritten(good, true, data, size));
  read_all(rewritten(good, false, data, size));
  return 0;
}

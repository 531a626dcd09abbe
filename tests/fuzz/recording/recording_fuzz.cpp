#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <vector>

#include "recording/recording_reader.h"
#include "recording/ros_messages.h"
#include "unit/recording/synthetic_recording.h"

// A recording from anywhere: refused with a sentence, or frames that fit the slots the reader asked
// for. Four ways in: the input as a file; as one message; a good recording with edits; a sound file
// whose messages were edited before they were packed.
namespace {

using namespace wagonsight;  // NOLINT(google-build-using-namespace): one short target

void require(bool holds) {
  if (!holds) std::abort();
}

// More frames than any edit of the small recording can leave; a reader that goes in circles shows.
constexpr int kReadsMax = 1000;
constexpr std::size_t kSlotBytesMax = std::size_t{64} << 20;

void read_all(std::span<const std::byte> file, DamagePolicy policy) {
  const auto reader = RecordingReader::open(file, policy);
  if (!reader) return require(!reader.error().message.empty());
  const std::size_t slot_bytes = (*reader)->slot_bytes();
  if (slot_bytes > kSlotBytesMax) return;  // an honest header of a large image
  std::vector<std::byte> memory(slot_bytes);
  FrameSlot slot;
  slot.bytes = memory;
  int reads = 0;
  while (true) {
    const auto more = (*reader)->next(slot);
    require(++reads < kReadsMax);
    if (!more) {
      require(!more.error().message.empty());
      continue;
    }
    if (!*more) break;
    require(slot.sensor_index < (*reader)->rig().sensors.size());
    require(slot.image_bytes() <= memory.size());
  }
}

// The messages by themselves, which sums protect inside a recording.
void decode(std::span<const std::byte> bytes) {
  if (const auto image = decode_image(bytes)) {
    require(image->data.data() >= bytes.data());
    require(image->data.data() + image->data.size() <= bytes.data() + bytes.size());
  }
  (void)decode_camera_info(bytes);
  (void)decode_frame_info(bytes);
}

// Four bytes an edit: where (24 bit) and what.
void edit(std::span<std::byte> bytes, const std::uint8_t* data, std::size_t size) {
  for (std::size_t i = 0; i + 4 <= size && !bytes.empty(); i += 4)
    bytes[(data[i] * 65536U + data[i + 1] * 256U + data[i + 2]) % bytes.size()] =
        std::byte(data[i + 3]);
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
    const std::size_t from = std::min(size, number * 4);
    if (number % 4 == size % 4) edit(body, data + from, std::min<std::size_t>(size - from, 12));
    (*writer)->add_message(message, {body});
  }
  require((*writer)->finish().has_value());
  return {sink.bytes().begin(), sink.bytes().end()};
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto input = std::as_bytes(std::span(data, size));
  const std::vector<std::byte> raw(input.begin(), input.end());  // ends where its memory ends
  read_all(raw, DamagePolicy::kSkip);
  decode(raw);
  if (size == 0) return 0;

  // The first byte may cut the file short.
  static const std::vector<std::byte> good = wagonsight::testing::record(6, {.chunk_bytes = 4096});
  std::vector<std::byte> edited(
      good.begin(),
      good.end() - static_cast<std::ptrdiff_t>(data[0] < 64 ? good.size() * data[0] / 64 : 0));
  edit(edited, data + 1, size - 1);
  read_all(edited, DamagePolicy::kSkip);
  read_all(edited, DamagePolicy::kStop);
  // Without the summary's sum, a summary that lies is believed to begin with.
  if (edited.size() == good.size()) {
    const std::size_t crc_at = edited.size() - kMcapMagic.size() - sizeof(std::uint32_t);
    std::fill_n(edited.begin() + static_cast<std::ptrdiff_t>(crc_at), sizeof(std::uint32_t),
                std::byte{0});
    read_all(edited, DamagePolicy::kSkip);
  }
  for (const bool with_blob : {true, false}) {
    const auto sound = rewritten(good, with_blob, data, size);
    read_all(sound, DamagePolicy::kSkip);
    read_all(sound, DamagePolicy::kStop);
  }
  return 0;
}

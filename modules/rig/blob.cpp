#include "rig/blob.h"

#include <fmt/format.h>
#include <sodium/crypto_hash_sha256.h>

#include <algorithm>

#include "base/crc32c.h"
#include "rig/blob_sections.h"

namespace wagonsight {
namespace {

constexpr std::array<char, 8> kMagic{'W', 'S', 'R', 'I', 'G', '\r', '\n', '\x1a'};
constexpr std::size_t kHeaderBytes = 64;
constexpr std::size_t kEntryBytes = 32;
constexpr std::size_t kDigestBytes = crypto_hash_sha256_BYTES;
constexpr std::size_t kAlignment = 64;
// A sensor's own, its rays' or lenses' and its stamp delay's section each, the georeference and the
// provenance, and room for kinds that come later.
constexpr std::size_t kSectionsMax = 4 * kSensorsMax;
constexpr std::uint16_t kNoSensor = 0xFFFF;

enum class SectionKind : std::uint16_t {
  kProvenance = 1,
  kGeoreference,
  kSensor,
  kRays,
  kLenses,
  kStampDelay,
};

struct Section {
  SectionKind kind{};
  std::uint16_t sensor_index = kNoSensor;
  std::uint32_t crc = 0;
  std::uint64_t offset = 0;
  std::uint64_t length = 0;
};

using SectionTable = FixedVector<Section, kSectionsMax>;
using SensorNames = std::array<Name, kSensorsMax>;  // empty where not known yet

std::size_t aligned(std::size_t bytes) {
  return (bytes + kAlignment - 1) / kAlignment * kAlignment;
}

std::span<const std::byte> slice(std::span<const std::byte> bytes, const Section& section) {
  return bytes.subspan(section.offset, section.length);
}

std::array<std::uint8_t, kDigestBytes> digest_of(std::span<const std::byte> bytes) {
  std::array<std::uint8_t, kDigestBytes> digest{};
  crypto_hash_sha256(digest.data(), reinterpret_cast<const unsigned char*>(bytes.data()),
                     bytes.size());
  return digest;
}

// For messages: "k0/rays" once the sensor is known, "sensor 0/rays" before that.
std::string describe(const Section& section, const SensorNames& names) {
  std::string what;
  switch (section.kind) {
    case SectionKind::kProvenance:
      return "provenance";
    case SectionKind::kGeoreference:
      return "georeference";
    case SectionKind::kSensor:
      what = "description";
      break;
    case SectionKind::kRays:
      what = "rays";
      break;
    case SectionKind::kLenses:
      what = "lenses";
      break;
    case SectionKind::kStampDelay:
      what = "stamp delay";
      break;
    default:
      return fmt::format("of kind {}", static_cast<int>(section.kind));
  }
  if (section.sensor_index < names.size() && !names[section.sensor_index].empty())
    return fmt::format("{}/{}", names[section.sensor_index].view(), what);
  return fmt::format("sensor {}/{}", section.sensor_index, what);
}

// ---- writing

class BlobWriter {
 public:
  explicit BlobWriter(std::size_t section_count)
      : body_offset_(aligned(kHeaderBytes + section_count * kEntryBytes)) {}

  // Appends one aligned section of what `write` puts into a ByteWriter.
  template <class Write>
  void add(SectionKind kind, std::uint16_t sensor_index, Write write) {
    body_.pad_to(aligned(body_.size()));
    const std::size_t start = body_.size();
    write(body_);
    const auto bytes = body_.bytes().subspan(start);
    sections_.push_back({kind, sensor_index, crc32c(bytes), body_offset_ + start, bytes.size()});
  }

  std::vector<std::byte> finish() {
    body_.pad_to(aligned(body_.size()));
    ByteWriter out;
    out.put_bytes(std::as_bytes(std::span(kMagic)));
    out.put(kBlobVersion);
    out.put(std::uint16_t{0});
    out.put(static_cast<std::uint32_t>(sections_.size()));
    out.put(std::uint64_t{body_offset_ + body_.size() + kDigestBytes});
    out.pad_to(kHeaderBytes);
    for (const Section& section : sections_) {
      out.put(static_cast<std::uint16_t>(section.kind));
      out.put(section.sensor_index);
      out.put(section.crc);
      out.put(section.offset);
      out.put(section.length);
      out.pad_to(out.size() + kEntryBytes - 24);
    }
    out.pad_to(body_offset_);
    out.put_bytes(body_.bytes());
    const auto digest = digest_of(out.bytes());
    out.put_bytes(std::as_bytes(std::span(digest)));
    return out.take();
  }

 private:
  std::size_t body_offset_;
  SectionTable sections_;
  ByteWriter body_;
};

// ---- reading

Result<std::uint32_t> read_header(std::span<const std::byte> bytes) {
  if (bytes.size() < kHeaderBytes + kDigestBytes)
    return fail(fmt::format("too short: {} bytes, but a calibration blob has at least {}",
                            bytes.size(), kHeaderBytes + kDigestBytes));
  const auto magic = std::as_bytes(std::span(kMagic));
  if (!std::equal(magic.begin(), magic.end(), bytes.begin()))
    return fail("not a calibration blob: it does not begin with WSRIG");
  ByteReader reader(bytes.subspan(kMagic.size()));
  const auto version = reader.get<std::uint16_t>();
  if (version > kBlobVersion)
    return fail(
        fmt::format("made by a newer version: format {}, and this program reads {}; "
                    "update wagonsight or pack the calibration again",
                    version, kBlobVersion));
  if (version != kBlobVersion) return fail(fmt::format("format {} was never in use", version));
  reader.get<std::uint16_t>();
  const auto section_count = reader.get<std::uint32_t>();
  const auto total_bytes = reader.get<std::uint64_t>();
  if (total_bytes != bytes.size())
    return fail(fmt::format("it has {} bytes, but says that it has {}: cut short or appended to",
                            bytes.size(), total_bytes));
  if (section_count > kSectionsMax ||
      kHeaderBytes + section_count * kEntryBytes + kDigestBytes > bytes.size())
    return fail(fmt::format("its {} sections do not fit", section_count));
  return section_count;
}

// Every section lies inside, aligned, after the table and before the digest. Sums are not checked.
Result<SectionTable> read_table(std::span<const std::byte> bytes, std::uint32_t section_count) {
  SectionTable table;
  const std::uint64_t first = kHeaderBytes + section_count * kEntryBytes;
  const std::uint64_t end = bytes.size() - kDigestBytes;
  ByteReader reader(bytes.subspan(kHeaderBytes));
  for (std::uint32_t i = 0; i < section_count; ++i) {
    Section section;
    section.kind = static_cast<SectionKind>(reader.get<std::uint16_t>());
    section.sensor_index = reader.get<std::uint16_t>();
    section.crc = reader.get<std::uint32_t>();
    section.offset = reader.get<std::uint64_t>();
    section.length = reader.get<std::uint64_t>();
    reader.get_bytes(kEntryBytes - 24);
    if (section.offset < first || section.offset > end || section.length > end - section.offset)
      return fail(fmt::format("section {} lies outside of the blob", i));
    if (section.offset % kAlignment != 0)
      return fail(fmt::format("section {} begins at {}, which is not a multiple of {}", i,
                              section.offset, kAlignment));
    table.push_back(section);
  }
  return table;
}

// The sections' own sums say where the damage is, by the sensor's name as soon as its description
// was found whole.
Result<void> check_sums(std::span<const std::byte> bytes, const SectionTable& table) {
  SensorNames names;
  for (const Section& section : table) {
    if (crc32c(slice(bytes, section)) != section.crc)
      return fail(fmt::format("section {} is damaged: its checksum does not match",
                              describe(section, names)));
    RigSensor sensor;
    if (section.kind == SectionKind::kSensor && section.sensor_index < names.size() &&
        read_section(slice(bytes, section), sensor) && is_sensor_name(sensor.name))
      names[section.sensor_index] = sensor.name;
  }
  return {};
}

// The number of sensors is the number of their descriptions, which are numbered from 0.
Result<std::size_t> count_sensors(const SectionTable& table) {
  std::array<bool, kSensorsMax> seen{};
  std::size_t count = 0;
  for (const Section& section : table) {
    if (section.kind != SectionKind::kSensor) continue;
    if (section.sensor_index >= kSensorsMax)
      return fail(
          fmt::format("sensor {}: a rig has at most {}", section.sensor_index, kSensorsMax));
    if (seen[section.sensor_index])
      return fail(fmt::format("sensor {} is described twice", section.sensor_index));
    seen[section.sensor_index] = true;
    ++count;
  }
  for (std::size_t i = 0; i < count; ++i)
    if (!seen[i]) return fail(fmt::format("sensor {} of {} is not described", i, count));
  return count;
}

SensorNames names_of(const Rig& rig) {
  SensorNames names;
  for (std::size_t i = 0; i < rig.sensors.size(); ++i) names[i] = rig.sensors[i].name;
  return names;
}

Result<void> read_descriptions(std::span<const std::byte> bytes, const SectionTable& table,
                               Rig& rig) {
  std::array<int, 2> seen{};
  for (const Section& section : table) {
    bool good = true;
    if (section.kind == SectionKind::kSensor) {
      good = read_section(slice(bytes, section), rig.sensors[section.sensor_index]);
    } else if (section.kind == SectionKind::kGeoreference) {
      good = read_section(slice(bytes, section), rig.georeference) && ++seen[0] == 1;
    } else if (section.kind == SectionKind::kProvenance) {
      good = read_section(slice(bytes, section), rig.provenance) && ++seen[1] == 1;
    }
    if (!good)
      return fail(
          fmt::format("section {} is not what it says it is", describe(section, names_of(rig))));
  }
  return {};
}

// After read_descriptions(): the sensors they belong to are there.
Result<void> read_lenses(std::span<const std::byte> bytes, const SectionTable& table, Rig& rig) {
  for (const Section& section : table) {
    if (section.kind != SectionKind::kLenses) continue;
    const std::string what = describe(section, names_of(rig));
    if (section.sensor_index >= rig.sensors.size())
      return fail(fmt::format("section {} belongs to no sensor", what));
    StereoGeometry& lenses = rig.sensors[section.sensor_index].stereo;
    if (lenses.has_lenses()) return fail(fmt::format("section {} is there twice", what));
    if (!read_section(slice(bytes, section), lenses) || !lenses.has_lenses())
      return fail(fmt::format("section {} is not what it says it is", what));
  }
  return {};
}

// After read_descriptions(), too. Blobs of before have none: their delays are zero.
Result<void> read_stamp_delays(std::span<const std::byte> bytes, const SectionTable& table,
                               Rig& rig) {
  for (const Section& section : table) {
    if (section.kind != SectionKind::kStampDelay) continue;
    const std::string what = describe(section, names_of(rig));
    if (section.sensor_index >= rig.sensors.size())
      return fail(fmt::format("section {} belongs to no sensor", what));
    StampDelay& delay = rig.sensors[section.sensor_index].stamp_delay;
    if (delay.is_known()) return fail(fmt::format("section {} is there twice", what));
    if (!read_section(slice(bytes, section), delay) || !delay.is_known())
      return fail(fmt::format("section {} is not what it says it is", what));
  }
  return {};
}

// After check_rig(): image sizes are sane here.
Result<void> find_rays(std::span<const std::byte> bytes, const SectionTable& table, RigBlob& blob) {
  for (const Section& section : table) {
    if (section.kind != SectionKind::kRays) continue;
    const std::string what = describe(section, names_of(blob.rig));
    if (section.sensor_index >= blob.rig.sensors.size())
      return fail(fmt::format("section {} belongs to no sensor", what));
    RayTable& rays = blob.rays[section.sensor_index];
    const Camera& camera = blob.rig.sensors[section.sensor_index].camera;
    const std::size_t pixel_count =
        static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
    if (!rays.empty()) return fail(fmt::format("section {} is there twice", what));
    if (section.length != pixel_count * sizeof(PixelRay))
      return fail(fmt::format("section {} has {} bytes, but {} pixels need {}", what,
                              section.length, pixel_count, pixel_count * sizeof(PixelRay)));
    rays = {reinterpret_cast<const PixelRay*>(bytes.data() + section.offset), pixel_count};
  }
  for (std::size_t i = 0; i < blob.rig.sensors.size(); ++i) {
    const RigSensor& sensor = blob.rig.sensors[i];
    if ((sensor.kind == SensorKind::kKinect) == blob.rays[i].empty())
      return fail(
          fmt::format("{}: a kinect needs rays and a stereo camera has none", sensor.name.view()));
  }
  return {};
}

}  // namespace

std::vector<std::byte> pack_blob(const Rig& rig) {
  const auto needs_rays = [](const RigSensor& s) { return s.kind == SensorKind::kKinect; };
  const auto has_lenses = [](const RigSensor& s) { return s.stereo.has_lenses(); };
  const auto has_delay = [](const RigSensor& s) { return s.stamp_delay.is_known(); };
  const auto extra_sections = std::count_if(rig.sensors.begin(), rig.sensors.end(), needs_rays) +
                              std::count_if(rig.sensors.begin(), rig.sensors.end(), has_lenses) +
                              std::count_if(rig.sensors.begin(), rig.sensors.end(), has_delay);
  BlobWriter blob(2 + rig.sensors.size() + static_cast<std::size_t>(extra_sections));
  blob.add(SectionKind::kProvenance, kNoSensor,
           [&](ByteWriter& out) { write_section(rig.provenance, out); });
  blob.add(SectionKind::kGeoreference, kNoSensor,
           [&](ByteWriter& out) { write_section(rig.georeference, out); });
  const auto sensor_count = static_cast<std::uint16_t>(rig.sensors.size());
  for (std::uint16_t i = 0; i < sensor_count; ++i)
    blob.add(SectionKind::kSensor, i, [&](ByteWriter& out) { write_section(rig.sensors[i], out); });
  for (std::uint16_t i = 0; i < sensor_count; ++i)
    if (has_lenses(rig.sensors[i]))
      blob.add(SectionKind::kLenses, i,
               [&](ByteWriter& out) { write_section(rig.sensors[i].stereo, out); });
  for (std::uint16_t i = 0; i < sensor_count; ++i)
    if (has_delay(rig.sensors[i]))
      blob.add(SectionKind::kStampDelay, i,
               [&](ByteWriter& out) { write_section(rig.sensors[i].stamp_delay, out); });
  for (std::uint16_t i = 0; i < sensor_count; ++i) {
    if (!needs_rays(rig.sensors[i])) continue;
    blob.add(SectionKind::kRays, i, [&](ByteWriter& out) {
      const auto rays = make_ray_table(rig.sensors[i].camera);
      out.put_bytes(std::as_bytes(std::span(rays)));
    });
  }
  return blob.finish();
}

Result<RigBlob> open_blob(std::span<const std::byte> bytes) {
  if (reinterpret_cast<std::uintptr_t>(bytes.data()) % alignof(std::uint32_t) != 0)
    return fail("its bytes are not 4-byte aligned in memory");
  const auto section_count = read_header(bytes);
  if (!section_count) return fail(section_count.error().message);
  const auto table = read_table(bytes, *section_count);
  if (!table) return fail(table.error().message);

  if (auto sums = check_sums(bytes, *table); !sums) return fail(sums.error().message);
  RigBlob blob;
  blob.sha256 = digest_of(bytes.first(bytes.size() - kDigestBytes));
  const auto stated = bytes.last(kDigestBytes);
  if (!std::equal(stated.begin(), stated.end(), std::as_bytes(std::span(blob.sha256)).begin()))
    return fail("damaged outside of its sections: its SHA-256 does not match");

  const auto sensor_count = count_sensors(*table);
  if (!sensor_count) return fail(sensor_count.error().message);
  blob.rig.sensors.resize(*sensor_count);
  if (auto read = read_descriptions(bytes, *table, blob.rig); !read)
    return fail(read.error().message);
  if (auto read = read_lenses(bytes, *table, blob.rig); !read) return fail(read.error().message);
  if (auto read = read_stamp_delays(bytes, *table, blob.rig); !read)
    return fail(read.error().message);
  if (auto checked = check_rig(blob.rig); !checked) return fail(checked.error().message);
  if (auto found = find_rays(bytes, *table, blob); !found) return fail(found.error().message);
  return blob;
}

}  // namespace wagonsight

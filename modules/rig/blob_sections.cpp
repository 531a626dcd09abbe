#include "rig/blob_sections.h"

namespace wagonsight {
namespace {

// Two archives with the same calls: the fields of a structure are listed once, below.
class Saver {
 public:
  explicit Saver(ByteWriter& out) : out_(out) {}

  template <class T>
  void value(const T& v) {
    out_.put(v);
  }
  void flag(const bool& v) { out_.put<std::uint8_t>(v ? 1 : 0); }
  template <std::size_t N>
  void text(const FixedString<N>& v) {
    static_assert(N <= UINT8_MAX);
    out_.put(static_cast<std::uint8_t>(v.view().size()));
    out_.put_bytes(std::as_bytes(std::span(v.view().data(), v.view().size())));
  }

 private:
  ByteWriter& out_;
};

class Loader {
 public:
  explicit Loader(std::span<const std::byte> bytes) : in_(bytes) {}

  template <class T>
  void value(T& v) {
    v = in_.get<T>();
  }
  void flag(bool& v) {
    const auto byte = in_.get<std::uint8_t>();
    well_formed_ = well_formed_ && byte <= 1;
    v = byte == 1;
  }
  template <std::size_t N>
  void text(FixedString<N>& v) {
    const std::size_t size = in_.get<std::uint8_t>();
    const auto bytes = in_.get_bytes(size);
    well_formed_ = well_formed_ && size <= N;
    v.assign({reinterpret_cast<const char*>(bytes.data()), bytes.size()});
  }
  bool complete() const { return well_formed_ && in_.at_end(); }

 private:
  ByteReader in_;
  bool well_formed_ = true;
};

template <class Archive, class Quaternion>
void rotation_fields(Archive& archive, Quaternion& q) {
  archive.value(q.w());
  archive.value(q.x());
  archive.value(q.y());
  archive.value(q.z());
}

template <class Archive, class Matrix>
void matrix_fields(Archive& archive, Matrix& m) {
  for (Eigen::Index row = 0; row < m.rows(); ++row)
    for (Eigen::Index column = 0; column < m.cols(); ++column) archive.value(m(row, column));
}

template <class Archive, class Pose>
void rigid_fields(Archive& archive, Pose& X) {
  rotation_fields(archive, X.rotation);
  matrix_fields(archive, X.position);
}

template <class Archive, class C>
void camera_fields(Archive& archive, C& camera) {
  archive.value(camera.width);
  archive.value(camera.height);
  for (auto* field : {&camera.fx, &camera.fy, &camera.cx, &camera.cy}) archive.value(*field);
  for (auto& k : camera.distortion) archive.value(k);
}

// The order is the format: new fields come with a new kBlobVersion.
template <class Archive, class Sensor>
void sensor_fields(Archive& archive, Sensor& s) {
  archive.text(s.name);
  camera_fields(archive, s.camera);
  rigid_fields(archive, s.X_BS);
  archive.flag(s.has_pose);
  rigid_fields(archive, s.X_WS);
  for (auto* field :
       {&s.noise.a, &s.noise.b, &s.noise.c, &s.noise.quantisation_per_z2, &s.stereo.baseline,
        &s.trim_near, &s.trim_far, &s.rate_hz, &s.depth_scale, &s.depth_offset, &s.rms_px})
    archive.value(*field);
  matrix_fields(archive, s.covariance);
}

template <class Archive, class L>
void lens_fields(Archive& archive, L& lenses) {
  camera_fields(archive, lenses.left);
  camera_fields(archive, lenses.right);
  rigid_fields(archive, lenses.X_LR);
}

template <class Archive, class D>
void delay_fields(Archive& archive, D& delay) {
  archive.value(delay.delay_s);
  archive.value(delay.sigma_s);
}

template <class Archive, class G>
void georeference_fields(Archive& archive, G& g) {
  archive.flag(g.present);
  archive.value(g.X_WB.scale);
  rigid_fields(archive, g.X_WB);
  matrix_fields(archive, g.covariance);
  archive.value(g.rms_m);
}

template <class Archive, class P>
void provenance_fields(Archive& archive, P& p) {
  archive.text(p.made_by);
  archive.value(p.created_unix);
  archive.text(p.note);
}

}  // namespace

void write_section(const RigSensor& sensor, ByteWriter& out) {
  Saver saver(out);
  out.put(static_cast<std::uint8_t>(sensor.kind));
  sensor_fields(saver, sensor);
}

void write_section(const StereoGeometry& lenses, ByteWriter& out) {
  Saver saver(out);
  lens_fields(saver, lenses);
}

void write_section(const StampDelay& delay, ByteWriter& out) {
  Saver saver(out);
  delay_fields(saver, delay);
}

void write_section(const Georeference& georeference, ByteWriter& out) {
  Saver saver(out);
  georeference_fields(saver, georeference);
}

void write_section(const Provenance& provenance, ByteWriter& out) {
  Saver saver(out);
  provenance_fields(saver, provenance);
}

bool read_section(std::span<const std::byte> bytes, RigSensor& sensor) {
  Loader loader(bytes);
  std::uint8_t kind = 0;
  loader.value(kind);
  sensor.kind = static_cast<SensorKind>(kind);
  sensor_fields(loader, sensor);
  return loader.complete() && kind <= static_cast<std::uint8_t>(SensorKind::kStereo);
}

bool read_section(std::span<const std::byte> bytes, StereoGeometry& lenses) {
  Loader loader(bytes);
  lens_fields(loader, lenses);
  return loader.complete();
}

bool read_section(std::span<const std::byte> bytes, StampDelay& delay) {
  Loader loader(bytes);
  delay_fields(loader, delay);
  return loader.complete();
}

bool read_section(std::span<const std::byte> bytes, Georeference& georeference) {
  Loader loader(bytes);
  georeference_fields(loader, georeference);
  return loader.complete();
}

bool read_section(std::span<const std::byte> bytes, Provenance& provenance) {
  Loader loader(bytes);
  provenance_fields(loader, provenance);
  return loader.complete();
}

}  // namespace wagonsight

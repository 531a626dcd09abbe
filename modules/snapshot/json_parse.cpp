#include <fmt/format.h>

#include <cmath>
#include <cstdint>
#include <limits>
#include <nlohmann/json.hpp>
#include <string>

#include "snapshot/json_lines.h"

namespace wagonsight {
namespace {

using json = nlohmann::ordered_json;  // keeps the order of the sensors in skew_ms

// Reads typed values out of one JSON object and keeps the first error, so that the code below
// reads as the list of keys that it is.
class Reader {
 public:
  bool failed() const { return !error_.empty(); }
  const std::string& error() const { return error_; }

  void set_error(const std::string& where, std::string_view what) {
    if (error_.empty()) error_ = fmt::format("{}: {}", where, what);
  }

  // The value of a key; nullptr when absent, which is an error where it is required.
  const json* find(const json& object, const std::string& where, const char* key, bool required) {
    const auto found = object.find(key);
    if (found != object.end()) return &*found;
    if (required) set_error(where + key, "is missing");
    return nullptr;
  }

  void number(const json& value, const std::string& where, double& out) {
    if (!value.is_number()) return set_error(where, "must be a number");
    out = value.get<double>();
  }

  template <std::size_t N>
  void numbers(const json& value, const std::string& where, std::array<double, N>& out) {
    if (!value.is_array() || value.size() != N)
      return set_error(where, fmt::format("must be a list of {} numbers", N));
    for (std::size_t i = 0; i < N; ++i) number(value[i], where, out[i]);
  }

  void id(const json& value, const std::string& where, std::uint32_t& out) {
    if (!value.is_number_integer() || value < 0 ||
        value > std::numeric_limits<std::uint32_t>::max())
      return set_error(where, "must be a whole number of 32 bits, not negative");
    out = value.get<std::uint32_t>();
  }

  bool object(const json& value, const std::string& where) {
    if (value.is_object()) return true;
    set_error(where, "must be an object");
    return false;
  }

  bool list(const json& value, const std::string& where, std::size_t most) {
    if (!value.is_array()) {
      set_error(where, "must be a list");
    } else if (value.size() > most) {
      set_error(where, fmt::format("has {} entries, at most {} fit", value.size(), most));
    } else {
      return true;
    }
    return false;
  }

 private:
  std::string error_;
};

template <class Kind>
void read_kind(Reader& reader, const json& value, const std::string& where, Kind last, Kind& out) {
  if (!value.is_string()) return reader.set_error(where, "must be a text");
  const auto& text = value.get_ref<const std::string&>();
  for (std::uint8_t i = 0; i <= static_cast<std::uint8_t>(last); ++i) {
    if (to_text(static_cast<Kind>(i)) == text) {
      out = static_cast<Kind>(i);
      return;
    }
  }
  reader.set_error(where, fmt::format("\"{}\" is not known", text));
}

void read_box(Reader& reader, const json& value, const std::string& where, Box& box) {
  if (!reader.object(value, where)) return;
  const std::string inside = where + ".";
  if (const json* v = reader.find(value, inside, "center", true))
    reader.numbers(*v, inside + "center", box.center);
  if (const json* v = reader.find(value, inside, "size", true))
    reader.numbers(*v, inside + "size", box.size);
  if (const json* v = reader.find(value, inside, "yaw", false))
    reader.number(*v, inside + "yaw", box.yaw);
}

void read_ellipsoid(Reader& reader, const json& value, const std::string& where, Ellipsoid& out) {
  if (!reader.object(value, where)) return;
  const std::string inside = where + ".";
  if (const json* v = reader.find(value, inside, "center", true))
    reader.numbers(*v, inside + "center", out.center);
  if (const json* v = reader.find(value, inside, "semi_axes", true))
    reader.numbers(*v, inside + "semi_axes", out.semi_axes);
  if (const json* v = reader.find(value, inside, "rotation", false))
    reader.numbers(*v, inside + "rotation", out.rotation);
}

void read_view(Reader& reader, const json& value, const std::string& where, ViewAttributes& view) {
  if (!reader.object(value, where)) return;
  const std::string inside = where + ".";
  if (const json* v = reader.find(value, inside, "sensor_index", true)) {
    std::uint32_t index = 0;
    reader.id(*v, inside + "sensor_index", index);
    if (index >= kSensorsMax)
      reader.set_error(inside + "sensor_index", "is beyond the last sensor");
    view.sensor_index = static_cast<std::uint8_t>(index % kSensorsMax);
  }
  if (const json* v = reader.find(value, inside, "pixels", false))
    reader.id(*v, inside + "pixels", view.pixels);
  std::array<double, 4> box{};
  if (const json* v = reader.find(value, inside, "image_box", false))
    reader.numbers(*v, inside + "image_box", box);
  for (std::size_t i = 0; i < box.size(); ++i) {
    if (!(std::abs(box[i]) <= 65535))
      return reader.set_error(inside + "image_box", "is beyond any image");
    view.image_box[i] = static_cast<int>(box[i]);
  }
  double distance = 0, share = 0;
  if (const json* v = reader.find(value, inside, "distance", false))
    reader.number(*v, inside + "distance", distance);
  if (const json* v = reader.find(value, inside, "visible_share", false))
    reader.number(*v, inside + "visible_share", share);
  view.distance = static_cast<float>(distance);
  view.visible_share = static_cast<float>(share);
}

void read_points(Reader& reader, const json& value, const std::string& inside, Person& person) {
  if (const json* v = reader.find(value, inside, "head", false)) {
    reader.numbers(*v, inside + "head", person.head);
    person.has_head = true;
  }
  if (const json* v = reader.find(value, inside, "shoulders", false)) {
    if (!v->is_array() || v->size() != 2)
      return reader.set_error(inside + "shoulders", "must be a list of two points");
    reader.numbers((*v)[0], inside + "shoulders", person.shoulder_left);
    reader.numbers((*v)[1], inside + "shoulders", person.shoulder_right);
    person.has_shoulders = true;
  }
  if (const json* v = reader.find(value, inside, "views", false)) {
    if (!reader.list(*v, inside + "views", kSensorsMax)) return;
    for (const json& entry : *v) {
      ViewAttributes view;
      read_view(reader, entry, inside + "views", view);
      person.views.push_back(view);
    }
  }
}

void read_person(Reader& reader, const json& value, const std::string& where, Person& person) {
  if (!reader.object(value, where)) return;
  const std::string inside = where + ".";
  if (const json* v = reader.find(value, inside, "id", true))
    reader.id(*v, inside + "id", person.id);
  if (const json* v = reader.find(value, inside, "position", true))
    reader.numbers(*v, inside + "position", person.position);
  if (const json* v = reader.find(value, inside, "height", false))
    reader.number(*v, inside + "height", person.height);
  if (const json* v = reader.find(value, inside, "posture", false))
    read_kind(reader, *v, inside + "posture", Posture::kLying, person.posture);
  if (const json* v = reader.find(value, inside, "velocity", false))
    reader.numbers(*v, inside + "velocity", person.velocity);
  if (const json* v = reader.find(value, inside, "sigma", false))
    reader.numbers(*v, inside + "sigma", person.sigma);
  if (const json* v = reader.find(value, inside, "box", false))
    read_box(reader, *v, inside + "box", person.box);
  if (const json* v = reader.find(value, inside, "ellipsoid", false))
    read_ellipsoid(reader, *v, inside + "ellipsoid", person.ellipsoid);
  read_points(reader, value, inside, person);
  if (const json* v = reader.find(value, inside, "since", false))
    reader.number(*v, inside + "since", person.since);
  if (const json* v = reader.find(value, inside, "last_seen", false))
    reader.number(*v, inside + "last_seen", person.last_seen);
}

void read_event(Reader& reader, const json& value, const std::string& where, Event& event) {
  if (!reader.object(value, where)) return;
  const std::string inside = where + ".";
  if (const json* v = reader.find(value, inside, "kind", true))
    read_kind(reader, *v, inside + "kind", EventKind::kAlighting, event.kind);
  if (const json* v = reader.find(value, inside, "person", false))
    reader.id(*v, inside + "person", event.person);
  if (const json* v = reader.find(value, inside, "since", false))
    reader.number(*v, inside + "since", event.since);
  if (const json* v = reader.find(value, inside, "evidence", false)) {
    if (!v->is_string()) return reader.set_error(inside + "evidence", "must be a text");
    event.evidence.assign(v->get_ref<const std::string&>());
  }
}

void read_skews(Reader& reader, const json& value, PeopleFrame& frame) {
  if (!reader.object(value, "skew_ms")) return;
  if (value.size() > kSensorsMax) return reader.set_error("skew_ms", "has too many sensors");
  for (const auto& [name, number] : value.items()) {
    PeopleFrame::Skew skew;
    skew.sensor.assign(name);
    reader.number(number, "skew_ms." + name, skew.skew_ms);
    frame.skews.push_back(skew);
  }
}

void read_frame(Reader& reader, const json& value, PeopleFrame& frame) {
  if (!reader.object(value, "line")) return;
  if (const json* v = reader.find(value, "", "time", true)) reader.number(*v, "time", frame.time);
  if (const json* v = reader.find(value, "", "people", true);
      v != nullptr && reader.list(*v, "people", kPeopleMax)) {
    for (const json& entry : *v) {
      Person person;
      read_person(reader, entry, fmt::format("people[{}]", frame.people.size()), person);
      frame.people.push_back(person);
    }
  }
  if (const json* v = reader.find(value, "", "events", false);
      v != nullptr && reader.list(*v, "events", kEventsMax)) {
    for (const json& entry : *v) {
      Event event;
      read_event(reader, entry, fmt::format("events[{}]", frame.events.size()), event);
      frame.events.push_back(event);
    }
  }
  if (const json* v = reader.find(value, "", "skew_ms", false)) read_skews(reader, *v, frame);
}

}  // namespace

Result<PeopleFrame> parse_people_line(std::string_view line) {
  const json value = json::parse(line, nullptr, /*allow_exceptions=*/false);
  if (value.is_discarded()) return fail("people line: is not JSON");
  Reader reader;
  PeopleFrame frame;
  read_frame(reader, value, frame);
  if (reader.failed()) return fail("people line: " + reader.error());
  return frame;
}

}  // namespace wagonsight

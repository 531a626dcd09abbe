#include <algorithm>
#include <cmath>
#include <cstdio>

#include "situation/situation.h"

// The events, each with the figures that speak for it. Text is written into place; nothing
// allocates.
namespace wagonsight {
namespace {

template <class... Values>
void tell(PeopleFrame& frame, EventKind kind, std::uint32_t person, double since,
          const char* pattern, Values... values) {
  std::array<char, 161> text{};
  std::snprintf(text.data(), text.size(), pattern, values...);
  // More than kEventsMax events at one instant tell nobody more than the first ones do.
  (void)frame.events.try_push_back({kind, person, since, text.data()});
}

}  // namespace

void Situation::tell_fall(const Person& person, const Story& story, PeopleFrame& frame) const {
  if (!story.fell) return;
  tell(frame, EventKind::kFall, person.id, story.lying_since_s,
       "standing until %.1f s, lying since %.1f s with nothing above %.2f m", story.upright_until_s,
       story.lying_since_s, person.box.center[2] + 0.5 * person.box.size[2]);
}

void Situation::tell_motionless(const Person& person, const Story& story,
                                PeopleFrame& frame) const {
  const bool lying = story.lying_since_s >= 0;
  const double since =
      lying ? std::max(story.rest_since_s, story.lying_since_s) : story.rest_since_s;
  const double limit = lying ? options_.motionless_lying_s : options_.motionless_s;
  if (frame.time - since < limit) return;
  tell(frame, EventKind::kMotionless, person.id, since, "%s within %.2f m of one place for %.0f s",
       lying ? "lying" : "not lying", options_.motionless_m, frame.time - since);
}

void Situation::tell_running(const Person& person, const Story& story, PeopleFrame& frame) const {
  if (story.running_since_s < 0 || frame.time - story.running_since_s < options_.running_s) return;
  tell(frame, EventKind::kRunning, person.id, story.running_since_s,
       "%.1f m/s, faster than %.1f m/s for %.1f s",
       std::hypot(person.velocity[0], person.velocity[1]), options_.running_speed,
       frame.time - story.running_since_s);
}

void Situation::tell_crowding(PeopleFrame& frame) {
  for (std::size_t i = 0; i < occupancy_.zones.size(); ++i) {
    const ZoneOccupancy& zone = occupancy_.zones[i];
    const double density = zone.count / std::max(zone_area_m2_[i], 0.5);
    const bool over =
        (zone.capacity > 0 && zone.count > zone.capacity) || density > options_.crowding_per_m2;
    double& since = crowded_since_s_[i];
    if (!over) since = -1;
    if (over && since < 0) since = frame.time;
    if (!over || frame.time - since < options_.crowding_s) continue;
    tell(frame, EventKind::kCrowding, 0, since, "%u people in zone %.*s (%.1f square metres)",
         zone.count, static_cast<int>(zone.name.view().size()), zone.name.view().data(),
         zone_area_m2_[i]);
  }
}

}  // namespace wagonsight

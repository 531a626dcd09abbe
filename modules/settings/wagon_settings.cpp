#include "settings/wagon_settings.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace wagonsight {
namespace {

using Point = std::array<double, 2>;

constexpr double kCoordinateMax_m = 1000;
// A door's threshold or a zone may lie on or a little behind the wall.
constexpr double kWallTolerance_m = 0.5;

Bounds read_inside(const toml::table& table, Mistakes& mistakes) {
  TableReader reader(table, "wagon", mistakes);
  Bounds inside;
  inside.max = {0, 0, 0};
  const bool sized = reader.has("length") || reader.has("width") || reader.has("height");
  double length = 0, width = 0, height = 0;
  reader.number("length", length, 0.5, 100);
  reader.number("width", width, 0.5, 100);
  reader.number("height", height, 0.5, 20);
  if (sized) {
    for (const char* key : {"length", "width", "height"})
      reader.require(key, "length, width and height come together");
    inside.max = {length, width, height};
  }
  if (const toml::table* box = reader.table("inside")) {
    if (sized) reader.refuse("inside", "give either this or length, width and height");
    TableReader corners(*box, "wagon.inside", mistakes);
    std::array<double, 3> min{}, max{};
    corners.require("min", "the box needs both corners");
    corners.require("max", "the box needs both corners");
    const bool low = corners.numbers("min", min, -kCoordinateMax_m, kCoordinateMax_m);
    const bool high = corners.numbers("max", max, -kCoordinateMax_m, kCoordinateMax_m);
    const bool both = low && high;
    inside.min = {min[0], min[1], min[2]};
    inside.max = {max[0], max[1], max[2]};
    if (both && !((inside.max - inside.min).array() >= 0.5).all())
      corners.refuse("max", "must be at least 0.5 m above min in x, y and z");
    if (both && !(inside.min.z() <= 0 && inside.max.z() > 0))
      corners.refuse("min", "the floor, z = 0, must be inside");
    corners.finish();
  } else if (!sized) {
    reader.require("length", "a wagon needs length, width and height, or inside");
  }
  reader.finish();
  return inside;
}

double cross(const Point& o, const Point& a, const Point& b) {
  return (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]);
}

bool cross_each_other(const Point& a, const Point& b, const Point& c, const Point& d) {
  return (cross(a, b, c) > 0) != (cross(a, b, d) > 0) &&
         (cross(c, d, a) > 0) != (cross(c, d, b) > 0);
}

bool is_simple(const std::vector<Point>& polygon) {
  const std::size_t n = polygon.size();
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = i + 2; j < n; ++j) {
      if (i == 0 && j == n - 1) continue;  // neighbours
      if (cross_each_other(polygon[i], polygon[i + 1], polygon[j], polygon[(j + 1) % n]))
        return false;
    }
  }
  return true;
}

double area_of(const std::vector<Point>& polygon) {
  double twice = 0;
  for (std::size_t i = 0; i < polygon.size(); ++i)
    twice += cross({0, 0}, polygon[i], polygon[(i + 1) % polygon.size()]);
  return std::abs(twice) / 2;
}

// Reads the lists of named things that stand in a wagon.
class Furnisher {
 public:
  Furnisher(TableReader& root, Mistakes& mistakes, Wagon& wagon)
      : root_(root), mistakes_(mistakes), wagon_(wagon) {}

  void read() {
    read_list("zone", wagon_.zones, [this](TableReader& r, Zone& zone) { read_zone(r, zone); });
    read_list("seat", wagon_.seats, [this](TableReader& r, Seat& seat) { read_seat(r, seat); });
    read_list("door", wagon_.doors, [this](TableReader& r, Door& door) { read_door(r, door); });
    // A window and a screen are masks by another name, as in a scene.
    for (const char* key : {"mask", "window", "screen"})
      read_list(key, wagon_.masks, [](TableReader& r, MaskVolume& mask) { read_mask(r, mask); });
  }

 private:
  template <class Item, std::size_t N, class Read>
  void read_list(const char* key, FixedVector<Item, N>& items, Read read_item) {
    int number = 0;
    for (const toml::table* table : root_.tables(key)) {
      TableReader reader(*table, fmt::format("{} {}", key, ++number), mistakes_);
      Item item;
      std::string name;
      reader.require("name", "it is told by its name");
      if (reader.text("name", name, Name::capacity())) item.name.assign(name);
      const auto same_name = [&](const Item& other) { return other.name == name; };
      if (!name.empty() && std::any_of(items.begin(), items.end(), same_name))
        reader.refuse("name", fmt::format("another {} has this name", key));
      read_item(reader, item);
      reader.finish();
      if (!items.try_push_back(item)) {
        reader.refuse("name", fmt::format("there can be at most {} of these", N));
        return;
      }
    }
  }

  bool is_inside(const Point& p) const {
    const Bounds& inside = wagon_.inside;
    return p[0] >= inside.min.x() - kWallTolerance_m && p[0] <= inside.max.x() + kWallTolerance_m &&
           p[1] >= inside.min.y() - kWallTolerance_m && p[1] <= inside.max.y() + kWallTolerance_m;
  }
  void require_inside(TableReader& reader, const char* key, const Point& p) {
    const Bounds& inside = wagon_.inside;
    if (!is_inside(p))
      reader.refuse(key,
                    fmt::format("must lie in the wagon, x from {:g} to {:g}, y from {:g} to "
                                "{:g}",
                                inside.min.x(), inside.max.x(), inside.min.y(), inside.max.y()));
  }

  void read_zone(TableReader& reader, Zone& zone) {
    reader.require("polygon", "a zone is its corners on the floor");
    std::vector<Point> polygon;
    if (reader.points("polygon", polygon, -kCoordinateMax_m, kCoordinateMax_m)) {
      if (polygon.size() < 3 || polygon.size() > kZoneCornersMax)
        reader.refuse("polygon", fmt::format("must have 3 to {} corners", kZoneCornersMax));
      else if (!is_simple(polygon) || !(area_of(polygon) > 1e-4))
        reader.refuse("polygon", "its sides cross each other or enclose nothing");
      else if (const auto bad = std::find_if_not(polygon.begin(), polygon.end(),
                                                 [this](const Point& p) { return is_inside(p); });
               bad != polygon.end())
        require_inside(reader, "polygon", *bad);
      else
        for (const Point& corner : polygon) zone.polygon.push_back(corner);
    }
    std::int64_t capacity = 0;
    if (reader.integer("capacity", capacity, 1, 1000)) zone.capacity = static_cast<int>(capacity);
  }

  void read_seat(TableReader& reader, Seat& seat) {
    reader.require("position", "a seat stands somewhere");
    if (reader.numbers("position", seat.position, -kCoordinateMax_m, kCoordinateMax_m))
      require_inside(reader, "position", seat.position);
    double yaw_deg = 0;
    reader.number("yaw", yaw_deg, -360, 360);
    seat.yaw = yaw_deg * std::numbers::pi / 180;
    reader.number("width", seat.width, 0.2, 3);
  }

  void read_door(TableReader& reader, Door& door) {
    for (const auto& [key, end] : {std::pair{"from", &door.from}, std::pair{"to", &door.to}}) {
      reader.require(key, "a door is its threshold, from and to");
      if (reader.numbers(key, *end, -kCoordinateMax_m, kCoordinateMax_m))
        require_inside(reader, key, *end);
    }
    if (reader.has("from") && reader.has("to") && door.from == door.to)
      reader.refuse("to", "must differ from where the threshold begins");
  }

  static void read_mask(TableReader& reader, MaskVolume& mask) {
    std::array<double, 3> min{}, max{};
    reader.require("min", "a mask is a box, min and max");
    reader.require("max", "a mask is a box, min and max");
    const bool low = reader.numbers("min", min, -kCoordinateMax_m, kCoordinateMax_m);
    const bool high = reader.numbers("max", max, -kCoordinateMax_m, kCoordinateMax_m);
    const bool both = low && high;
    mask.bounds = {{min[0], min[1], min[2]}, {max[0], max[1], max[2]}};
    if (both && !(mask.bounds.min.array() <= mask.bounds.max.array()).all())
      reader.refuse("max", "must not be below min in x, y or z");
  }

  TableReader& root_;
  Mistakes& mistakes_;
  Wagon& wagon_;
};

}  // namespace

std::optional<Wagon> read_wagon(TableReader& root, Mistakes& mistakes) {
  Wagon wagon;
  const toml::table* table = root.table("wagon");
  if (table != nullptr) wagon.inside = read_inside(*table, mistakes);
  const bool sized = table != nullptr && (wagon.inside.max - wagon.inside.min).minCoeff() > 0;
  if (!sized) {
    // Without the wagon nothing can be said of where things are in it; their form is still judged.
    wagon.inside.min.setConstant(-kCoordinateMax_m);
    wagon.inside.max.setConstant(kCoordinateMax_m);
  }
  Furnisher(root, mistakes, wagon).read();
  if (table != nullptr) return wagon;
  for (const char* key : {"zone", "seat", "door", "mask", "window", "screen"})
    if (root.has(key)) root.refuse_secret(key, "needs a [wagon] that it stands in");
  return std::nullopt;
}

}  // namespace wagonsight

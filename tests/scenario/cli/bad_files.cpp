#include "bad_files.h"

#include <string>

#include "program.h"
#include "support/blob_reseal.h"

namespace wagonsight::testing {
namespace {

// A valid 8-bit grey PNG of one pixel.
constexpr unsigned char kGreyPng8[] = {
    0x89, 'P',  'N',  'G',  '\r', '\n', 0x1a, '\n', 0,    0,    0,    13,   'I',  'H',
    'D',  'R',  0,    0,    0,    1,    0,    0,    0,    1,    8,    0,    0,    0,
    0,    0x3a, 0x7e, 0x9b, 0x55, 0,    0,    0,    10,   'I',  'D',  'A',  'T',  0x78,
    0x9c, 0x63, 0x60, 0,    0,    0,    2,    0,    1,    0x48, 0xaf, 0xa4, 0x71, 0,
    0,    0,    0,    'I',  'E',  'N',  'D',  0xae, 0x42, 0x60, 0x82};

std::string flipped(std::string bytes, std::size_t at) {
  bytes[at] = static_cast<char>(bytes[at] ^ 0x20);
  return bytes;
}

void write_recordings(const fs::path& folder) {
  const std::string whole = read_text(folder / "sim.mcap");
  write_text(folder / "empty.mcap", "");
  write_text(folder / "text.mcap", "hello, this is no recording at all");
  write_text(folder / "newer.mcap", "\x89MCAP1\r\n rest");
  write_text(folder / "cut.mcap", std::string_view(whole).substr(0, 40));
  write_text(folder / "damaged.mcap", flipped(whole, whole.size() * 7 / 8));
  write_text(folder / "wrong.background", "not a background");
  fs::create_directories(folder / "nothing_in_it");
}

void write_images(const fs::path& folder) {
  write_text(folder / "png8/1.png", {reinterpret_cast<const char*>(kGreyPng8), sizeof kGreyPng8});
  write_text(folder / "gif/1.png", "GIF89a and so on");
  write_text(folder / "pgm8/1.pgm", "P5\n640 480\n255\n");
  write_text(folder / "small/1.pgm", "P5\n2 1\n65535\nabcd");
  write_text(folder / "short/1.pgm", "P5\n640 480\n65535\nabcd");
  write_text(folder / "mixed/1.pgm", "P5\n2 1\n65535\nabcd");
  write_text(folder / "mixed/2.png", "");
  write_text(folder / "flat/1.pcd",
             "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 1\n"
             "POINTS 2\nDATA ascii\n1 1 1\n2 2 2\n");
  std::string dark = "P5\n640 480\n65535\n";
  dark.append(std::size_t{640} * 480 * 2, '\0');
  write_text(folder / "dark/1.pgm", dark);
}

void write_cameras(const fs::path& folder) {
  const std::string good(kCamera);
  write_text(folder / "camera.toml", good);
  write_text(folder / "typo.toml", good + "focal = 580\n");
  write_text(folder / "no_fx.toml", "name = \"k0\"\nwidth = 640\nheight = 480\n");
  write_text(folder / "negative.toml",
             "name = \"k0\"\nwidth = -640\nheight = 480\nfx = 1e3\nfy = 1e3\ncx = 320\ncy = 240\n");
  write_text(folder / "no_toml.toml", "name = \n");
  write_text(folder / "trim.toml", good + "trim_m = [4, 2]\n");
  write_text(folder / "unit.toml", good + "depth_unit_m = 1000\n");
  write_text(folder / "lens.toml", good + "distortion = [0.1, 0.2]\n");
  write_text(folder / "rotation.toml",
             good + "[pose]\nposition = [0, 0, 2]\nrotation = [90, 0, 0, 0]\n");
}

void write_blobs(const fs::path& folder) {
  const std::string good = read_text(folder / "rig.blob");
  write_text(folder / "damaged.blob", flipped(good, good.size() / 2));
  write_text(folder / "cut.blob", std::string_view(good).substr(0, good.size() / 2));
  std::string newer = good;
  newer[8] = 9;  // its format's version
  test::reseal_blob(std::as_writable_bytes(std::span(newer.data(), newer.size())));
  write_text(folder / "newer.blob", newer);
  write_text(folder / "text.blob", "no blob");
}

void write_settings(const fs::path& folder) {
  const std::string demo = "[demo]\nscene = \"scene.toml\"\n";
  const std::string recorded =
      "[[sensor]]\nname = \"k0\"\nkind = \"kinect\"\nsource = \"recording\"\nfile = ";
  write_text(folder / "three_mistakes.toml",
             "[web]\nport = 70000\n[pipeline]\nleaf_m = 2\nleef_m = 0.02\n");
  write_text(folder / "short_token.toml", demo + "[web.tokens]\nread = \"geheim\"\n");
  write_text(folder / "open_door.toml", demo + "[web]\nhost = \"everywhere\"\n");
  write_text(folder / "zone.toml",
             "[wagon]\nlength = 6\nwidth = 2.7\nheight = 2.4\n[[zone]]\nname = \"z\"\n"
             "polygon = [[0, 0], [1, 1], [1, 0], [0, 1]]\n");
  write_text(folder / "no_sensor.toml", "[unit]\nname = \"w\"\n");
  write_text(folder / "no_recording.toml", recorded + "\"gone.mcap\"\n");
  write_text(folder / "bad_recording.toml", recorded + "\"text.mcap\"\n");
  write_text(folder / "no_room.toml", recorded + "\"sim.mcap\"\n");
  write_text(folder / "no_pose.toml",
             recorded + "\"poseless.mcap\"\n[wagon]\nlength = 6\nwidth = 2.7\nheight = 2.4\n");
  write_text(folder / "no_floor.toml", recorded + "\"dark.mcap\"\n");
  write_text(folder / "bad_blob.toml", recorded + "\"sim.mcap\"\n[rig]\nblob = \"damaged.blob\"\n");
  write_text(folder / "bad_scene.toml", "[demo]\nscene = \"no_people.toml\"\n");
  std::string other = recorded + "\"sim.mcap\"\n[wagon]\nlength = 5\nwidth = 2.7\nheight = 2.4\n";
  other.replace(other.find("k0"), 2, "k7");
  write_text(folder / "other_sensor.toml", other);
}

void write_scenes_and_people(const fs::path& folder) {
  write_text(folder / "blind.toml", "[wagon]\nlength = 5\nwidth = 2.7\nheight = 2.4\n");
  std::string scene(kSmallScene);
  scene.replace(scene.find("\"walk\""), 6, "\"fly\"");
  write_text(folder / "no_people.toml", scene);
  write_text(folder / "people.jsonl", "{\"time\":0.0,\"people\":[],\"events\":[]}\n");
  write_text(folder / "broken.jsonl", "{\"time\":0.0,\"people\":[],\"events\":[]}\nnonsense\n");
  write_text(folder / "backwards.jsonl",
             "{\"time\":1.0,\"people\":[],\"events\":[]}\n"
             "{\"time\":0.5,\"people\":[],\"events\":[]}\n");
  write_text(folder / "no_bundle.zip", "PK no zip");
}

}  // namespace

void write_bad_files(const fs::path& folder) {
  write_recordings(folder);
  write_images(folder);
  write_cameras(folder);
  write_blobs(folder);
  write_settings(folder);
  write_scenes_and_people(folder);
}

}  // namespace wagonsight::testing

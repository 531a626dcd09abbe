#include <gmock/gmock.h>

#include <cstdint>
#include <nlohmann/json.hpp>
#include <span>

#include "program.h"
#include "recording/mcap_format.h"

namespace wagonsight {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;
using testing::read_text;
using testing::write_text;

class UnitTools : public testing::ProgramTest {};

void append(std::string& out, std::uint32_t value, int bytes) {
  for (int i = 0; i < bytes; ++i) out += static_cast<char>(value >> (8 * i) & 0xFFU);
}

// A zip archive of one file, stored.
std::string zip_of(const std::string& name, const std::string& content) {
  const auto crc = mcap_crc32(std::as_bytes(std::span(content.data(), content.size())));
  const auto size = static_cast<std::uint32_t>(content.size());
  std::string common;
  for (const std::uint32_t field : {20U, 0U, 0U, 0U, 33U}) append(common, field, 2);
  for (const std::uint32_t field : {crc, size, size}) append(common, field, 4);
  append(common, static_cast<std::uint32_t>(name.size()), 2);
  append(common, 0, 2);
  const std::string file = "PK\x03\x04" + common + name + content;
  std::string directory = "PK\x01\x02";
  append(directory, 20, 2);
  directory += common;
  append(directory, 0, 2);
  append(directory, 0, 4);
  append(directory, 0, 4);
  append(directory, 0, 4);
  directory += name;
  std::string end = "PK\x05\x06";
  append(end, 0, 4);
  append(end, 1, 2);
  append(end, 1, 2);
  append(end, static_cast<std::uint32_t>(directory.size()), 4);
  append(end, static_cast<std::uint32_t>(file.size()), 4);
  append(end, 0, 2);
  return file + directory + end;
}

constexpr const char* kHealth = R"({"verdict":"degraded","sentence":"One sensor is silent.",
  "faults":[{"id":"sensor_lost","subject":"k2","cause":"k2 has sent nothing for 12 s.",
             "next_action":"Check its plug."}]})";

TEST_F(UnitTools, DiagnoseNamesFaultsAndTheNextAction) {
  write_text(at("bundle.zip"), zip_of("health.json", kHealth));
  const auto told = must_run("diagnose bundle.zip");
  EXPECT_THAT(told.out, HasSubstr("degraded: One sensor is silent."));
  EXPECT_THAT(told.out, HasSubstr("1. sensor_lost (k2): k2 has sent nothing for 12 s."));
  EXPECT_THAT(told.out, HasSubstr("Next: Check its plug."));
  EXPECT_EQ(json::parse(must_run("diagnose --json bundle.zip").out).at("verdict"), "degraded");
}

TEST_F(UnitTools, DiagnoseRefusesWhatIsNoBundle) {
  const std::string good = zip_of("health.json", kHealth);
  write_text(at("other.zip"), zip_of("readme.txt", "hello"));
  write_text(at("cut.zip"), good.substr(0, good.size() - 30));
  std::string bad = good;
  bad[60] = static_cast<char>(bad[60] ^ 1);
  write_text(at("bad.zip"), bad);
  write_text(at("old.zip"), zip_of("health.json", "{}"));
  EXPECT_EQ(run("diagnose other.zip").err,
            "wagonsight diagnose: other.zip has no health.json in it, so it is no diagnostics "
            "bundle\n");
  EXPECT_EQ(run("diagnose cut.zip").err,
            "wagonsight diagnose: cut.zip is not a zip archive, or was cut\n");
  EXPECT_EQ(run("diagnose bad.zip").err,
            "wagonsight diagnose: bad.zip is damaged at health.json\n");
  EXPECT_THAT(run("diagnose old.zip").err, HasSubstr("tells no health"));
  const auto nobody = run("diagnose --port 1");
  EXPECT_EQ(nobody.exit_code, 1);
  EXPECT_THAT(nobody.err, HasSubstr("no wagonsightd answers at 127.0.0.1:1"));
}

TEST_F(UnitTools, DevicesListsKinectsAndFireWireCameras) {
  const auto device = [&](const std::string& where, const std::string& file,
                          const std::string& text) {
    write_text(at("sys/bus/" + where + "/" + file), text + "\n");
  };
  device("usb/devices/1-1.2", "idVendor", "045e");
  device("usb/devices/1-1.2", "idProduct", "02ae");
  device("usb/devices/1-1.2", "serial", "A00362A00955050A");
  device("usb/devices/1-1.2", "speed", "480");
  device("usb/devices/1-1.3", "idVendor", "045e");
  device("usb/devices/1-1.3", "idProduct", "02b0");  // the motor of the same Kinect
  device("usb/devices/2-1", "idVendor", "045e");
  device("usb/devices/2-1", "idProduct", "02bf");
  device("usb/devices/2-1", "serial", "0000000000000000");
  device("usb/devices/2-1", "speed", "12");
  device("firewire/devices/fw1", "units", "0x00a02d:0x000102");
  device("firewire/devices/fw1", "vendor_name", "Point Grey Research");
  device("firewire/devices/fw1", "model_name", "Bumblebee2");
  device("firewire/devices/fw1", "guid", "0x00b09d0100a1b2c3");
  device("firewire/devices/fw2", "units", "0x00609e:0x010483");  // a disk
  const auto told = must_run("devices --sysfs sys");
  EXPECT_THAT(told.out, HasSubstr("id A00362A00955050A, at 1-1.2, 480 Mbit/s\n[[sensor]]\n"
                                  "name = \"k0\"\nkind = \"kinect\"\nsource = \"device\"\n"
                                  "device = \"A00362A00955050A\"\n"));
  // Without a serial number its place must do.
  EXPECT_THAT(told.out, HasSubstr("name = \"k1\"\nkind = \"kinect\"\nsource = \"device\"\n"
                                  "device = \"2-1\"\n"));
  EXPECT_THAT(told.out, HasSubstr("without a serial number, at 2-1, 12 Mbit/s\n# It runs below"));
  EXPECT_THAT(told.out, HasSubstr("Point Grey Research Bumblebee2, id 0x00b09d0100a1b2c3"));
  EXPECT_THAT(told.out, HasSubstr("name = \"s0\"\nkind = \"stereo\"\n"));
  EXPECT_EQ(json::parse(must_run("devices --json --sysfs sys").out).size(), 3U);
  EXPECT_THAT(must_run("devices --sysfs nowhere").out, HasSubstr("No Kinect and no FireWire"));
}

TEST_F(UnitTools, RecordTakesRecordingsAndScenes) {
  write_text(at("scene.toml"), testing::kSmallScene);
  write_text(at("live.toml"), "[demo]\nscene = \"scene.toml\"\nseed = 5\n");
  must_run("record --config live.toml --seconds 0.5 --out live.mcap");
  must_run("simulate --scene scene.toml --seed 5 --seconds 0.5 --out simulated.mcap");
  must_run("replay live.mcap --out a.jsonl");
  must_run("replay simulated.mcap --out b.jsonl");
  EXPECT_EQ(read_text(at("a.jsonl")), read_text(at("b.jsonl")));

  write_text(at("copy.toml"),
             "[[sensor]]\nname = \"k0\"\nkind = \"kinect\"\nsource = \"recording\"\n"
             "file = \"live.mcap\"\n");
  must_run("record --config copy.toml --seconds 0.3 --out copy.mcap");
  const auto live = json::parse(must_run("inspect --json live.mcap").out);
  const auto copy = json::parse(must_run("inspect --json copy.mcap").out);
  EXPECT_LT(copy.at("frames"), live.at("frames"));
  EXPECT_GT(copy.at("frames"), 5);

  write_text(at("wrong.toml"),
             "[[sensor]]\nname = \"k9\"\nkind = \"kinect\"\nsource = \"recording\"\n"
             "file = \"live.mcap\"\n");
  EXPECT_EQ(run("record --config wrong.toml --seconds 1 --out o.mcap").err,
            "wagonsight record: live.mcap has no sensor k9; `wagonsight inspect` tells which it "
            "has\n");
}

TEST_F(UnitTools, AFailedJobLeavesNoHalfAnswer) {
  write_text(at("camera.toml"), testing::kCamera);
  write_text(at("depth/1.pgm"), "P5\n2 1\n65535\nabcd");
  EXPECT_EQ(run("import --depth depth --camera camera.toml --out o.mcap").exit_code, 1);
  EXPECT_FALSE(testing::fs::exists(at("o.mcap")));
}

}  // namespace
}  // namespace wagonsight

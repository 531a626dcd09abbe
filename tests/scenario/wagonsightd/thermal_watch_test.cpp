#include "thermal_watch.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <vector>

#include "linux/temperatures.h"
#include "support/scratch_folder.h"

namespace wagonsight {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::UnorderedElementsAre;

// A folder of zones as the kernel's.
class Thermal : public ScratchFolder {
 protected:
  void heat(int zone, const std::string& type, const std::string& thousandths) const {
    const std::string name = "thermal_zone" + std::to_string(zone);
    put(name + "/type", type + "\n");
    put(name + "/temp", thousandths + "\n");
  }
  ThermalSettings settings() const {
    ThermalSettings settings;
    settings.folder = folder_;
    return settings;
  }
  ThermalWatch watch() {
    return {settings(), [this](Severity, std::string_view text) { said_.emplace_back(text); }};
  }
  std::vector<std::string> said_;
};

TEST_F(Thermal, ZonesAreReadAndTheSenselessLeftOut) {
  heat(0, "acpitz", "27800");
  heat(1, "x86_pkg_temp", "61000");
  heat(2, "off", "-273200");
  heat(3, "broken", "");
  put("cooling_device0/temp", "99000\n");
  put("thermal_zone4/temp", "40000\n");  // without a type
  std::vector<std::pair<std::string, double>> zones;
  read_temperatures(
      folder_, [&](std::string_view zone, double celsius) { zones.emplace_back(zone, celsius); });
  EXPECT_THAT(zones,
              UnorderedElementsAre(std::pair("acpitz", 27.8), std::pair("x86_pkg_temp", 61.0),
                                   std::pair("thermal_zone4", 40.0)));
}

TEST_F(Thermal, BandsHaveHysteresis) {
  const ThermalSettings settings;  // warm from 80, hot from 90, 5 of hysteresis
  std::vector<ThermalBand> bands;
  ThermalBand band = ThermalBand::kNormal;
  for (const double celsius : {79.9, 80.0, 76.0, 75.0, 74.9, 79.0, 91.0, 86.0, 84.9, 76.0, 74.0}) {
    band = next_band(band, celsius, settings);
    bands.push_back(band);
  }
  using enum ThermalBand;
  EXPECT_THAT(bands, ElementsAre(kNormal, kWarm, kWarm, kWarm, kNormal, kNormal, kHot, kHot, kWarm,
                                 kWarm, kNormal));
}

TEST_F(Thermal, TheHottestZoneSetsTheRate) {
  heat(0, "board", "45000");
  heat(1, "cpu", "70000");
  ThermalWatch watch = this->watch();
  EXPECT_TRUE(watch.tick(0));
  EXPECT_EQ(watch.status().zone, "cpu");
  EXPECT_EQ(watch.status().rate_limit_hz, 0);
  heat(0, "board", "82000");
  EXPECT_FALSE(watch.tick(1)) << "not due yet";
  EXPECT_TRUE(watch.tick(2));
  EXPECT_EQ(watch.status().zone, "board");
  EXPECT_EQ(watch.status().band, ThermalBand::kWarm);
  EXPECT_EQ(watch.status().rate_limit_hz, 15);
  heat(1, "cpu", "95000");
  EXPECT_TRUE(watch.tick(4));
  EXPECT_EQ(watch.status().rate_limit_hz, 5);
  heat(0, "board", "60000");
  heat(1, "cpu", "60000");
  EXPECT_TRUE(watch.tick(6));
  EXPECT_EQ(watch.status().rate_limit_hz, 0);
  EXPECT_THAT(said_, ElementsAre(HasSubstr("board has 82 degrees Celsius: at most 15 instants"),
                                 HasSubstr("at most 5"), HasSubstr("every instant")));
}

// Silence of the zones is no reason to speed up a hot computer.
TEST_F(Thermal, ZonesThatFallSilentChangeNothing) {
  heat(0, "cpu", "85000");
  ThermalWatch watch = this->watch();
  watch.tick(0);
  std::filesystem::remove_all(path("thermal_zone0"));
  EXPECT_FALSE(watch.tick(2));
  EXPECT_EQ(watch.status().rate_limit_hz, 15);
}

TEST_F(Thermal, WithoutZonesNothingIsTold) {
  ThermalWatch watch = this->watch();
  EXPECT_FALSE(watch.tick(0));
  EXPECT_FALSE(watch.status().present);
}

}  // namespace
}  // namespace wagonsight

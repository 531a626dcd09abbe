#include "status/metrics.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <regex>
#include <set>
#include <sstream>

#include "sample_status.h"

namespace wagonsight {
namespace {

using testing::HasSubstr;

// A reader of the text format that knows nothing of the writer. Fails on what Prometheus refuses:
// samples before their TYPE, a family twice, labels or values that do not parse, a sample twice.
struct Scrape {
  std::map<std::string, std::string> types;
  std::map<std::string, double> samples;  // by name and labels, as written
};

Scrape scrape(const std::string& text) {
  const std::regex comment(R"(# (HELP|TYPE) ([a-z_:][a-z0-9_:]*) (.+))");
  const std::regex sample(
      R"(([a-z_:][a-z0-9_:]*)(\{([a-z_]+="([^"\\]|\\["\\n])*",?)*\})? (-?[0-9.]+(e[+-]?[0-9]+)?))");
  Scrape out;
  std::set<std::string> helped;
  std::string current;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    std::smatch match;
    if (std::regex_match(line, match, comment)) {
      if (match[1] == "HELP") {
        EXPECT_TRUE(helped.insert(match[2]).second) << "twice: " << line;
      } else {
        EXPECT_TRUE(helped.contains(match[2])) << "no HELP: " << line;
        current = match[2];
        out.types[current] = match[3];
      }
      continue;
    }
    if (!std::regex_match(line, match, sample)) {
      ADD_FAILURE() << "not a sample: " << line;
      continue;
    }
    EXPECT_EQ(match[1], current) << "outside of its family: " << line;
    const std::string key = match[1].str() + match[2].str();
    EXPECT_TRUE(out.samples.emplace(key, std::stod(match[5])).second) << "twice: " << line;
  }
  return out;
}

TEST(Metrics, TellTheTemperatureAndWhatItCosts) {
  const SampleStatus sample;
  sample.snapshot->thermal = {true, 91.5, "cpu", ThermalBand::kHot, 5, 120};
  const Scrape scraped = scrape(metrics_text(sample.input(), assess(sample.input())));
  EXPECT_EQ(scraped.samples.at("wagonsight_temperature_celsius{zone=\"cpu\"}"), 91.5);
  EXPECT_EQ(scraped.samples.at("wagonsight_thermal_band"), 2);
  EXPECT_EQ(scraped.samples.at("wagonsight_thermal_rate_limit_hertz"), 5);
  EXPECT_EQ(scraped.samples.at("wagonsight_framesets_spared_total"), 120);
}

TEST(Metrics, AreWhatPrometheusReads) {
  const SampleStatus sample;
  const Scrape scraped = scrape(metrics_text(sample.input(), assess(sample.input())));
  EXPECT_EQ(scraped.samples.at("wagonsight_people"), 1);
  EXPECT_EQ(scraped.samples.at("wagonsight_framesets_total"), 3000);
  EXPECT_EQ(scraped.samples.at("wagonsight_health_verdict{verdict=\"ok\"}"), 1);
  EXPECT_EQ(scraped.samples.at("wagonsight_sensor_rate_hertz{sensor=\"k1\"}"), 30);
  EXPECT_EQ(scraped.samples.at("wagonsight_seats{state=\"occupied\"}"), 1);
  for (const auto& [name, type] : scraped.types)
    EXPECT_EQ(type == "counter", name.ends_with("_total")) << name;
}

TEST(Metrics, EscapeWhatAPersonWroteAsAName) {
  SampleStatus sample;
  sample.snapshot->occupancy.zones[0].name = "a \"b\" \\ c\nd";
  const std::string text = metrics_text(sample.input(), assess(sample.input()));
  EXPECT_THAT(text, HasSubstr(R"(wagonsight_zone_people{zone="a \"b\" \\ c\nd"} 1)"));
  scrape(text);
}

TEST(Metrics, AreThereBeforeTheFirstSnapshot) {
  const SampleStatus sample;
  StatusInput input = sample.input();
  input.snapshot = nullptr;
  const Scrape scraped = scrape(metrics_text(input, assess(input)));
  EXPECT_EQ(scraped.samples.at("wagonsight_health_verdict{verdict=\"failed\"}"), 1);
  EXPECT_EQ(scraped.samples.count("wagonsight_people"), 0U);
}

}  // namespace
}  // namespace wagonsight

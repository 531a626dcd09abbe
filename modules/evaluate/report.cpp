#include <fmt/format.h>

#include <cmath>
#include <iterator>
#include <nlohmann/json.hpp>

#include "evaluate/evaluate.h"

namespace wagonsight {
namespace {

std::string number(double value, int decimals) {
  return std::isnan(value) ? "-" : fmt::format("{:.{}f}", value, decimals);
}
std::string percent(double share) {
  return std::isnan(share) ? "-" : fmt::format("{:.1f}%", 100 * share);
}
std::string centimetres(double metres) {
  return std::isnan(metres) ? "-" : fmt::format("{:.1f} cm", 100 * metres);
}

nlohmann::ordered_json posture_json(const PostureScores& scores) {
  static constexpr std::array<const char*, kPostureCount> kNames = {"unknown", "standing",
                                                                    "sitting", "lying"};
  nlohmann::ordered_json confusion;
  for (std::size_t truth = 0; truth < kPostureCount; ++truth) {
    for (std::size_t found = 0; found < kPostureCount; ++found) {
      confusion[kNames[truth]][kNames[found]] = scores.confusion[truth][found];
    }
  }
  return {{"compared", scores.compared_count},
          {"agreed_share", scores.agreed_share},
          {"confusion", confusion}};
}

}  // namespace

std::string to_table(const Scores& scores) {
  std::string text;
  const auto line = [&](const char* name, const std::string& value, const std::string& remark) {
    fmt::format_to(std::back_inserter(text), "{:<16}{:>10}   {}\n", name, value, remark);
  };
  const ClearMot& clear = scores.clear;
  const CountScores& count = scores.count;
  line("MOTA", number(clear.mota, 3),
       fmt::format("{} misses, {} false positives, {} identity switches of {}", clear.miss_count,
                   clear.false_positive_count, clear.switch_count, clear.truth_count));
  line("MOTP", centimetres(clear.motp), "mean distance of a match");
  line("IDF1", number(scores.identity.idf1, 3),
       fmt::format("precision {}, recall {}", number(scores.identity.idp, 3),
                   number(scores.identity.idr, 3)));
  line("HOTA", number(scores.hota.hota, 3),
       fmt::format("detection {}, association {}, localisation {}", number(scores.hota.det_a, 3),
                   number(scores.hota.ass_a, 3), number(scores.hota.loc_a, 3)));
  line("tracks", fmt::format("{}", clear.mostly_tracked),
       fmt::format("mostly tracked, {} partly, {} mostly lost, {} fragmentations",
                   clear.partly_tracked, clear.mostly_lost, clear.fragmentation_count));
  line("count exact", percent(count.exact_share),
       fmt::format("off by at most one {}, mean error {}, empty instants with people {} of {}",
                   percent(count.off_by_one_share), number(count.mean_error, 3),
                   count.empty_with_people_count, count.empty_count));
  line("position", centimetres(scores.position.mean_m),
       fmt::format("mean, median {}, 95% within {}, height {}",
                   centimetres(scores.position.median_m), centimetres(scores.position.p95_m),
                   centimetres(scores.position.height_mean_absolute_m)));
  line("posture", percent(scores.posture.agreed_share),
       fmt::format("of {} matches whose posture is known", scores.posture.compared_count));
  line("instants", fmt::format("{}", scores.alignment.truth_count),
       fmt::format("{} answered within half a frame, {} lines of people unused",
                   scores.alignment.answered_count, scores.alignment.unused_count));
  return text;
}

std::string to_json(const Scores& scores) {
  const ClearMot& clear = scores.clear;
  const nlohmann::ordered_json json = {
      {"mota", clear.mota},
      {"motp_m", clear.motp},
      {"truths", clear.truth_count},
      {"matches", clear.match_count},
      {"misses", clear.miss_count},
      {"false_positives", clear.false_positive_count},
      {"identity_switches", clear.switch_count},
      {"fragmentations", clear.fragmentation_count},
      {"mostly_tracked", clear.mostly_tracked},
      {"partly_tracked", clear.partly_tracked},
      {"mostly_lost", clear.mostly_lost},
      {"idf1", scores.identity.idf1},
      {"idp", scores.identity.idp},
      {"idr", scores.identity.idr},
      {"hota", scores.hota.hota},
      {"det_a", scores.hota.det_a},
      {"ass_a", scores.hota.ass_a},
      {"loc_a", scores.hota.loc_a},
      {"count",
       {{"exact_share", scores.count.exact_share},
        {"off_by_one_share", scores.count.off_by_one_share},
        {"mean_error", scores.count.mean_error},
        {"mean_absolute_error", scores.count.mean_absolute_error},
        {"empty_instants", scores.count.empty_count},
        {"empty_instants_with_people", scores.count.empty_with_people_count}}},
      {"position",
       {{"mean_m", scores.position.mean_m},
        {"median_m", scores.position.median_m},
        {"p95_m", scores.position.p95_m},
        {"max_m", scores.position.max_m},
        {"height_mean_absolute_m", scores.position.height_mean_absolute_m}}},
      {"posture", posture_json(scores.posture)},
      {"instants",
       {{"truth", scores.alignment.truth_count},
        {"answered", scores.alignment.answered_count},
        {"unused_lines", scores.alignment.unused_count},
        {"frame_s", scores.alignment.frame_s}}}};
  return json.dump(2) + "\n";
}

}  // namespace wagonsight

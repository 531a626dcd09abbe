#include "vigil.h"

#include <fmt/format.h>

namespace wagonsight {
namespace {

// systemd asks for at least two signs of life within its limit; the shortest limit one sets is
// seconds.
constexpr double kPeriodS = 0.5;

}  // namespace

Vigil::Vigil(const std::string& state_folder) {
  if (state_folder.empty()) return;
  auto record = RunRecord::open(state_folder + "/run-record");
  if (!record) {
    remark_ = record.error().message;
    return;
  }
  record_ = std::make_unique<RunRecord>(std::move(*record));
  record_->note_fatal_signals();
}

const PreviousCrash& Vigil::previous() const {
  static const PreviousCrash kNone;
  return record_ != nullptr ? record_->previous() : kNone;
}

void Vigil::watch(std::string_view name, double silence_max_s, Turns turns, double now_s) {
  stages_.add(name, silence_max_s, now_s);
  turns_.push_back(std::move(turns));
}

void Vigil::ready(std::string_view status) {
  manager_.status(status);
  manager_.ready();
}

void Vigil::tick(double now_s, double unix_time, const Say& say) {
  if (now_s - told_s_ < kPeriodS) return;
  told_s_ = now_s;
  if (record_ != nullptr) record_->alive(unix_time);
  for (std::size_t i = 0; i < turns_.size(); ++i) {
    if (const auto turns = turns_[i]())
      stages_.see(i, *turns, now_s);
    else
      stages_.dismiss(i);
  }
  const std::string* stuck = stages_.stuck(now_s);
  if (stuck == nullptr) manager_.alive();
  if ((stuck != nullptr) == stuck_) return;
  stuck_ = stuck != nullptr;
  const std::string sentence =
      stuck_ ? fmt::format(
                   "{} stands still, so the service manager is no longer told that the unit "
                   "is alive.",
                   *stuck)
             : std::string("Every stage goes on again.");
  manager_.status(sentence);
  say(sentence);
}

void Vigil::ended() {
  manager_.stopping();
  if (record_ != nullptr) record_->ended();
}

void Vigil::failed(const std::string& why) {
  manager_.status(why);
  if (record_ != nullptr) record_->failed(why);
}

}  // namespace wagonsight

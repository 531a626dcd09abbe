#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/result.h"
#include "linux/run_record.h"
#include "linux/service_manager.h"
#include "stage_watch.h"

namespace wagonsight {

// What the daemon tells those who restart it: the service manager hears that it is alive only while
// every stage goes on, and the next run reads how this one ended. Control thread only.
class Vigil {
 public:
  // How often the stage's thread has turned; nullopt: it has ended, as it may.
  using Turns = std::function<std::optional<std::uint64_t>()>;
  using Say = std::function<void(std::string_view)>;

  // `state_folder` empty: no record is kept. Before any thread.
  explicit Vigil(const std::string& state_folder);

  const PreviousCrash& previous() const;
  bool is_crash_loop() const { return record_ != nullptr && record_->is_crash_loop(); }
  // Why there is no record although one was asked for; empty: all is well.
  const std::string& remark() const { return remark_; }

  void watch(std::string_view name, double silence_max_s, Turns turns, double now_s);
  // The page is served from here on.
  void ready(std::string_view status);
  // Many times a second. `say` hears once when a stage has come to stand still, and when it goes
  // on.
  void tick(double now_s, double unix_time, const Say& say);
  // The run ended as it should, or was kept from starting.
  void ended();
  void failed(const std::string& why);

 private:
  ServiceManager manager_;
  std::unique_ptr<RunRecord> record_;
  std::string remark_;
  StageWatch stages_;
  std::vector<Turns> turns_;
  double told_s_ = -1e9;
  bool stuck_ = false;
};

}  // namespace wagonsight

#pragma once

#include <atomic>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <thread>

#include "base/result.h"
#include "slots/bundle_stage.h"
#include "slots/provisioning.h"
#include "slots/unit_places.h"
#include "update/updater_call.h"

// The small process with the rights to change the unit: it takes bundles, which it trusts only by
// their signatures, and puts them where they belong.
namespace wagonsight {

struct UpdaterReply {
  std::uint16_t status = 200;
  std::string json;
  bool restart = false;  // the machine is to be restarted once this is told
};

//   nothing --blocks--> receiving --last block--> installing --> restart_needed --restart-->
//   nothing
//      ^                    | refused                 | failed
//      +--------------------+-------------------------+
class Updater {
 public:
  // The Error: the image's keys cannot be read, or this is no unit.
  static Result<std::unique_ptr<Updater>> open(UnitPlaces places);
  ~Updater();  // waits for an installation
  Updater(const Updater&) = delete;
  Updater& operator=(const Updater&) = delete;

  // Goes on with a bundle that a power cut left uninstalled. In a thread of its own, as every
  // installation.
  void resume();
  // Answers at once. One thread.
  UpdaterReply call(const UpdaterCall& call, std::span<const std::byte> block);
  void wait();  // for the installation, if there is one

  // ---- what the scripts of the image ask for
  // The slot that runs is good: takes its counter and raises the rollback index.
  Result<void> mark_good();
  // The slot that runs has not proved itself, and the other one has: there is a better one to go
  // to.
  Result<bool> is_on_trial() const;
  // Takes the whole bundle from a file, without a stage.
  Result<std::string> take_file(const std::string& path);

  UnitData& unit() { return unit_; }
  const ImageFacts& facts() const { return facts_; }

 private:
  Updater(UnitPlaces places, ImageFacts facts);
  BundleRules rules() const;
  void look_back();
  UpdaterReply take_block(const UpdaterCall& call, std::span<const std::byte> block);
  UpdaterReply refuse(std::uint16_t status, std::string_view sentence) const;
  UpdaterReply tell(std::uint16_t status = 200) const;
  void install_in_background(std::string path);
  Result<std::string> take(const StoredBundle& bundle);
  Result<std::string> install_slot(const StoredBundle& bundle);
  char other_slot() const { return places_.running == 'a' ? 'b' : 'a'; }
  std::string stage_folder() const { return places_.data + "/update"; }

  UnitPlaces places_;
  ImageFacts facts_;
  UnitData unit_;
  std::unique_ptr<BundleStage> stage_;
  std::thread installation_;

  mutable std::mutex mutex_;  // of what follows
  bool is_installing_ = false;
  bool needs_restart_ = false;
  InstallProgress progress_;
  std::string message_;  // the last thing that happened, a sentence
  bool is_bad_news_ = false;
};

}  // namespace wagonsight

#include "slots/updater.h"

#include <fmt/format.h>

#include <cctype>

#include "linux/append_file.h"
#include "linux/files.h"
#include "slots/boot_entries.h"
#include "slots/file_slot.h"
#include "slots/folders.h"
#include "slots/key_lines.h"
#include "slots/run_program.h"

namespace wagonsight {
namespace {

constexpr std::size_t kNoteBytesMax = 4096;

std::string json_text(std::string_view text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') out += '\\';
    out += c >= ' ' && c <= '~' ? c : ' ';
  }
  return out + '"';
}

// As it stands on a page: with a capital letter and a point.
std::string as_sentence(std::string text) {
  if (text.empty()) return text;
  text[0] = static_cast<char>(std::toupper(static_cast<unsigned char>(text[0])));
  if (text.back() != '.') text += '.';
  return text;
}

UnitData::CheckFolder check_with(const std::string& daemon) {
  return [daemon](const std::string& folder) {
    return run_program(
        {daemon, "--config", folder + "/unit.toml", "--check-config", "--check-files"});
  };
}

}  // namespace

Result<std::unique_ptr<Updater>> Updater::open(UnitPlaces places) {
  auto facts = read_image_facts(places.facts);
  if (!facts) return tl::unexpected(facts.error());
  if (places.running == 0) {
    const auto slot = running_slot();
    if (!slot) return tl::unexpected(slot.error());
    places.running = *slot;
  }
  return std::unique_ptr<Updater>(new Updater(std::move(places), std::move(*facts)));
}

Updater::Updater(UnitPlaces places, ImageFacts facts)
    : places_(std::move(places)),
      facts_(std::move(facts)),
      unit_(places_.data, check_with(places_.daemon)),
      stage_(std::make_unique<BundleStage>(stage_folder(), rules())) {
  look_back();
}

Updater::~Updater() {
  wait();
}

BundleRules Updater::rules() const {
  BundleRules rules;
  rules.update_key = facts_.update_key;
  rules.provision_key = facts_.provision_key;
  rules.architecture = facts_.architecture;
  rules.unit = unit_.name();
  rules.update_index = unit_.update_index();
  rules.provision_index = unit_.provision_index();
  return rules;
}

// What became of the last update: the note was written when its slot was listed.
void Updater::look_back() {
  needs_restart_ = !unit_.is_settled();
  const auto note = read_file(stage_folder() + "/installed", kNoteBytesMax);
  if (!note) return;
  const std::string slot = line_value(*note, "slot"), version = line_value(*note, "version");
  if (line_value(*note, "boot") == boot_id()) {
    needs_restart_ = true;
    message_ =
        fmt::format("Version {} is in slot {} and starts with the next restart.", version, slot);
  } else if (slot == std::string(1, places_.running)) {
    message_ = fmt::format("The unit was updated to version {}.", version);
  } else {
    is_bad_news_ = true;
    message_ = fmt::format(
        "Version {} did not become ready and was rolled back; the unit runs "
        "version {} as before.",
        version, facts_.version);
  }
}

void Updater::resume() {
  if (auto path = stage_->bundle_path()) install_in_background(*path);
}

void Updater::wait() {
  if (installation_.joinable()) installation_.join();
}

// ---- what the page asks for

UpdaterReply Updater::call(const UpdaterCall& call, std::span<const std::byte> block) {
  bool is_busy = false;
  {
    const std::lock_guard lock(mutex_);
    is_busy = is_installing_;
  }
  if (is_busy)
    return call.wish == UpdaterWish::kTell
               ? tell()
               : refuse(409, "A bundle is being installed; wait until it is done.");
  wait();  // for the thread's last breath
  switch (call.wish) {
    case UpdaterWish::kBlock:
      return take_block(call, block);
    case UpdaterWish::kDiscard:
      stage_->discard();
      break;
    case UpdaterWish::kRestart: {
      UpdaterReply reply = tell(202);
      reply.restart = true;
      return reply;
    }
    case UpdaterWish::kFactoryReset: {
      if (auto asked = unit_.ask_for_reset(); !asked)
        return refuse(500, as_sentence(asked.error().message));
      const std::lock_guard lock(mutex_);
      needs_restart_ = true;
      message_ = "At the next start everything but the unit's name and calibration is removed.";
      break;
    }
    case UpdaterWish::kTell:
      break;
  }
  return tell(call.wish == UpdaterWish::kTell ? 200 : 202);
}

UpdaterReply Updater::take_block(const UpdaterCall& call, std::span<const std::byte> block) {
  // The rules may have changed since the last bundle.
  if (call.offset == 0) {
    stage_ = std::make_unique<BundleStage>(stage_folder(), rules());
  } else if (call.offset != stage_->received_bytes()) {
    return tell(409);  // tells where to go on
  }
  if (auto taken = stage_->take(call.offset, call.total, block); !taken) {
    const std::string sentence = as_sentence(taken.error().message);
    {
      const std::lock_guard lock(mutex_);
      message_ = sentence;
      is_bad_news_ = true;
    }
    return refuse(422, sentence);
  }
  if (auto path = stage_->bundle_path()) install_in_background(*path);
  return tell(202);
}

UpdaterReply Updater::refuse(std::uint16_t status, std::string_view sentence) const {
  return {status, fmt::format("{{\"error\":{}}}\n", json_text(sentence)), false};
}

UpdaterReply Updater::tell(std::uint16_t status) const {
  const std::lock_guard lock(mutex_);
  const bool is_receiving = stage_->received_bytes() > 0;
  const std::string_view state = is_installing_   ? "installing"
                                 : is_receiving   ? "receiving"
                                 : needs_restart_ ? "restart_needed"
                                                  : "nothing";
  std::string json = fmt::format(
      "{{\"state\":\"{}\",\"message\":{},\"bad_news\":{},\"received_bytes\":{},\"bundle_bytes\":{},"
      "\"signature\":\"{}\",\"chunks_done\":{},\"chunks\":{},",
      state, json_text(message_), is_bad_news_, stage_->received_bytes(), stage_->bundle_bytes(),
      stage_->signature(), progress_.chunks_done, progress_.chunks);
  json += fmt::format(
      "\"version\":{},\"architecture\":{},\"slot\":\"{}\",\"index\":{},\"index_min\":{},\"unit\":{}"
      ","
      "\"takes_bundles\":{}}}\n",
      json_text(facts_.version), json_text(facts_.architecture), places_.running, facts_.index,
      unit_.update_index(), json_text(unit_.name()),
      facts_.update_key.has_value() || facts_.provision_key.has_value());
  return {status, std::move(json), false};
}

// ---- installing

void Updater::install_in_background(std::string path) {
  {
    const std::lock_guard lock(mutex_);
    is_installing_ = true;
    is_bad_news_ = false;
    progress_ = {};
    message_ = "The bundle is being installed.";
  }
  installation_ = std::thread([this, path = std::move(path)] {
    const auto taken = take_file(path);
    // Whatever came of it, it is not tried again by itself.
    (void)remove_tree(path);
    const std::lock_guard lock(mutex_);
    is_installing_ = false;
    is_bad_news_ = !taken;
    needs_restart_ = needs_restart_ || taken.has_value();
    message_ = as_sentence(taken ? *taken : taken.error().message);
  });
}

Result<std::string> Updater::take_file(const std::string& path) {
  const auto bundle = StoredBundle::open(path, rules());
  if (!bundle) return tl::unexpected(bundle.error());
  return take(**bundle);
}

Result<std::string> Updater::take(const StoredBundle& bundle) {
  const Manifest& manifest = bundle.manifest();
  if (manifest.kind == BundleKind::kUpdate) return install_slot(bundle);
  if (auto taken = unit_.take_bundle(manifest, bundle.source()); !taken)
    return tl::unexpected(taken.error());
  return fmt::format("the provisioning {} is taken and counts from the next restart on",
                     manifest.version);
}

Result<std::string> Updater::install_slot(const StoredBundle& bundle) {
  const Manifest& manifest = bundle.manifest();
  auto boot = BootPartition::open(places_.boot);
  if (!boot) return tl::unexpected(boot.error());
  if (!is_slot_good(boot_entries(boot->folder()), places_.running))
    return fail(
        "the version that runs has not proved itself yet, and the other slot is what the unit "
        "would fall back to; wait until it has been ready for two minutes");
  const char letter = other_slot();
  std::string device = letter == 'a' ? places_.root_a : places_.root_b;
  if (device.empty()) {
    auto found = partition_device(fmt::format("root-{}", letter));
    if (!found) return tl::unexpected(found.error());
    device = std::move(*found);
  }
  FileSlot slot(letter, device, boot->folder());
  const auto done = install(manifest, bundle.source(), slot, [this](const InstallProgress& now) {
    const std::lock_guard lock(mutex_);
    progress_ = now;
  });
  if (!done) return tl::unexpected(done.error());
  const std::string note =
      fmt::format("slot {}\nversion {}\nboot {}\n", letter, manifest.version, boot_id());
  if (auto made = make_folders(stage_folder()); !made) return tl::unexpected(made.error());
  if (auto noted = write_file_durably(stage_folder() + "/installed",
                                      std::as_bytes(std::span(note.data(), note.size())));
      !noted)
    return tl::unexpected(noted.error());
  return fmt::format("version {} is in slot {} and starts with the next restart", manifest.version,
                     letter);
}

Result<void> Updater::mark_good() {
  auto boot = BootPartition::open(places_.boot);
  if (!boot) return tl::unexpected(boot.error());
  if (auto marked = mark_slot_good(boot->folder(), places_.running); !marked)
    return tl::unexpected(marked.error());
  // Only now: until then the older version must remain a way back.
  return unit_.raise_update_index(facts_.index);
}

Result<bool> Updater::is_on_trial() const {
  const auto boot = BootPartition::open(places_.boot);
  if (!boot) return tl::unexpected(boot.error());
  const auto entries = boot_entries(boot->folder());
  return !is_slot_good(entries, places_.running) && is_slot_good(entries, other_slot());
}

}  // namespace wagonsight

#include "slots/provisioning.h"

#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>
#include <filesystem>
#include <vector>

#include "linux/append_file.h"
#include "linux/files.h"
#include "slots/folders.h"
#include "slots/key_lines.h"

namespace wagonsight {
namespace {

namespace fs = std::filesystem;
constexpr std::size_t kSmallFileMax = 4096;
constexpr std::size_t kSumsBytesMax = 65'536;
constexpr const char* kSumsName = "SHA256SUMS";

std::span<const std::byte> bytes_of(std::string_view text) {
  return std::as_bytes(std::span(text.data(), text.size()));
}

// The file's text without its last line's end; empty when there is none.
std::string small_text(const std::string& path) {
  auto text = read_file(path, kSmallFileMax);
  if (!text) return {};
  while (!text->empty() && (text->back() == '\n' || text->back() == '\r')) text->pop_back();
  return std::move(*text);
}

std::uint64_t small_number(const std::string& path) {
  return leading_number<std::uint64_t>(small_text(path));
}

Result<void> write_number(const std::string& path, std::uint64_t number) {
  return write_file_durably(path, bytes_of(fmt::format("{}\n", number)));
}

// The calibration blob, the static model that belongs to it, and what they replaced.
bool is_calibration(const fs::path& file) {
  const std::string name = file.filename().string();
  return name.find(".blob") != std::string::npos;
}

Result<void> copy_file(const std::string& from, const std::string& to) {
  const auto file = MappedFile::open(from);
  if (!file) return tl::unexpected(file.error());
  return write_file_durably(to, file->bytes());
}

// The files of a folder by their names, sorted; folders in it are refused.
Result<std::vector<std::string>> files_of(const std::string& folder) {
  std::vector<std::string> names;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error)) {
    const std::string name = entry.path().filename().string();
    if (!entry.is_regular_file() || entry.is_symlink())
      return fail(fmt::format("{}: is no file; provisioning takes files alone", name));
    if (!is_part_name(name))
      return fail(fmt::format("{}: cannot be a file's name in a provisioning", name));
    names.push_back(name);
  }
  if (error) return fail(fmt::format("{}: cannot be read: {}", folder, error.message()));
  std::sort(names.begin(), names.end());
  return names;
}

// Each line "DIGEST  NAME", as sha256sum writes it.
Result<void> check_sums(const std::string& folder) {
  const std::string path = folder + "/" + kSumsName;
  if (!file_exists(path)) return {};
  const auto text = read_file(path, kSumsBytesMax);
  if (!text) return tl::unexpected(text.error());
  for (std::string_view rest = *text; !rest.empty();) {
    const std::string_view line = rest.substr(0, rest.find('\n'));
    rest.remove_prefix(std::min(line.size() + 1, rest.size()));
    Digest wanted{};
    if (line.size() < 67 || !read_hex(line.substr(0, 64), wanted))
      return fail(fmt::format("{}: is no list of digests", kSumsName));
    std::string_view name = line.substr(66);
    if (name.starts_with("./")) name.remove_prefix(2);
    if (!is_part_name(name)) return fail(fmt::format("{}: names no possible file", kSumsName));
    const auto file = MappedFile::open(fmt::format("{}/{}", folder, name));
    if (!file) return tl::unexpected(file.error());
    if (digest_of(file->bytes()) != wanted)
      return fail(fmt::format("{} differs from its digest in {}; copy it again", name, kSumsName));
  }
  return {};
}

bool has_calibration(const std::string& folder) {
  std::error_code none;
  for (const auto& entry : fs::directory_iterator(folder, none))
    if (entry.is_regular_file() && is_calibration(entry.path())) return true;
  return false;
}

Result<void> make_empty_folder(const std::string& folder) {
  if (auto removed = remove_tree(folder); !removed) return removed;
  return make_folders(folder);
}

}  // namespace

UnitData::UnitData(std::string folder, CheckFolder check)
    : folder_(std::move(folder)), check_(std::move(check)) {}

bool UnitData::is_provisioned() const {
  return file_exists(path("unit/unit.toml"));
}
std::string UnitData::name() const {
  return small_text(path("identity/name"));
}
std::uint64_t UnitData::update_index() const {
  return small_number(path("identity/update-index"));
}
std::uint64_t UnitData::provision_index() const {
  // What waits counts, so that the same bundle is not taken twice.
  return std::max(small_number(path("unit/.provision-index")),
                  small_number(path("unit.next/.provision-index")));
}
bool UnitData::is_settled() const {
  return !file_exists(path("unit.next")) && !file_exists(path("reset-asked"));
}

Result<void> UnitData::raise_update_index(std::uint64_t index) {
  if (index <= update_index()) return {};
  if (auto made = make_folders(path("identity")); !made) return made;
  return write_number(path("identity/update-index"), index);
}

Result<void> UnitData::take_folder(const std::string& source, const std::string& name_if_none) {
  if (is_provisioned())
    return fail(
        "this unit is provisioned; from now on it takes only bundles that are signed for it");
  const auto names = files_of(source);
  if (!names) return tl::unexpected(names.error());
  std::string name = small_text(source + "/name");
  if (name.empty()) name = name_if_none;
  if (!is_unit_name(name))
    return fail("the file name does not hold a unit's name: letters, digits and ._- only");
  if (const std::string known = this->name(); !known.empty() && known != name) {
    if (file_exists(source + "/name"))
      return fail(
          fmt::format("this provisioning is for the unit {}, and this one is {}", name, known));
    name = known;
  }
  const std::string prepared = path("unit.new");
  if (auto made = make_empty_folder(prepared); !made) return made;
  for (const std::string& file : *names)
    if (auto copied =
            copy_file(fmt::format("{}/{}", source, file), fmt::format("{}/{}", prepared, file));
        !copied)
      return copied;
  if (auto checked = check_sums(prepared); !checked) return checked;
  if (auto sealed = check_and_seal(prepared); !sealed) return sealed;
  // The name first: with it alone the unit is not provisioned, and it stays the same next time.
  if (auto made = make_folders(path("identity")); !made) return made;
  if (this->name().empty())
    if (auto named = write_file_durably(path("identity/name"), bytes_of(name + "\n")); !named)
      return named;
  if (auto replaced = replace_folder(prepared, path("unit")); !replaced) return replaced;
  return remove_tree(path("calibration"));
}

Result<void> UnitData::take_bundle(const Manifest& manifest, const PartSource& source) {
  const std::string prepared = path("unit.new");
  if (auto made = make_empty_folder(prepared); !made) return made;
  std::vector<std::byte> bytes;
  for (const BundlePart& part : manifest.parts) {
    bytes.resize(part.bytes);
    if (auto given = source(part, 0, bytes); !given) return given;
    if (make_part(part.name, bytes).chunks != part.chunks)
      return fail(fmt::format("{} has decayed on the disk; upload the bundle again", part.name));
    if (auto put = write_file_durably(prepared + "/" + part.name, bytes); !put) return put;
  }
  if (auto noted = write_number(prepared + "/.provision-index", manifest.index); !noted)
    return noted;
  if (auto sealed = check_and_seal(prepared); !sealed) return sealed;
  return replace_folder(prepared, path("unit.next"));
}

// What is taken must be able to run: it is checked where it will be read, and then made durable.
Result<void> UnitData::check_and_seal(const std::string& prepared) {
  if (!file_exists(prepared + "/unit.toml"))
    return fail("there is no unit.toml in it, the unit's settings");
  if (auto kept = keep_calibration(prepared); !kept) return kept;
  if (auto checked = check_(prepared); !checked) return checked;
  chmod(prepared.c_str(), 0755);  // the daemon reads it as another user
  return sync_tree(prepared);
}

// A provisioning without a calibration keeps the one that there is.
Result<void> UnitData::keep_calibration(const std::string& prepared) const {
  if (has_calibration(prepared)) return {};
  for (const char* from : {"unit", "calibration"}) {
    bool found = false;
    std::error_code none;
    for (const auto& entry : fs::directory_iterator(path(from), none)) {
      if (!entry.is_regular_file() || !is_calibration(entry.path())) continue;
      found = true;
      const std::string to = prepared + "/" + entry.path().filename().string();
      if (auto copied = copy_file(entry.path().string(), to); !copied) return copied;
    }
    if (found) return {};
  }
  return {};
}

Result<void> UnitData::settle() {
  if (file_exists(path("reset-asked"))) return reset();
  if (!file_exists(path("unit.next"))) return {};
  if (auto replaced = replace_folder(path("unit.next"), path("unit")); !replaced) return replaced;
  return remove_tree(path("calibration"));
}

Result<void> UnitData::ask_for_reset() {
  return write_file_durably(path("reset-asked"), bytes_of("1\n"));
}

// Each step can be repeated; the wish goes last.
Result<void> UnitData::reset() {
  if (is_provisioned()) {
    const std::string kept = path("calibration.new");
    if (auto made = make_empty_folder(kept); !made) return made;
    if (auto copied = keep_calibration(kept); !copied) return copied;
    if (auto synced = sync_tree(kept); !synced) return synced;
    if (auto replaced = replace_folder(kept, path("calibration")); !replaced) return replaced;
    // In one step, so that nothing is ever copied from a folder that is half removed.
    if (auto gone = replace_folder(path("unit"), path("unit.gone")); !gone) return gone;
  }
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder_, error)) {
    const std::string name = entry.path().filename().string();
    if (name == "identity" || name == "calibration" || name == "lost+found" ||
        name == "reset-asked")
      continue;
    if (auto removed = remove_tree(entry.path().string()); !removed) return removed;
  }
  if (auto synced = sync_folder(folder_); !synced) return synced;
  return remove_tree(path("reset-asked"));
}

}  // namespace wagonsight

#include "update/bundle_check.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/random.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <memory>
#include <vector>

#include "commands.h"
#include "files.h"

namespace wagonsight {
namespace {

struct BundleCommand {
  std::string out, key, folder, file;
  Manifest manifest;
  std::vector<std::string> parts;  // NAME=FILE
};

constexpr std::size_t kKeyBytesMax = 1024;

Result<SigningSeed> read_seed(const std::string& path) {
  const auto text = read_file(path, kKeyBytesMax);
  if (!text) return tl::unexpected(text.error());
  return read_key(*text, path);
}

// Only its owner may read the secret, and no key is ever overwritten.
Result<void> write_secret(const std::string& path, std::string_view text) {
  const int fd = ::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
  if (fd < 0)
    return fail(
        fmt::format("{}: cannot be made: {}; give another --out", path, std::strerror(errno)));
  const bool done =
      ::write(fd, text.data(), text.size()) == static_cast<ssize_t>(text.size()) && fsync(fd) == 0;
  ::close(fd);
  return done ? Result<void>{} : fail(fmt::format("{}: cannot be written", path));
}

Result<void> run_new_key(const BundleCommand& command) {
  SigningSeed seed{};
  if (getrandom(seed.data(), seed.size(), 0) != static_cast<ssize_t>(seed.size()))
    return fail("the system gives no random numbers");
  if (auto done = write_secret(command.out, key_text(seed)); !done) return done;
  const PublicKey key = public_key_of(seed);
  if (auto done = write_file(command.out + ".pub", key_text(key)); !done) return done;
  fmt::print("{}: the secret; keep it off every unit\n{}.pub: key {}, for ./scripts/image --key\n",
             command.out, command.out, hex_text(key_id(key)));
  return {};
}

// Writes the head, then the files one behind the other.
Result<void> write_bundle(const BundleCommand& command,
                          const std::vector<std::pair<std::string, std::string>>& parts) {
  const auto seed = read_seed(command.key);
  if (!seed) return tl::unexpected(seed.error());
  Manifest manifest = command.manifest;
  std::vector<MappedFile> files;
  for (const auto& [name, path] : parts) {
    auto file = open_input(path);
    if (!file) return tl::unexpected(file.error());
    manifest.parts.push_back(make_part(name, file->bytes()));
    files.push_back(std::move(*file));
  }
  // What no unit could read is not written.
  if (auto readable = parse_manifest(manifest_text(manifest)); !readable)
    return fail(fmt::format("such a bundle cannot be: {}", readable.error().message));
  auto out = OutputFile::create(command.out);
  if (!out) return tl::unexpected(out.error());
  auto done = (*out)->write(signed_head(manifest, *seed));
  for (const MappedFile& file : files)
    if (done) done = (*out)->write(file.bytes());
  if (done) done = (*out)->close();
  if (done)
    fmt::print("{}: {} {}, index {}, {} parts, {} bytes, signed with key {}\n", command.out,
               to_text(manifest.kind), manifest.version, manifest.index, manifest.parts.size(),
               manifest.payload_bytes(), hex_text(key_id(public_key_of(*seed))));
  return done;
}

Result<void> run_update(const BundleCommand& command) {
  std::vector<std::pair<std::string, std::string>> parts;
  for (const std::string& part : command.parts) {
    const std::size_t sign = part.find('=');
    if (sign == std::string::npos) return fail(fmt::format("--part {}: must be NAME=FILE", part));
    parts.emplace_back(part.substr(0, sign), part.substr(sign + 1));
  }
  return write_bundle(command, parts);
}

Result<void> run_provision(BundleCommand command) {
  command.manifest.kind = BundleKind::kProvision;
  std::vector<std::pair<std::string, std::string>> parts;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(command.folder, error))
    if (entry.path().filename() != "SHA256SUMS")
      parts.emplace_back(entry.path().filename().string(), entry.path().string());
  if (error) return fail(fmt::format("{}: cannot be read: {}", command.folder, error.message()));
  std::sort(parts.begin(), parts.end());
  const auto is_settings = [](const auto& part) { return part.first == "unit.toml"; };
  if (std::none_of(parts.begin(), parts.end(), is_settings))
    return fail(fmt::format("{}: has no unit.toml, the unit's settings", command.folder));
  return write_bundle(command, parts);
}

// As the unit will, but for what only the unit knows.
Result<void> run_check(const BundleCommand& command) {
  const auto text = read_file(command.key, kKeyBytesMax);
  if (!text) return tl::unexpected(text.error());
  const auto key = read_key(*text, command.key);
  if (!key) return tl::unexpected(key.error());
  const auto file = open_input(command.file);
  if (!file) return tl::unexpected(file.error());
  const auto told = [&](const Result<void>& done) {
    return fail(fmt::format("{}: {}", command.file, done.error().message));
  };
  BundleRules rules;
  rules.update_key = rules.provision_key = *key;
  rules.architecture = command.manifest.architecture;
  rules.unit = command.manifest.unit;
  BundleCheck check(rules, file->bytes().size());
  if (auto done = check.take(file->bytes()); !done) return told(done);
  if (auto done = check.finish(); !done) return told(done);
  fmt::print("{}: {} {}, index {}, is in order\n", command.file, to_text(check.manifest()->kind),
             check.manifest()->version, check.manifest()->index);
  return {};
}

void add_making(CLI::App& command, BundleCommand& options, std::string_view version) {
  command.add_option("--version", options.manifest.version, "What people call it")
      ->required(version.empty());
  command.add_option("--index", options.manifest.index, "Rises with every version")->required();
  command.add_option("--key", options.key, "The secret key to sign with")->required();
  command.add_option("--out", options.out, "The bundle to write")->required();
  options.manifest.version = version;
}

}  // namespace

void add_bundle(CommandLine& line) {
  CLI::App* bundle =
      line.app.add_subcommand("bundle", "Make and check signed bundles: updates and provisioning");
  bundle->require_subcommand(1);
  const auto add = [&](const char* name, const char* what,
                       Result<void> (*work)(const BundleCommand&)) {
    auto options = std::make_shared<BundleCommand>();
    CLI::App* command = bundle->add_subcommand(name, what);
    command->callback(
        [&line, options, work] { line.run = [options, work] { return work(*options); }; });
    return std::pair(command, options);
  };
  const auto [new_key, new_key_options] = add("new-key", "A new pair of keys", run_new_key);
  new_key->add_option("--out", new_key_options->out, "The secret; OUT.pub is the public one")
      ->required();

  const auto [update, u] = add("update", "An update from the parts of an image", run_update);
  add_making(*update, *u, "");
  update->add_option("--architecture", u->manifest.architecture)->required();
  update->add_option("--boot", u->manifest.boot, "The kernel's words, without slot=")->required();
  update->add_option("--part", u->parts, "NAME=FILE: root, kernel, initramfs")->required();

  const auto [provision, p] =
      add("provision", "Settings, calibration and the like for one unit",
          [](const BundleCommand& command) { return run_provision(command); });
  add_making(*provision, *p, "settings");
  provision->add_option("folder", p->folder, "unit.toml and what it names")->required();
  provision->add_option("--unit", p->manifest.unit, "The unit's name")->required();

  const auto [check, c] = add("check", "Hold a bundle against a public key", run_check);
  check->add_option("file", c->file)->required();
  check->add_option("--key", c->key, "The public key")->required();
  check->add_option("--architecture", c->manifest.architecture, "Of the unit");
  check->add_option("--unit", c->manifest.unit, "The unit's name");
}

}  // namespace wagonsight

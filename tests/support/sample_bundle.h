#pragma once

#include <cstddef>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "update/bundle_check.h"

// Bundles for tests, and the unit that takes them.
namespace wagonsight {

inline SigningSeed sample_seed(std::uint8_t number = 1) {
  SigningSeed seed{};
  seed.fill(number);
  return seed;
}

inline std::span<const std::byte> bytes_of(std::string_view text) {
  return std::as_bytes(std::span(text.data(), text.size()));
}

// Text that differs everywhere, so that no chunk is like another.
inline std::string sample_text(std::size_t size, std::uint32_t seed) {
  std::string text(size, '\0');
  for (char& c : text) {
    seed = 1664525U * seed + 1013904223U;
    c = static_cast<char>(seed >> 24U);
  }
  return text;
}

struct SampleBundle {
  Manifest manifest;
  std::vector<std::pair<std::string, std::string>> parts;

  void add(const std::string& name, std::string text) {
    manifest.parts.push_back(make_part(name, bytes_of(text)));
    parts.emplace_back(name, std::move(text));
  }
  const std::string& text(std::string_view name) const {
    for (const auto& [part, content] : parts)
      if (part == name) return content;
    throw std::out_of_range("no such part");
  }
  std::string file(const SigningSeed& seed = sample_seed()) const {
    std::string all = signed_head(manifest, seed);
    for (const auto& [name, content] : parts) all += content;
    return all;
  }
};

inline SampleBundle sample_update(std::size_t root_bytes = 200'000, std::uint32_t seed = 1) {
  SampleBundle bundle;
  bundle.manifest.version = "1.2.3";
  bundle.manifest.index = 10;
  bundle.manifest.architecture = "x86_64";
  bundle.manifest.boot = "console=ttyS0 roothash=12";
  bundle.add("root", sample_text(root_bytes, seed));
  bundle.add("kernel", sample_text(70'000, seed + 1));
  bundle.add("initramfs", sample_text(1000, seed + 2));
  return bundle;
}

inline SampleBundle sample_provisioning(const std::string& unit, std::uint64_t index) {
  SampleBundle bundle;
  bundle.manifest.kind = BundleKind::kProvision;
  bundle.manifest.version = "settings of May";
  bundle.manifest.index = index;
  bundle.manifest.unit = unit;
  bundle.add("unit.toml", "[unit]\nname = \"new\"\n");
  return bundle;
}

inline BundleRules sample_rules() {
  BundleRules rules;
  rules.update_key = rules.provision_key = public_key_of(sample_seed());
  rules.architecture = "x86_64";
  rules.unit = "wagon-1";
  return rules;
}

}  // namespace wagonsight

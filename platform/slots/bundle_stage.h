#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "base/result.h"
#include "slots/slot_install.h"
#include "update/bundle_check.h"

namespace wagonsight {

// A bundle on the data partition, checked, from which it is installed.
class StoredBundle {
 public:
  // Reads and checks all of it.
  static Result<std::unique_ptr<StoredBundle>> open(const std::string& path,
                                                    const BundleRules& rules);
  ~StoredBundle();
  StoredBundle(const StoredBundle&) = delete;
  StoredBundle& operator=(const StoredBundle&) = delete;

  const Manifest& manifest() const { return manifest_; }
  PartSource source() const;  // lives no longer than this

 private:
  StoredBundle(std::string path, int fd) : path_(std::move(path)), fd_(fd) {}
  Result<void> check(const BundleRules& rules);
  std::string path_;
  int fd_;
  Manifest manifest_;
  std::uint64_t payload_start_ = 0;
};

// Where a bundle is collected that comes block by block, checked while it comes. What has come
// survives a power cut and a lost connection: whoever sends asks how much there is and goes on.
// Folder: `incoming` while it comes, `bundle` once it is whole and in order. One thread.
class BundleStage {
 public:
  // Takes up what `folder` holds from before.
  BundleStage(std::string folder, BundleRules rules);
  ~BundleStage();
  BundleStage(const BundleStage&) = delete;
  BundleStage& operator=(const BundleStage&) = delete;

  // `offset` zero begins anew. `total_bytes` is the whole file's size, zero where it is not known.
  // The Error is the refusal, and what had come is gone; but a block that does not begin where the
  // last one ended is refused without harm.
  Result<void> take(std::uint64_t offset, std::uint64_t total_bytes,
                    std::span<const std::byte> bytes);
  void discard();  // all there is, the whole bundle included
  // The whole bundle's file; nothing while there is none.
  std::optional<std::string> bundle_path() const;

  std::uint64_t received_bytes() const;
  std::uint64_t bundle_bytes() const { return check_ ? check_->bundle_bytes() : 0; }
  const Manifest* manifest() const { return check_ ? check_->manifest() : nullptr; }
  // Of the bundle that is coming, so that a sender knows its own again; empty: none.
  const std::string& signature() const { return signature_; }

 private:
  void take_up();
  Result<void> begin(std::uint64_t total_bytes, std::span<const std::byte> first);
  Result<void> keep(std::span<const std::byte> bytes);
  Result<void> complete();
  void close_file();

  std::string folder_, incoming_;
  BundleRules rules_;
  std::optional<BundleCheck> check_;
  int fd_ = -1;
  std::uint64_t unsynced_bytes_ = 0;
  std::string signature_;
};

}  // namespace wagonsight

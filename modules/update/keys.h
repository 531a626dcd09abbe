#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "base/result.h"

// Ed25519 keys and SHA-256 digests, as bundles use them (libsodium).
namespace wagonsight {

using Digest = std::array<std::uint8_t, 32>;
using PublicKey = std::array<std::uint8_t, 32>;
using SigningSeed = std::array<std::uint8_t, 32>;  // the secret; everything follows from it
using Signature = std::array<std::uint8_t, 64>;
using KeyId = std::array<std::uint8_t, 8>;  // the first bytes of the public key's digest

std::string hex_text(std::span<const std::uint8_t> bytes);
// Exactly as many digits as `bytes` takes; false otherwise.
bool read_hex(std::string_view text, std::span<std::uint8_t> bytes);

Digest digest_of(std::span<const std::byte> bytes);
KeyId key_id(const PublicKey& key);
PublicKey public_key_of(const SigningSeed& seed);
Signature sign(std::string_view text, const SigningSeed& seed);
bool is_signed(std::string_view text, const Signature& signature, const PublicKey& key);

// A key file holds 64 hexadecimal digits and a line's end. `file_name` is for the message.
Result<std::array<std::uint8_t, 32>> read_key(std::string_view text, std::string_view file_name);
std::string key_text(std::span<const std::uint8_t, 32> key);

// SHA-256 of bytes that come in pieces.
class DigestOfPieces {
 public:
  DigestOfPieces();
  void add(std::span<const std::byte> bytes);
  Digest finish();  // and begins anew

 private:
  alignas(8) std::array<std::byte, 128> state_{};  // libsodium's, whose header stays in keys.cpp
};

}  // namespace wagonsight

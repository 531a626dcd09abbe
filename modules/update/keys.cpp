#include "update/keys.h"

#include <fmt/format.h>
#include <sodium.h>

#include <algorithm>

namespace wagonsight {
namespace {

const unsigned char* raw(const void* bytes) {
  return static_cast<const unsigned char*>(bytes);
}

crypto_hash_sha256_state* state_of(std::array<std::byte, 128>& bytes) {
  static_assert(sizeof(crypto_hash_sha256_state) <= sizeof bytes);
  return reinterpret_cast<crypto_hash_sha256_state*>(bytes.data());
}

int digit(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  return -1;
}

}  // namespace

std::string hex_text(std::span<const std::uint8_t> bytes) {
  constexpr std::string_view kDigits = "0123456789abcdef";
  std::string text;
  for (const std::uint8_t byte : bytes) {
    text += kDigits[byte >> 4U];
    text += kDigits[byte & 0xFU];
  }
  return text;
}

bool read_hex(std::string_view text, std::span<std::uint8_t> bytes) {
  if (text.size() != 2 * bytes.size()) return false;
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    const int high = digit(text[2 * i]), low = digit(text[2 * i + 1]);
    if (high < 0 || low < 0) return false;
    bytes[i] = static_cast<std::uint8_t>(16 * high + low);
  }
  return true;
}

Digest digest_of(std::span<const std::byte> bytes) {
  Digest digest{};
  crypto_hash_sha256(digest.data(), raw(bytes.data()), bytes.size());
  return digest;
}

KeyId key_id(const PublicKey& key) {
  const Digest digest = digest_of(std::as_bytes(std::span(key)));
  KeyId id{};
  std::copy_n(digest.begin(), id.size(), id.begin());
  return id;
}

PublicKey public_key_of(const SigningSeed& seed) {
  PublicKey key{};
  std::array<std::uint8_t, crypto_sign_SECRETKEYBYTES> secret{};
  crypto_sign_seed_keypair(key.data(), secret.data(), seed.data());
  sodium_memzero(secret.data(), secret.size());
  return key;
}

Signature sign(std::string_view text, const SigningSeed& seed) {
  PublicKey key{};
  std::array<std::uint8_t, crypto_sign_SECRETKEYBYTES> secret{};
  crypto_sign_seed_keypair(key.data(), secret.data(), seed.data());
  Signature signature{};
  crypto_sign_detached(signature.data(), nullptr, raw(text.data()), text.size(), secret.data());
  sodium_memzero(secret.data(), secret.size());
  return signature;
}

bool is_signed(std::string_view text, const Signature& signature, const PublicKey& key) {
  return crypto_sign_verify_detached(signature.data(), raw(text.data()), text.size(), key.data()) ==
         0;
}

Result<std::array<std::uint8_t, 32>> read_key(std::string_view text, std::string_view file_name) {
  while (!text.empty() && (text.back() == '\n' || text.back() == '\r')) text.remove_suffix(1);
  std::array<std::uint8_t, 32> key{};
  if (!read_hex(text, key))
    return fail(fmt::format(
        "{}: is no key: it must hold 64 hexadecimal digits; `wagonsight bundle new-key` makes one",
        file_name));
  return key;
}

std::string key_text(std::span<const std::uint8_t, 32> key) {
  return hex_text(key) + "\n";
}

DigestOfPieces::DigestOfPieces() {
  crypto_hash_sha256_init(state_of(state_));
}

void DigestOfPieces::add(std::span<const std::byte> bytes) {
  crypto_hash_sha256_update(state_of(state_), raw(bytes.data()), bytes.size());
}

Digest DigestOfPieces::finish() {
  Digest digest{};
  crypto_hash_sha256_final(state_of(state_), digest.data());
  crypto_hash_sha256_init(state_of(state_));
  return digest;
}

}  // namespace wagonsight

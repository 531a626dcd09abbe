#pragma once

namespace wagonsight::test {

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
inline constexpr bool kSanitized = true;
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
inline constexpr bool kSanitized = true;
#else
inline constexpr bool kSanitized = false;
#endif
#else
inline constexpr bool kSanitized = false;
#endif

// How many cases to draw: fewer where a sanitizer makes each of them ten times as slow.
constexpr int cases(int many, int sanitized) {
  return kSanitized ? sanitized : many;
}
constexpr bool is_sanitized() {
  return kSanitized;
}

}  // namespace wagonsight::test

#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "settings/settings.h"

// Any text as settings: read, or refused with the file's name in every line.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  const auto settings = wagonsight::parse_settings(text, "fuzz.toml");
  if (!settings) {
    std::string_view lines = settings.error().message;
    while (true) {
      if (!lines.starts_with("fuzz.toml:")) std::abort();
      const std::size_t end = lines.find('\n');
      if (end == std::string_view::npos) break;
      lines.remove_prefix(end + 1);
    }
  } else {
    const std::string told = wagonsight::without_secrets(text);
    // Telling twice is telling once: what is written reads back as what was written.
    if (wagonsight::without_secrets(told) != told) std::abort();
    for (const std::string& token : {settings->web.read_token, settings->web.admin_token})
      if (!token.empty() && told.find(token) != std::string::npos) std::abort();
  }
  return 0;
}

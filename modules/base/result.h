#pragma once

#include <string>
#include <tl/expected.hpp>
#include <utility>

namespace wagonsight {

// What went wrong outside of our control (a device, a file, a request, a setting), as one sentence
// for a person: what, where, and what to do next.
struct Error {
  std::string message;
};

// A value or an Error. Never ignored, never thrown. Not for the data path: an Error owns a string.
template <class T>
class [[nodiscard]] Result : public tl::expected<T, Error> {
 public:
  using tl::expected<T, Error>::expected;
};

inline tl::unexpected<Error> fail(std::string message) {
  return tl::unexpected<Error>(Error{std::move(message)});
}

}  // namespace wagonsight

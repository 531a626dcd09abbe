#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace wagonsight {

struct ZipEntry {
  std::string name;  // UTF-8, relative, with '/'
  std::string content;
};

// A zip archive (PKWARE APPNOTE 6.3, deflated, no zip64) as bytes. Its time stamps are
// `unix_time`'s, in UTC; 0 gives the format's first day. Total size below 4 GB. Allocates.
std::string make_zip(const std::vector<ZipEntry>& entries, double unix_time);

// gzip (RFC 1952) of a text, for Content-Encoding.
std::string make_gzip(std::string_view text);

}  // namespace wagonsight

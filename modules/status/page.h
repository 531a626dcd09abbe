#pragma once

#include <string_view>

// Files of the folder page/, compiled in.
namespace wagonsight::page {

extern const std::string_view kHtml;  // with the marks <!--style--> and <!--script-->
extern const std::string_view kStyle;
extern const std::string_view kScript;  // all scripts, one after the other
extern const std::string_view kOpenApi;
extern const std::string_view kLicenses;

}  // namespace wagonsight::page

#pragma once

#include <string_view>

namespace wagonsight::click_page {

// Files of the folder click/, compiled in.
extern const std::string_view kHtml;  // with the marks <!--style--> and <!--script-->
extern const std::string_view kStyle;
extern const std::string_view kScript;

}  // namespace wagonsight::click_page

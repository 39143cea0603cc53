// SPDX-License-Identifier: Apache-2.0
// What pages have within them: the files in web/, and D3 as Debian has it. CMake puts them in.
#pragma once

#include <string_view>

namespace ontime::report::web {

extern const std::string_view style;                            // page.css
extern const std::string_view course, figures, time_plot, way;  // *.js
extern const std::string_view d3, d3_licence;

}  // namespace ontime::report::web

// SPDX-License-Identifier: Apache-2.0
// The scripts of a page: the files in web/, and D3 as Debian has it. CMake puts them in.
#pragma once

#include <string_view>

namespace ontime::page::web {

extern const std::string_view course, figures, time_plot, way;  // *.js
extern const std::string_view d3, d3_licence;

}  // namespace ontime::page::web

// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string_view>

namespace ontime::table {

extern const std::string_view style;  // page.css, as it was when this was built

}  // namespace ontime::table

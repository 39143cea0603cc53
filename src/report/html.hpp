// SPDX-License-Identifier: Apache-2.0
// A page that stands alone.
#pragma once

#include <string>

#include <nlohmann/json.hpp>

#include "table/table.hpp"

namespace ontime::report {

// Tables alone, standing alone.
std::string as_html(const table::Page&);

// One file that opens anywhere, without a network: web/page.css is its style; where there is `data`, web/*.js
// draw it into the figures of the body. A content security policy lets no other script run. `body` is markup.
std::string standing_alone(const std::string& title, const std::string& body,
                           const nlohmann::json& data = nullptr);

}  // namespace ontime::report

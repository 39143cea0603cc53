// SPDX-License-Identifier: Apache-2.0
// HTML: text that stays text, tables, and a page that stands alone.
#pragma once

#include <string>

#include <nlohmann/json.hpp>

#include "report/page.hpp"

namespace ontime::report {

// Between tags and within quoted attributes. What is not printable() is not let through either.
std::string escaped(const std::string& text);

// A note, whose lines stay lines.
std::string note_as_html(const std::string& note);

// A table with its caption, conditions and notes.
std::string as_html(const Table&);

// Tables alone, standing alone.
std::string as_html(const Page&);

// One file that opens anywhere, without a network: web/page.css is its style; where there is `data`, web/*.js
// draw it into the figures of the body. A content security policy lets no other script run. `body` is markup.
std::string standing_alone(const std::string& title, const std::string& body,
                           const nlohmann::json& data = nullptr);

}  // namespace ontime::report

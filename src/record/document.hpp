// SPDX-License-Identifier: Apache-2.0
// The JSON texts of a run. Those in a file may be foreign.
#pragma once

#include <cstddef>
#include <optional>
#include <string>

#include <nlohmann/json.hpp>

namespace ontime::record {

// Far more than a run needs, and not all memory.
inline constexpr std::size_t longest_text = 8 << 20;

// Bytes that are not UTF-8 become U+FFFD.
std::string text_of(const nlohmann::json&);
std::string utf8_of(const std::string&);
// Nothing, if it is no JSON, is too long, or is nested deeper than anything of ours: most of what walks
// through a document does so by recursion.
std::optional<nlohmann::json> json_of(const std::string&);
// Whether arrays and objects in a text are nested too deeply; for any text, before it is parsed.
bool is_nested_deeper(const std::string& text, int levels);

}  // namespace ontime::record

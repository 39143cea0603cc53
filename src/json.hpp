// SPDX-License-Identifier: Apache-2.0
// nlohmann's JSON, whose templates are compiled once, in json.cpp, instead of in each file that uses them: a
// quarter less time for most files.
#pragma once

#include <string_view>

// The literals of this header, which are not used here, would make each file instantiate the parser.
// Templates wait until they are used.
#define _json(...)                 \
  _json(const char*, std::size_t); \
  template <typename>              \
  nlohmann::json literal(__VA_ARGS__)
#include <nlohmann/json.hpp>
#undef _json

extern template class nlohmann::basic_json<>;
extern template class nlohmann::detail::serializer<nlohmann::json>;

namespace ontime {

// A file that calls the library's parse() takes three seconds more to compile.
nlohmann::json parsed_json(std::string_view);        // throws json::parse_error
nlohmann::json json_or_discarded(std::string_view);  // is_discarded(): it is not JSON

}  // namespace ontime

// SPDX-License-Identifier: Apache-2.0
// nlohmann's JSON, whose templates are compiled once, in json.cpp, instead of in each file that uses them: a
// quarter less time for most files.
#pragma once

// The literals of this header, which are not used here, would make each file instantiate the parser. Templates wait until
// they are used.
#define _json(...) _json(const char*, std::size_t); template <typename> nlohmann::json literal(__VA_ARGS__)
#include <nlohmann/json.hpp>
#undef _json

extern template class nlohmann::basic_json<>;
extern template class nlohmann::detail::serializer<nlohmann::json>;

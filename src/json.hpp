// SPDX-License-Identifier: Apache-2.0
// nlohmann's JSON, whose templates are compiled once, in json.cpp, instead of in each file that uses them: a
// quarter less time for most files.
#pragma once

#include <nlohmann/json.hpp>

extern template class nlohmann::basic_json<>;
extern template class nlohmann::detail::serializer<nlohmann::json>;

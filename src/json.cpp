// SPDX-License-Identifier: Apache-2.0
#include "json.hpp"

template class nlohmann::basic_json<>;
template class nlohmann::detail::serializer<nlohmann::json>;

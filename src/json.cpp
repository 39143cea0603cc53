// SPDX-License-Identifier: Apache-2.0
#include "json.hpp"

template class nlohmann::basic_json<>;
template class nlohmann::detail::serializer<nlohmann::json>;

namespace ontime {

nlohmann::json parsed_json(std::string_view text) { return nlohmann::json::parse(text); }
nlohmann::json json_or_discarded(std::string_view text) {
  return nlohmann::json::parse(text, nullptr, false);
}

}  // namespace ontime

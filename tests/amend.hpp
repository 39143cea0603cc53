// SPDX-License-Identifier: Apache-2.0
// Changes of what a record says, by the names that its document has.
#pragma once

#include <string>

#include "record/record.hpp"

namespace ontime::record {

// amend(run.outcome, "/hosts/component/load_running", false)
template <typename Part>
void amend(Part& part, const std::string& pointer, const nlohmann::json& value) {
  auto document = part.document;
  document[nlohmann::json::json_pointer(pointer)] = value;
  part = Part(document);
}

template <typename Part>
void amend(Part& part, const nlohmann::json& members) {
  auto document = part.document;
  document.update(members);
  part = Part(document);
}

}  // namespace ontime::record

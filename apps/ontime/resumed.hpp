// SPDX-License-Identifier: Apache-2.0
// What a results file has of a suite that is to go on.
#pragma once

#include <map>
#include <string>

#include "record/record.hpp"

namespace ontime::app {

class Resumed {
 public:
  explicit Resumed(const record::Reader&);

  // The outcome of this run, if it was measured to its end: the same conditions, repetition, text of the
  // scenario and version of ontime. Throws campaign::Error{2} if it was so on another machine, or under
  // another kernel.
  const nlohmann::json* find(const nlohmann::json& asked, const nlohmann::json& machines) const;

 private:
  std::multimap<std::string, record::Run> complete_;  // by key
};

}  // namespace ontime::app

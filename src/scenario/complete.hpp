// SPDX-License-Identifier: Apache-2.0
// Checks of keys that depend on one another. All throw std::invalid_argument, for people.
#pragma once

#include <stdexcept>
#include <string>
#include <utility>

#include <fmt/format.h>

#include "scenario/scenario.hpp"

namespace ontime::scenario {

template <class... Values>
[[noreturn]] void refuse(fmt::format_string<Values...> text, Values&&... values) {
  throw std::invalid_argument(fmt::format(text, std::forward<Values>(values)...));
}

// Concurrent traffic, link faults and background topics.
void complete_network(Run&);
void complete_background(const Run&);
bool has_no_topics(const std::string& transport);
bool has_no_qos(const std::string& transport);
// Of why_not_by(), as far as the transports of both ends are known here.
std::string why_not_by_its_transports(const Run&, const conditions::Wire& = {});
// "another transport (udp, ethernet)": ontime's own that have, or lack, this capability.
std::string other_transports(bool transport::Capabilities::*what, bool has);
// Whether ROS 2 accepts the names of all topics.
void check_topics(const transport::Config&);

}  // namespace ontime::scenario

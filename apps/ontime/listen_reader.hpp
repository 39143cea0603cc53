// SPDX-License-Identifier: Apache-2.0
// `ontime listen --reader`.
#pragma once

#include <memory>
#include <set>
#include <string>

#include "listen/listen.hpp"

namespace ontime::app {

// Over the first of ontime's transports that can, in the domain of ROS_DOMAIN_ID. Throws campaign::Error.
std::unique_ptr<listen::Sensor> reader_of(const std::set<std::string>& topics, const listen::Limits&);

}  // namespace ontime::app

// SPDX-License-Identifier: Apache-2.0
// Plugin::hear() of Fast DDS.
#pragma once

#include <memory>
#include <set>
#include <string>

#include "transport/transport.hpp"

namespace ontime::transport::fastdds {

std::unique_ptr<Hearing> hear(int domain, const std::set<std::string>& topics);

}  // namespace ontime::transport::fastdds

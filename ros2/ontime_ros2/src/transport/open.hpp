// SPDX-License-Identifier: Apache-2.0
// The one function of the part that is linked with rclcpp.
#pragma once

#include <memory>

#include "options.hpp"
#include "transport/transport.hpp"

namespace ontime::transport::ros2 {

using OpenFunction = std::unique_ptr<Endpoint>(const Config&, const Options&, Sink&);

}  // namespace ontime::transport::ros2

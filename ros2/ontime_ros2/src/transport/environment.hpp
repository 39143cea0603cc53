// SPDX-License-Identifier: Apache-2.0
// ROS 2 and its middlewares take settings from the environment. Nothing else in the process changes it, and
// no other thread reads it at the same time.
#pragma once

#include <string>

#include "transport/transport.hpp"

namespace ontime::transport::ros2 {

std::string environment(const char* name);  // empty if it is not set

// ROS_LOCALHOST_ONLY must never reach an RMW together with an interface: Cyclone's refuses to start, and Fast
// DDS's brings back shared memory. So its wish becomes the interface, and this throws Error where another
// was asked for. Returns the configuration that says so.
Config without_localhost_only(Config config);

}  // namespace ontime::transport::ros2

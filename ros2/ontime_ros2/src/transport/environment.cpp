// SPDX-License-Identifier: Apache-2.0
#include "environment.hpp"

#include <cstdlib>

#include "transport/dds.hpp"

namespace ontime::transport::ros2 {

std::string environment(const char* name) {
  const char* const value = std::getenv(name);  // NOLINT(concurrency-mt-unsafe): see the header
  return value == nullptr ? "" : value;
}

Config without_localhost_only(Config config) {
  if (environment("ROS_LOCALHOST_ONLY") != "1") return config;
  if (config.interface.empty()) {
    config.interface = "lo";
    config.address = "127.0.0.1";
  } else if (!dds::is_loopback(config.address)) {
    throw Error("ros2: ROS_LOCALHOST_ONLY=1 keeps ROS 2 on this host, but interface " + config.interface +
                " is requested. Fix: unset ROS_LOCALHOST_ONLY, or name no interface");
  }
  return config;
}

}  // namespace ontime::transport::ros2

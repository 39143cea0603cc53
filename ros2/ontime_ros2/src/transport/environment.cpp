// SPDX-License-Identifier: Apache-2.0
// NOLINTBEGIN(concurrency-mt-unsafe): see the header
#include "environment.hpp"

#include <cstdlib>

#include "transport/dds.hpp"

namespace ontime::transport::ros2 {

std::string environment(const char* name) {
  const char* const value = std::getenv(name);
  return value == nullptr ? "" : value;
}

Variable::Variable(const char* name, const std::string& value) : name_(name) {
  if (const char* const before = std::getenv(name)) before_ = before;
  setenv(name, value.c_str(), 1);
}

Variable::~Variable() {
  if (before_)
    setenv(name_, before_->c_str(), 1);
  else
    unsetenv(name_);
}

Config without_localhost_only(Config config) {
  if (environment("ROS_LOCALHOST_ONLY") != "1") return config;
  if (config.interface.empty()) {
    config.interface = "lo";
    config.address = "127.0.0.1";
  } else if (!dds::is_loopback(config.address)) {
    throw Error("ros2: ROS_LOCALHOST_ONLY=1 keeps ROS 2 on this host, and the interface " + config.interface +
                " was asked for; unset ROS_LOCALHOST_ONLY, or name no interface");
  }
  return config;
}

}  // namespace ontime::transport::ros2
// NOLINTEND(concurrency-mt-unsafe)

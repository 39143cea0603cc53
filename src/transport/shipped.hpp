// SPDX-License-Identifier: Apache-2.0
// What ontime's own transports can do, and how to install them. A scenario is read where they need not be
// installed; of any other transport only its plug-in knows, which the agent asks.
#pragma once

#include <string_view>

#include "transport/transport.hpp"

namespace ontime::transport {

struct Shipped {
  std::string_view name;
  Capabilities can;     // but for the size of a payload, which the plug-in tells
  const char* install;  // "": it comes with the program

  constexpr Capabilities carrying(std::size_t max_payload_bytes) const {
    auto all = can;
    all.max_payload_bytes = max_payload_bytes;
    return all;
  }
};

inline constexpr Shipped all_shipped[] = {
    {"udp", {.launch_time = true, .topics = false}, ""},
    {"ethernet", {.launch_time = true, .below_ip = true}, ""},
    {"xdp",
     {.below_ip = true, .past_the_kernel = true},
     ". Fix: install the package ontime-transport-xdp, or build ontime with libxdp-dev and libbpf-dev"},
    {"cyclonedds",
     {.security = true, .background = true, .shares_threads = true},
     ". Fix: install the package ontime-transport-cyclonedds, or build ontime with cyclonedds-dev"},
    {"fastdds",
     {.security = true, .background = true, .hears = true},
     ". Fix: install the package ontime-transport-fastdds, or build ontime with libfastrtps-dev"},
    {"opendds",
     {.background = true},
     ". Fix: build ontime with OpenDDS (no Debian package; see docs/how-to/opendds.md)"},
    {"ros2",
     {.background = true, .nodes = true},
     ". Fix: build ros2/ with colcon in a sourced ROS 2 and source its setup.bash (docs/how-to/ros2.md)"}};

// nullptr: it is not one of ontime's own.
constexpr const Shipped* shipped(std::string_view name) {
  for (const auto& one : all_shipped)
    if (one.name == name) return &one;
  return nullptr;
}

}  // namespace ontime::transport

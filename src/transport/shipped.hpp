// SPDX-License-Identifier: Apache-2.0
// What ontime's own transports can do, and how to install them: a scenario is read where they need not be
// installed. Another transport declares it in its plug-in (see declared()).
#pragma once

#include <string_view>

#include "transport/transport.hpp"

namespace ontime::transport {

struct Shipped {
  std::string_view name;
  Capabilities can;
  const char* install;  // "": it comes with the program
};

inline constexpr std::size_t mebibyte = std::size_t{1} << 20U;
// Tested; DDS itself would carry 2 GiB.
inline constexpr std::size_t max_dds_payload_bytes = 16 * mebibyte;

inline constexpr Shipped all_shipped[] = {
    // The plug-ins check these sizes against their headers.
    {"udp", {.max_payload_bytes = 65'475, .launch_time = true, .topics = false, .qos = false}, ""},
    {"ethernet", {.max_payload_bytes = 65'503, .launch_time = true, .below_ip = true, .qos = false}, ""},
    {"xdp",
     {.max_payload_bytes = 3'794, .below_ip = true, .past_the_kernel = true, .qos = false},
     ". Fix: install the package ontime-transport-xdp, or build ontime with libxdp-dev and libbpf-dev"},
    {"cyclonedds",
     {.max_payload_bytes = max_dds_payload_bytes,
      .security = true,
      .background = true,
      .shares_threads = true},
     ". Fix: install the package ontime-transport-cyclonedds, or build ontime with cyclonedds-dev"},
    {"fastdds",
     {.max_payload_bytes = max_dds_payload_bytes, .security = true, .background = true, .hears = true},
     ". Fix: install the package ontime-transport-fastdds, or build ontime with libfastrtps-dev"},
    {"opendds",
     {.max_payload_bytes = max_dds_payload_bytes, .background = true},
     ". Fix: build ontime with OpenDDS (no Debian package; see docs/how-to/opendds.md)"},
    {"ros2",
     {.max_payload_bytes = mebibyte, .background = true, .nodes = true},  // tested, with its allocators
     ". Fix: build ros2/ with colcon in a sourced ROS 2 and source its setup.bash (docs/how-to/ros2.md)"}};

// nullptr: it is not one of ontime's own.
constexpr const Shipped* shipped(std::string_view name) {
  for (const auto& one : all_shipped)
    if (one.name == name) return &one;
  return nullptr;
}

}  // namespace ontime::transport

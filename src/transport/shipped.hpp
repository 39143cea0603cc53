// SPDX-License-Identifier: Apache-2.0
// What ontime's own transports can do, their options, and how to install them: a scenario is read where they
// need not be installed. Another transport declares it in its plug-in (see declared()).
#pragma once

#include <string_view>

#include "transport/transport.hpp"

namespace ontime::transport {

struct Shipped {
  std::string_view name;
  Capabilities can;
  const char* install;  // "": it comes with the program
  std::span<const Option> options = {};
};

// The options of each.
namespace options {
inline constexpr Option udp[] = {{"port", "UDP port that pong listens on (7900 + domain), at both ends"}};
inline constexpr Option busy_poll{"busy-poll",
                                  "on|off: the receive thread polls without sleeping; it needs its own CPU"};
inline constexpr Option ethernet[] = {busy_poll};
inline constexpr Option xdp[] = {busy_poll,
                                 {"queue", "the queue of the interface to send and receive on (0)"}};
inline constexpr Option cyclonedds[] = {{"config", "FILE or URI of Cyclone's XML"}};
inline constexpr Option fastdds[] = {{"profiles", "FILE of Fast DDS's XML profiles"}};
inline constexpr Option ros2[] = {
    {"executor", "single|multi|events with --receive listener, waitset|wait with --receive waitset"},
    {"rmw", "rmw_cyclonedds_cpp|rmw_fastrtps_cpp|…"},
    {"allocator", "default|tlsf|pmr"},
    {"intra-process", "off|on"},
    {"loaned", "off|on"},
    {"node", "NAME of the ROS node"},
    {"statistics", "on|off, live on /diagnostics"},
};
}  // namespace options

inline constexpr std::size_t mebibyte = std::size_t{1} << 20U;
// Tested; DDS itself would carry 2 GiB.
inline constexpr std::size_t max_dds_payload_bytes = 16 * mebibyte;

inline constexpr Shipped all_shipped[] = {
    // The plug-ins check these sizes against their headers.
    {"udp",
     {.max_payload_bytes = 65'475, .launch_time = true, .topics = false, .qos = false},
     "",
     options::udp},
    {"ethernet",
     {.max_payload_bytes = 65'503, .launch_time = true, .below_ip = true, .qos = false},
     "",
     options::ethernet},
    {"xdp",
     {.max_payload_bytes = 3'794, .below_ip = true, .past_the_kernel = true, .qos = false},
     ". Fix: install the package ontime-transport-xdp, or build ontime with libxdp-dev and libbpf-dev",
     options::xdp},
    {"cyclonedds",
     {.max_payload_bytes = max_dds_payload_bytes,
      .security = true,
      .background = true,
      .shares_threads = true},
     ". Fix: install the package ontime-transport-cyclonedds, or build ontime with cyclonedds-dev",
     options::cyclonedds},
    {"fastdds",
     {.max_payload_bytes = max_dds_payload_bytes, .security = true, .background = true, .hears = true},
     ". Fix: install the package ontime-transport-fastdds, or build ontime with libfastrtps-dev",
     options::fastdds},
    {"opendds",
     {.max_payload_bytes = max_dds_payload_bytes, .background = true},
     ". Fix: build ontime with OpenDDS (no Debian package; see docs/how-to/opendds.md)"},
    {"ros2",
     {.max_payload_bytes = mebibyte, .background = true, .nodes = true},  // tested, with its allocators
     ". Fix: build ros2/ with colcon in a sourced ROS 2 and source its setup.bash (docs/how-to/ros2.md)",
     options::ros2}};

// nullptr: it is not one of ontime's own.
constexpr const Shipped* shipped(std::string_view name) {
  for (const auto& one : all_shipped)
    if (one.name == name) return &one;
  return nullptr;
}

}  // namespace ontime::transport

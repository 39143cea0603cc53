// SPDX-License-Identifier: Apache-2.0
// Leads the DDS under the RMW to the link under test. For each vendor's there is a shared object, linked with
// the same DDS as the RMW, and loaded beside it.
#pragma once

#include <memory>
#include <string>

#include "transport/transport.hpp"

namespace ontime::transport::ros2 {

// While it lives, a participant that is opened takes the link.
class Lead {
 public:
  Lead() = default;
  virtual ~Lead() = default;
  Lead(const Lead&) = delete;
  Lead& operator=(const Lead&) = delete;

  // What the DDS itself said since; empty if nothing.
  virtual std::string said() { return {}; }

  std::string source;   // whose settings these are, for people
  std::string carrier;  // "UDPv4", or who decides
};

// Throws Error where the link, or the user's own settings, cannot be had.
std::unique_ptr<Lead> lead(const std::string& rmw, const Config& config);

// What such a shared object exports, as "ontime_lead".
using LeadFunction = std::unique_ptr<Lead>(const Config& config);

}  // namespace ontime::transport::ros2

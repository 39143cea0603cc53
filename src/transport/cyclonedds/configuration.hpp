// SPDX-License-Identifier: Apache-2.0
// The configuration of Cyclone DDS: ontime's settings for the run, and the user's own XML.
#pragma once

#include <string>

#include "transport/transport.hpp"

namespace ontime::transport::cyclonedds {

struct Configuration {
  std::string xml;      // for dds_create_domain
  std::string source;   // whose settings these are, for people
  std::string carrier;  // "UDPv4", or what the user's XML asks for
};

// The user's XML is CYCLONEDDS_URI and then the option "config". It wins over ours, list by list and value by
// value, with exceptions that keep the run as requested:
// - if a link under test is named, parts that lead around it are removed, and a carrier other than UDPv4 is
//   refused;
// - shared memory is off, for it would bypass any link;
// - threads whose role has a priority in Config::fifo_priority are born with that, not with the user's.
// Throws WrongInput for parts that an option may not have: it may come from a foreign scenario, and would
// write files, load libraries or open a port. Throws Error for XML that cannot be read, and for real-time
// threads that this process may not have (Cyclone DDS would abort).
Configuration configuration(const Config& config);

// What Cyclone DDS logged about a configuration that it refuses, without the names of its own files:
// "<Domain> has no element <Generall>".
std::string legible(std::string log);

// A thread that Cyclone DDS starts.
struct NamedThread {
  const char* name;
  const char* role;
  bool configurable;  // 0.10 refuses settings for the threads that receive users' data
};
// Null if Cyclone has no thread of that name.
const NamedThread* named_thread(const std::string& name);

}  // namespace ontime::transport::cyclonedds

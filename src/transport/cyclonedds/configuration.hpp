// SPDX-License-Identifier: Apache-2.0
// What Cyclone DDS is configured with: our settings for the run, and the user's own XML.
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
// value, except where the run would not be what was asked:
// - what of it leads around the link under test gives way where one is named, and another carrier than UDPv4
//   is refused;
// - shared memory is off, for it would bypass any link;
// - threads whose role has a priority in Config::fifo_priority are born with that, not with the user's.
// Throws WrongInput for what an option may not have (it may come from a foreign scenario: it would
// write files, load libraries or open a port), and Error for XML that cannot be read and for real-time
// threads that this process may not have, at which Cyclone DDS would abort.
Configuration configuration(const Config& config);

// What Cyclone DDS logged of a configuration that it does not take, without what only its own files have:
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

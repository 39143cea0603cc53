// SPDX-License-Identifier: Apache-2.0
// What Fast DDS is configured with: one document of its XML profiles, made of the user's own and of the
// run's. It uses no Fast DDS, so that a program that loads Fast DDS (ROS 2's RMW) can use it.
#pragma once

#include <optional>
#include <string>

#include "transport/dds.hpp"
#include "transport/transport.hpp"

namespace ontime::transport::fastdds {

struct Profiles {
  std::string xml;      // to be the only one that Fast DDS loads; has a default participant
  std::string source;   // whose settings these are, for people
  std::string carrier;  // "UDPv4", or who decides
};

// The user's profiles are what Fast DDS loads by itself, the file FASTRTPS_DEFAULT_PROFILES_FILE and, unless
// SKIP_DEFAULT_XML_FILE is 1, DEFAULT_FASTRTPS_PROFILES.xml in the working directory, and then the option
// "profiles". They stay as they are, except where the run would not be what was asked:
// - where a link under test is named, their transports, locators and data sharing give way to UDPv4 on that
//   link alone; else their transports stay, and where they name none it is UDPv4 alone;
// - peers are added to theirs;
// - shortcuts within a process are off.
// Throws WrongInput for what an option may not have (it may come from a foreign scenario: it would
// write files), and Error for a file that is not there or no XML. `who` begins each message.
Profiles profiles(const Config& config, const std::string& who);

// While it lives, the environment has Fast DDS load no file by itself.
class NoFile {
 public:
  NoFile();

 private:
  dds::Override file_, skip_;
  std::optional<dds::Override> more_variables_;
};

}  // namespace ontime::transport::fastdds

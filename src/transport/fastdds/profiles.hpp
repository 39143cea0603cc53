// SPDX-License-Identifier: Apache-2.0
// The configuration of Fast DDS: one document of XML profiles, from the user's and the run's. It does not use
// Fast DDS, so that a program that loads Fast DDS itself (ROS 2's RMW) can use it.
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

// Where Fast DDS finds profiles by itself: the variable that names a file, and a file of the working
// directory.
struct Names {
  const char *variable, *file;
};
inline constexpr Names names_of_2{"FASTRTPS_DEFAULT_PROFILES_FILE", "DEFAULT_FASTRTPS_PROFILES.xml"};
inline constexpr Names names_of_3{"FASTDDS_DEFAULT_PROFILES_FILE", "DEFAULT_FASTDDS_PROFILES.xml"};

// The user's profiles are what Fast DDS loads by itself, the variable's file and, unless
// SKIP_DEFAULT_XML_FILE is 1, the one in the working directory, and then the option "profiles". They stay as
// they are, with exceptions that keep the run as requested:
// - if a link under test is named, UDPv4 on that link replaces their transports, locators and data sharing.
//   Else their transports stay, and without any it is only UDPv4;
// - peers are added to theirs;
// - shortcuts within a process are off.
// Throws WrongInput for parts that an option may not have (it may come from a foreign scenario, and would
// write files), and Error for a file that is missing or not XML. `who` begins each message.
Profiles profiles(const Config& config, const std::string& who, const Names& names = names_of_2);

// While it lives, the environment keeps Fast DDS from loading files by itself.
class NoFile {
 public:
  explicit NoFile(const Names& names = names_of_2);

 private:
  dds::Override file_, skip_;
  std::optional<dds::Override> more_variables_;
};

}  // namespace ontime::transport::fastdds

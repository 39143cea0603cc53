// SPDX-License-Identifier: Apache-2.0
// The user's own XML, of either vendor.
#include <fstream>

#include <unistd.h>

#include "dds_ends.hpp"

namespace ontime::transport::test {
namespace {

class UsersXml : public testing::Test {
 protected:
  UsersXml() : path_(testing::TempDir() + "ontime_dds_pair_" + std::to_string(getpid()) + ".xml") {}
  ~UsersXml() override { unlink(path_.c_str()); }
  void write(const std::string& xml) { std::ofstream(path_) << xml; }

  const std::string path_;
};

TEST_F(UsersXml, OfCycloneIsHonouredButForItsInterfaces) {
  if (!have("cyclonedds")) GTEST_SKIP() << "cyclonedds is not built";
  write(R"(<?xml version="1.0"?><CycloneDDS><Domain id="any">
           <General><Interfaces><NetworkInterface name="no-such-if"/></Interfaces></General>
           <Internal><MultipleReceiveThreads>false</MultipleReceiveThreads></Internal></Domain></CycloneDDS>)");
  EXPECT_EQ(in_own_process([&] {
              Config config = config_of(Role::client);
              config.options["config"] = "file://" + path_;
              Answers answers;
              End end("cyclonedds", config, answers);
              for (const Thread& thread : end->threads()) require(thread.name != "recvUC", "not honoured");
              const std::string source = end->facts()["configuration"];
              require(source.find(path_ + " without its interfaces") != std::string::npos, source);
            }),
            "");
}

TEST_F(UsersXml, OfCycloneThatIsWrongIsRefused) {
  if (!have("cyclonedds")) GTEST_SKIP() << "cyclonedds is not built";
  write("<CycloneDDS>\n<Domain>\n<General></Domain></CycloneDDS>");
  const auto refusal = in_own_process([&] {
    Config config = config_of(Role::client);
    config.options["config"] = path_;
    Answers answers;
    End end("cyclonedds", config, answers);
  });
  EXPECT_NE(refusal.find(path_ + ", line 3"), std::string::npos) << refusal;
}

TEST_F(UsersXml, OfFastDdsKeepsItsTransports) {
  if (!have("fastdds")) GTEST_SKIP() << "fastdds is not built";
  write(R"(<?xml version="1.0"?><dds><profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
           <transport_descriptors><transport_descriptor><transport_id>udp</transport_id><type>UDPv4</type>
           </transport_descriptor></transport_descriptors>
           <participant profile_name="p" is_default_profile="true"><rtps><userTransports>
           <transport_id>udp</transport_id></userTransports><useBuiltinTransports>false</useBuiltinTransports>
           </rtps></participant></profiles></dds>)");
  EXPECT_EQ(in_own_process([&] {
              Config config = config_of(Role::client);
              config.options["profiles"] = path_;
              Answers answers;
              End end("fastdds", config, answers);
              require(end->facts()["carrier"] == "the profile's transports", end->facts()["carrier"]);
            }),
            "");
}

TEST_F(UsersXml, OfFastDdsThatIsWrongIsRefused) {
  if (!have("fastdds")) GTEST_SKIP() << "fastdds is not built";
  write("<dds><profiles><participant>");
  const auto refusal = in_own_process([&] {
    Config config = config_of(Role::client);
    config.options["profiles"] = path_;
    Answers answers;
    End end("fastdds", config, answers);
  });
  EXPECT_NE(refusal.find(path_), std::string::npos) << refusal;
}

}  // namespace
}  // namespace ontime::transport::test

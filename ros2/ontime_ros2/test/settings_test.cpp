// SPDX-License-Identifier: Apache-2.0
// What the environment says to ROS 2 and its middlewares: done, or refused in words that say what to do.
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "ends.hpp"

namespace ontime::transport {
namespace {

using testing::AllOf;
using testing::AnyOf;
using testing::HasSubstr;

TEST(Environment, ContradictionIsRefusedWithItsFix) {
  const Config config = config_of(Role::client, {});
  EXPECT_THAT(error_of(config, [] { set("RMW_IMPLEMENTATION", "rmw_smoke_signals_cpp"); }),
              HasSubstr("is not installed"));
  EXPECT_THAT(error_of(config, [] { set("AMENT_PREFIX_PATH", ""); }), HasSubstr("setup.bash"));
  Config elsewhere = config;
  elsewhere.interface = "veth0";
  elsewhere.address = "10.0.0.1";
  EXPECT_THAT(error_of(elsewhere, [] { set("ROS_LOCALHOST_ONLY", "1"); }),
              HasSubstr("unset ROS_LOCALHOST_ONLY"));
  EXPECT_EQ(error_of(config, [] { set("ROS_LOCALHOST_ONLY", "1"); }), "");
}

TEST(Rmw, SecondRmwInOneProcessIsRefused) {
  EXPECT_THAT(in_own_process([] {
                Answers answers;
                const auto open = [&](const char* rmw) {
                  two_ends::plugin().open(config_of(Role::client, {{"rmw", rmw}}), answers);
                };
                open("rmw_cyclonedds_cpp");
                open("rmw_fastrtps_cpp");
              }),
              AllOf(HasSubstr("requested RMW rmw_fastrtps_cpp"), HasSubstr("rmw_cyclonedds_cpp is loaded")));
}

TEST(Rmw, RmwOtherThanTheAssertedOneIsRefused) {
  const auto assert_cyclone = [] { set("RCL_ASSERT_RMW_ID_MATCHES", "rmw_cyclonedds_cpp"); };
  EXPECT_THAT(error_of(config_of(Role::client, {{"rmw", "rmw_fastrtps_cpp"}}), assert_cyclone),
              AllOf(HasSubstr("RCL_ASSERT_RMW_ID_MATCHES requires RMW rmw_cyclonedds_cpp"),
                    HasSubstr("rmw_fastrtps_cpp is loaded"), HasSubstr("--option rmw=rmw_cyclonedds_cpp")));
  EXPECT_EQ(error_of(config_of(Role::client, {{"rmw", "rmw_cyclonedds_cpp"}}), assert_cyclone), "");
}

TEST(Rmw, BrokenRmwIsRefusedWithTheFix) {
  const auto prefix =
      std::filesystem::path(testing::TempDir()) / ("ontime_ros2_rmw_" + std::to_string(getpid()));
  const auto index = prefix / "share/ament_index/resource_index/rmw_typesupport";
  std::filesystem::create_directories(index);
  const char* const prefixes = std::getenv("AMENT_PREFIX_PATH");  // NOLINT(concurrency-mt-unsafe)
  ASSERT_NE(prefixes, nullptr);
  std::ofstream(index / "rmw_half_installed_cpp") << "\n";
  EXPECT_THAT(error_of(config_of(Role::client, {{"rmw", "rmw_half_installed_cpp"}}),
                       [&] { set("AMENT_PREFIX_PATH", prefix.string() + ":" + prefixes); }),
              AllOf(HasSubstr("rmw_half_installed_cpp does not load"), HasSubstr("setup.bash")));
  std::filesystem::remove_all(prefix);
}

TEST(CycloneDds, SaysWhatIsWrongInTheUsersXml) {
  const auto error_with = [](const std::string& xml) {
    return error_of(config_of(Role::client, {{"rmw", "rmw_cyclonedds_cpp"}}),
                    [&] { set("CYCLONEDDS_URI", xml); });
  };
  EXPECT_THAT(error_with("<CycloneDDS><Domain><General><Colour>red</Colour></General></Domain></CycloneDDS>"),
              AllOf(HasSubstr("CYCLONEDDS_URI"), HasSubstr("Colour")));
  EXPECT_THAT(error_with("/nowhere.xml"), HasSubstr("/nowhere.xml"));
}

class FastDds : public testing::Test {
 protected:
  FastDds() : folder_(testing::TempDir() + "ontime_ros2_" + std::to_string(getpid())) {
    std::filesystem::create_directory(folder_);
  }
  ~FastDds() override { std::filesystem::remove_all(folder_); }

  std::string write(const std::string& name, const std::string& text) {
    std::ofstream(folder_ / name) << text;
    return folder_ / name;
  }
  static std::string participant(const std::string& rtps, const std::string& before = "") {
    return R"(<?xml version="1.0"?><dds><profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">)" +
           before + R"(<participant profile_name="mine" is_default_profile="true"><rtps>)" + rtps +
           "</rtps></participant></profiles></dds>";
  }
  // What it throws, and what it then is.
  std::string error_in_folder(const std::function<void()>& before,
                              const std::function<void(Endpoint&)>& check) {
    return in_own_process([&] {
      std::filesystem::current_path(folder_);
      before();
      Answers answers;
      const auto endpoint =
          two_ends::plugin().open(config_of(Role::client, {{"rmw", "rmw_fastrtps_cpp"}}), answers);
      check(*endpoint);
    });
  }
  static void require_the_link(Endpoint& endpoint) {
    require(endpoint.facts().at("carrier") == "UDPv4", "carried by " + endpoint.facts().at("carrier"));
    std::ifstream maps("/proc/self/maps");
    for (std::string line; std::getline(maps, line);)
      require(line.find("/dev/shm/fastrtps_") == line.npos, "shared memory: " + line);
  }

  const std::filesystem::path folder_;
};

TEST_F(FastDds, TakesTheLinkWithTheUsersProfileAsWell) {
  // What is seen of the profile: so many milliseconds until a silent participant counts as gone.
  const std::string file =
      write("mine.xml", participant("<name>mine</name><builtin><discovery_config><leaseDuration><sec>7</sec>"
                                    "</leaseDuration></discovery_config></builtin>"));
  EXPECT_EQ(error_in_folder([&] { set("FASTRTPS_DEFAULT_PROFILES_FILE", file); },
                            [&](Endpoint& endpoint) {
                              require_the_link(endpoint);
                              const std::string source = endpoint.facts().at("configuration");
                              require(source.find(file) != source.npos, source);
                            }),
            "");
}

TEST_F(FastDds, TakesTheLinkAndNotTheUsersTransports) {
  const std::string file = write(
      "mine.xml",
      participant(
          "<userTransports><transport_id>mine</transport_id></userTransports>"
          "<useBuiltinTransports>false</useBuiltinTransports>",
          "<transport_descriptors><transport_descriptor><transport_id>mine</transport_id><type>SHM</type>"
          "</transport_descriptor></transport_descriptors>"));
  EXPECT_EQ(error_in_folder([&] { set("FASTRTPS_DEFAULT_PROFILES_FILE", file); },
                            [&](Endpoint& endpoint) {
                              require_the_link(endpoint);
                              const std::string source = endpoint.facts().at("configuration");
                              require(source.find("without its transports") != source.npos, source);
                            }),
            "");
}

TEST_F(FastDds, RefusesAFileThatIsNotThere) {
  EXPECT_THAT(
      error_in_folder([] { set("FASTRTPS_DEFAULT_PROFILES_FILE", "/nowhere.xml"); }, require_the_link),
      AllOf(HasSubstr("FASTRTPS_DEFAULT_PROFILES_FILE"), HasSubstr("/nowhere.xml")));
}

TEST_F(FastDds, SaysWhatIsWrongInTheUsersProfile) {
  const std::string file = write("mine.xml", participant("<colour>red</colour>"));
  EXPECT_THAT(error_in_folder([&] { set("FASTRTPS_DEFAULT_PROFILES_FILE", file); }, require_the_link),
              AllOf(HasSubstr(file), HasSubstr("colour")));
}

// Fast DDS passes over such a file without a word; the link is not to be lost with it.
TEST_F(FastDds, TakesTheLinkOrRefusesBesideAnEmptyFileInTheFolder) {
  for (const char* text : {"", "<dds></dds>", "<dds><profiles></profiles></dds>"}) {
    write("DEFAULT_FASTRTPS_PROFILES.xml", text);
    const std::string error = error_in_folder([] {}, require_the_link);
    EXPECT_THAT(error, AnyOf("", HasSubstr("DEFAULT_FASTRTPS_PROFILES.xml")));
  }
}

}  // namespace
}  // namespace ontime::transport

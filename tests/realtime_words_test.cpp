// SPDX-License-Identifier: Apache-2.0
// What is read from texts of users and of the kernel.
#include <algorithm>
#include <random>
#include <set>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "realtime/privileges.hpp"
#include "realtime/realtime.hpp"
#include "realtime/state.hpp"

namespace ontime::realtime {
namespace {

using namespace std::string_literals;
using testing::ElementsAre;
using testing::HasSubstr;

TEST(Words, PoliciesComeBack) {
  for (const auto policy : {Policy::other, Policy::fifo, Policy::round_robin, Policy::deadline})
    EXPECT_EQ(policy_of(word_of(policy)), policy);
  for (const auto* word : {"", "FIFO", "fifo ", "sched_fifo", "batch"}) EXPECT_FALSE(policy_of(word)) << word;
}

TEST(Words, KernelsAreInTheOrderOfTheirVersions) {
  for (const auto* release : {"6.12.0", "6.12-rt", "6.13.1", "7.0.0"})
    EXPECT_TRUE(is_kernel_since(6, 12, release)) << release;
  for (const auto* release : {"6.11.9", "6.2.0", "5.99.1", "", "rt"})
    EXPECT_FALSE(is_kernel_since(6, 12, release)) << release;
}

TEST(Words, EverySetOfCpusComesBack) {
  std::mt19937 random(1);
  for (int round = 0; round < 500; ++round) {
    std::set<int> cpus;
    const int highest = std::uniform_int_distribution(0, round % 2 == 0 ? 12 : 1023)(random);
    for (int i = 0; i <= highest; ++i) cpus.insert(std::uniform_int_distribution(0, highest)(random));
    std::vector<int> shuffled(cpus.begin(), cpus.end());
    std::shuffle(shuffled.begin(), shuffled.end(), random);
    EXPECT_EQ(cpus_of(list_of(shuffled)), std::vector<int>(cpus.begin(), cpus.end())) << list_of(shuffled);
  }
}

TEST(Words, ListsAreWrittenAsTheKernelDoes) {
  EXPECT_EQ(list_of({3, 0, 1, 1}), "0-1,3");
  EXPECT_EQ(list_of({}), "");
  EXPECT_THAT(cpus_of("0-1,3").value(), ElementsAre(0, 1, 3));
  EXPECT_THAT(cpus_of("1023").value(), ElementsAre(1023));
}

TEST(Words, InvalidListGivesNoCpus) {
  for (const auto* list : {"",
                           " ",
                           ",",
                           "0,",
                           ",0",
                           "-1",
                           "1-",
                           "-",
                           "3-1",
                           "0--1",
                           "a",
                           "0 1",
                           "0, 1",
                           "0x1",
                           "1024",
                           "0-1024",
                           "0-99999999999",
                           "+1",
                           "1\n",
                           "0-1-2",
                           "0;1"})
    EXPECT_FALSE(cpus_of(list)) << '"' << list << '"';
}

TEST(Words, RandomTextNeverCrashesAndWhatIsTakenIsInRange) {
  std::mt19937 random(2);
  const std::string alphabet = "0123456789-, \n+x";
  for (int round = 0; round < 20000; ++round) {
    std::string text;
    for (int length = std::uniform_int_distribution(0, 8)(random); length > 0; --length)
      text += alphabet[std::uniform_int_distribution<std::size_t>(0, alphabet.size() - 1)(random)];
    if (const auto cpus = cpus_of(text)) {
      EXPECT_THAT(*cpus, ::testing::Each(::testing::AllOf(::testing::Ge(0), ::testing::Le(1023)))) << text;
      EXPECT_EQ(cpus_of(list_of(*cpus)), cpus);
    }
  }
}

TEST(Capabilities, AreThoseInEffect) {
  EXPECT_TRUE(has_capability("CapPrm:\t0\nCapEff:\t0000000000201000\n", 21));
  EXPECT_TRUE(has_capability("CapEff:\t0000000000201000\n", 12));
  EXPECT_FALSE(has_capability("CapEff:\t0000000000201000\n", 20));
  EXPECT_FALSE(has_capability("CapPrm:\tffffffffffffffff\n", 1));
  EXPECT_FALSE(has_capability("", 1));
}

TEST(Budget, BudgetIsThatOfTheNearestVisibleGroup) {
  EXPECT_THAT(budget_files("4:memory:/a\n3:cpu,cpuacct:/c\n0::/d\n"),
              testing::ElementsAre("/sys/fs/cgroup/cpu,cpuacct/c/cpu.rt_runtime_us",
                                   "/sys/fs/cgroup/cpu,cpuacct//cpu.rt_runtime_us"));
  EXPECT_THAT(budget_files("3:cpuset:/c\n0::/d\n"), testing::IsEmpty());
}

TEST(Service, ServiceIsFoundByItsControlGroup) {
  EXPECT_EQ(service_of("0::/system.slice/robot.service\n"), "robot.service");
  EXPECT_EQ(
      service_of(
          "4:cpu:/\n1:name=systemd:/system.slice/system-ontime\\x2dpong.slice/ontime-pong@arm.service\n"),
      "ontime-pong@arm.service");
  EXPECT_EQ(service_of("0::/system.slice/robot.service/part\n"), "robot.service");
  EXPECT_EQ(service_of("0::/user.slice/user-1000.slice/user@1000.service/app.slice/x.service\n"), "");
  EXPECT_EQ(service_of("0::/user.slice/user-1000.slice/session-3.scope\n"), "");
  EXPECT_EQ(service_of("0::/system.slice/docker-1234.scope\n"), "");
  EXPECT_EQ(service_of(""), "");
}

TEST(Container, IsStartedAnewForWhatNeitherSudoNorSetcapGives) {
  const auto* const first = "         0          0 4294967295\n";
  const auto of = [](int user, const char* effective, const char* bounding) {
    return fmt::format("Uid:\t{0}\t{0}\t{0}\t{0}\nCapEff:\t{1}\nCapBnd:\t{2}\n", user, effective, bounding);
  };
  const auto* const all = "000001ffffffffff";
  const auto* const of_docker = "00000000a80425fb";
  const auto* const none = "0000000000000000";
  const auto options = testing::AllOf(HasSubstr("docker run "), HasSubstr("--ulimit rtprio=99"),
                                      HasSubstr("--ulimit memlock=-1"));
  for (const auto& status : {of(0, of_docker, of_docker), of(1000, none, of_docker), of(0, none, all)}) {
    EXPECT_THAT(how_to_permit_container({status, first}),
                testing::AllOf(options, HasSubstr("--cap-add SYS_NICE")));
    EXPECT_THAT(
        how_to_be_root_in_container({status, first}),
        testing::AllOf(HasSubstr("--cap-add SYS_ADMIN --cap-add NET_ADMIN"), HasSubstr("--privileged")));
  }
  for (const auto& status : {of(0, all, all), of(1000, none, all), std::string()}) {
    EXPECT_EQ(how_to_permit_container({status, first}), "");
    EXPECT_EQ(how_to_be_root_in_container({status, ""}), "") << "a kernel without user namespaces";
  }
  EXPECT_THAT(how_to_be_root_in_container({of(0, "0000000000200000", all), first}),
              testing::AllOf(HasSubstr("NET_ADMIN"), testing::Not(HasSubstr("SYS_ADMIN"))));
  // A rootless container's root has all capabilities, but none for priorities and locked memory.
  const Privileges rootless{of(0, all, all), "0 1000 1\n1 100000 65536\n"};
  EXPECT_FALSE(rootless.has(23));
  EXPECT_THAT(how_to_permit_container(rootless),
              testing::AllOf(options, HasSubstr("on the host"), testing::Not(HasSubstr("cap-add"))));
  EXPECT_TRUE((Privileges{of(0, all, all), first}.has(23)));
}

TEST(Service, UnitPermitsTheServiceButNotALogin) {
  const auto* const group = "0::/system.slice/robot.service\n";
  EXPECT_THAT(how_to_permit_service("INVOCATION_ID=1f\0HOME=/\0"s, group),
              testing::AllOf(HasSubstr("systemctl edit 'robot.service'"),
                             HasSubstr("\nLimitRTPRIO=98\nLimitMEMLOCK=infinity")));
  EXPECT_THAT(how_to_permit_service("HOME=/\0INVOCATION_ID=1f\0"s, group, 99), HasSubstr("LimitRTPRIO=99"));
  EXPECT_EQ(how_to_permit_service("HOME=/\0MY_INVOCATION_ID=1f\0"s, group), "");
  EXPECT_EQ(how_to_permit_service("INVOCATION_ID=1f\0"s, "0::/user.slice/session-3.scope\n"), "");
}

}  // namespace
}  // namespace ontime::realtime

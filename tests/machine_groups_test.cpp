// SPDX-License-Identifier: Apache-2.0
// CPU quotas of control groups.
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <unistd.h>

#include "machine/machine.hpp"
#include "machine/proc.hpp"

namespace ontime::machine {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

// A control group made of files.
class Groups : public ::testing::Test {
 protected:
  void TearDown() override { std::filesystem::remove_all(root_); }
  void file(const std::string& path, const std::string& text) const {
    std::filesystem::create_directories(std::filesystem::path(root_ + path).parent_path());
    std::ofstream(root_ + path) << text << '\n';
  }
  const std::string root_ = "quota_test_" + std::to_string(getpid());
};

TEST_F(Groups, QuotasOfBothVersionsAreReadFromTheInnermostOut) {
  EXPECT_THAT(cpu_quotas(root_), IsEmpty());
  file("/proc/self/cgroup", "4:memory:/a\n3:cpu,cpuacct:/a/b\n0::/c/d");
  const std::string first = "/sys/fs/cgroup/cpu", second = "/sys/fs/cgroup";
  file(first + "/cpu.cfs_quota_us", "-1");
  file(first + "/cpu.cfs_period_us", "100000");
  file(first + "/a/cpu.cfs_quota_us", "150000");
  file(first + "/a/cpu.cfs_period_us", "100000");
  file(first + "/a/b/cpu.cfs_quota_us", "12000");
  file(first + "/a/b/cpu.cfs_period_us", "100000");
  file(first + "/a/b/cpu.stat", "nr_periods 90\nnr_throttled 54\nthrottled_time 2700000000");
  file(second + "/c/d/cpu.max", "max 100000");
  file(second + "/c/cpu.max", "25000 50000");
  file(second + "/c/cpu.stat", "usage_usec 7\nnr_periods 9\nnr_throttled 3\nthrottled_usec 4000");
  const auto quotas = cpu_quotas(root_);
  std::vector<std::string> files;
  std::vector<double> cpus;
  for (const auto& quota : quotas) {
    files.push_back(quota.file);
    cpus.push_back(quota.cpus);
  }
  EXPECT_THAT(files, ElementsAre(first + "/a/b/cpu.cfs_quota_us", first + "/a/cpu.cfs_quota_us",
                                 second + "/c/cpu.max"));
  EXPECT_THAT(cpus, ElementsAre(0.12, 1.5, 0.5));
  EXPECT_EQ(quotas[0].throttled_periods, 54u);
  EXPECT_EQ(quotas[0].throttled_ns, 2'700'000'000u);
  EXPECT_EQ(quotas[1].throttled_periods, 0u) << "it has no cpu.stat";
  EXPECT_EQ(quotas[2].throttled_ns, 4'000'000u);
}

TEST_F(Groups, ContainersOwnGroupIsItsRoot) {
  file("/proc/self/cgroup", "0::/");
  file("/sys/fs/cgroup/cpu.max", "50000 100000");
  EXPECT_EQ(cpu_quotas(root_).at(0).cpus, 0.5);
  file("/proc/self/cgroup", "3:cpu:/docker/1f");  // version 1: by a path that only the host has
  file("/sys/fs/cgroup/cpu/cpu.cfs_quota_us", "20000");
  EXPECT_THAT(cpu_quotas(root_), IsEmpty()) << "no period";
  file("/sys/fs/cgroup/cpu/cpu.cfs_period_us", "100000");
  EXPECT_EQ(cpu_quotas(root_).at(0).cpus, 0.2);
}

TEST(QuotasBetween, TheLongestStopOfTheSameGroupCounts) {
  const std::vector<GroupQuota> first = {{"a", 0.1, 5, 500}, {"b", 2, 10, 1000}, {"d", 1, 9, 900}};
  EXPECT_FALSE(between(first, first));
  const auto most =
      between(first, {{"c", 0.1, 99, 9900}, {"d", 1, 1, 950}, {"a", 0.1, 6, 600}, {"b", 2, 12, 1200}});
  ASSERT_TRUE(most) << "c is new, and d was set back";
  EXPECT_EQ(most->file, "b");
  EXPECT_EQ(most->throttled_periods, 2u);
  EXPECT_EQ(most->throttled_ns, 200u);
}

}  // namespace
}  // namespace ontime::machine

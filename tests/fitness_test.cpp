// SPDX-License-Identifier: Apache-2.0
#include "fitness/fitness.hpp"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <sstream>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "conditions/conditions.hpp"

namespace ontime::fitness {
namespace {

namespace fs = std::filesystem;

using testing::AllOf;
using testing::AnyOf;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;
using testing::SizeIs;
using testing::StartsWith;

constexpr unsigned PF_KTHREAD = 0x0020'0000;  // of the kernel's include/linux/sched.h

// A machine made of files.
class Machine : public testing::Test {
 protected:
  void SetUp() override { fs::create_directories(root_); }
  void TearDown() override { fs::remove_all(root_); }

  void file(const std::string& path, const std::string& text) {
    fs::create_directories((root_ + path).substr(0, (root_ + path).rfind('/')));
    std::ofstream(root_ + path) << text << '\n';
  }
  void thread(int pid, const std::string& name, int policy, int priority, bool is_of_kernel = true) {
    // pid (comm) state … flags … rt_priority policy …, as proc(5) counts them
    std::string text = std::to_string(pid) + " (" + name + ") S";
    for (int field = 4; field < 40; ++field)
      text += ' ' + std::to_string(field == 9 && is_of_kernel ? PF_KTHREAD : 0);
    file("/proc/" + std::to_string(pid) + "/stat",
         text + ' ' + std::to_string(priority) + ' ' + std::to_string(policy) + " 0 0 0");
  }
  std::vector<Finding> found(const std::string& name) {
    auto all = check({root_, interfaces_, synchronised_});
    std::erase_if(all, [&](const Finding& finding) { return finding.check != name; });
    return all;
  }
  // Of a check that finds one thing here.
  Finding one(const std::string& name) {
    const auto all = found(name);
    EXPECT_THAT(all, SizeIs(1)) << name;
    return all.empty() ? Finding{} : all.front();
  }
  Severity severity(const std::string& name) { return one(name).severity; }
  // Once a file says so.
  Severity severity(const std::string& name, const std::string& path, const std::string& text) {
    file(path, text);
    return severity(name);
  }

  std::string root_ =
      (fs::temp_directory_path() / ("ontime-fitness-test-" + std::to_string(getpid()))).string();
  std::vector<std::string> interfaces_;
  std::optional<bool> synchronised_;
};

TEST_F(Machine, EmptyMachineHasOnlyKernelFindings) {
  const auto all = check({root_, {}, {}});
  ASSERT_THAT(all, SizeIs(1));
  EXPECT_EQ(all[0].check, "preemption");
}

TEST_F(Machine, UnreadableFileStopsNoOtherCheck) {
  fs::create_directories(root_ + "/proc/cmdline");
  fs::create_directories(root_ + "/sys/kernel/realtime");
  EXPECT_FALSE(check({root_, {}, {}}).empty());
}

TEST_F(Machine, RealTimeKernelIsInstalledAsItsDistributionHasIt) {
  const auto fix = [&] { return one("preemption").remedy; };
  const auto on_debian = HasSubstr("apt install linux-image-rt-amd64");
  const auto on_ubuntu = HasSubstr("sudo pro enable realtime-kernel");
  EXPECT_THAT(fix(), Not(AnyOf(StartsWith("sudo apt"), on_ubuntu))) << "it is not known";
  file("/usr/lib/os-release", "NAME=\"Debian GNU/Linux\"\nID=debian");
  EXPECT_THAT(fix(), on_debian);
  file("/etc/os-release", "ID=ubuntu\nID_LIKE=debian\nVERSION_CODENAME=jammy");
  EXPECT_THAT(fix(), AllOf(on_ubuntu, Not(on_debian)));
  file("/etc/os-release", "ID=linuxmint\nID_LIKE=\"ubuntu debian\"");
  EXPECT_THAT(fix(), on_ubuntu);
  file("/etc/os-release", "ID=fedora");
  EXPECT_THAT(fix(), Not(AnyOf(StartsWith("sudo apt"), on_ubuntu)));
}

TEST_F(Machine, IsPreemptibleOrNot) {
  EXPECT_EQ(severity("preemption", "/proc/version", "Linux version 6.1.0-rt (x) #1 SMP PREEMPT_RT Debian"),
            Severity::fine);
  EXPECT_EQ(severity("preemption", "/proc/version", "Linux version 6.18 #1 SMP PREEMPT_DYNAMIC"),
            Severity::hint);
  file("/proc/cmdline", "quiet preempt=voluntary");
  EXPECT_THAT(one("preemption").is, HasSubstr("voluntary"));
  EXPECT_EQ(severity("preemption"), Severity::wrong);
  EXPECT_EQ(severity("preemption", "/sys/kernel/debug/sched/preempt", "none voluntary (full) lazy"),
            Severity::hint)
      << "the kernel itself knows best";
  EXPECT_EQ(severity("preemption", "/sys/kernel/debug/sched/preempt", "none voluntary full (lazy)"),
            Severity::hint)
      << "ordinary threads alone are not kept waiting by it";
  file("/proc/version", "Linux version 4.19 #1 SMP Debian");
  fs::remove(root_ + "/sys/kernel/debug/sched/preempt");
  fs::remove(root_ + "/proc/cmdline");
  EXPECT_EQ(severity("preemption"), Severity::wrong);
  EXPECT_EQ(severity("preemption", "/sys/kernel/realtime", "1"), Severity::fine);
}

TEST_F(Machine, ThrottlesRealTime) {
  file("/proc/sys/kernel/sched_rt_period_us", "1000000");
  file("/proc/sys/kernel/sched_rt_runtime_us", "950000");
  EXPECT_THAT(one("rt-throttling").is, HasSubstr("950000"));
  EXPECT_EQ(severity("rt-throttling"), Severity::hint);
  for (const auto* off : {"-1", "1000000"})
    EXPECT_EQ(severity("rt-throttling", "/proc/sys/kernel/sched_rt_runtime_us", off), Severity::fine);
  file("/proc/sys/kernel/sched_rt_runtime_us", "950000");
  EXPECT_EQ(severity("rt-throttling", "/proc/version", "Linux version 6.11.9-rt (x) #1"), Severity::hint);
  file("/proc/version", "Linux version 6.12.0 (x) #1 SMP PREEMPT_RT");
  EXPECT_EQ(severity("rt-throttling"), Severity::fine) << "the limit is for deadline threads alone";
  EXPECT_THAT(one("rt-throttling").is, HasSubstr("fair server"));
  file("/proc/self/cgroup", "1:cpu:/");
  EXPECT_EQ(severity("rt-throttling", "/sys/fs/cgroup/cpu/cpu.rt_runtime_us", "950000"), Severity::hint)
      << "CONFIG_RT_GROUP_SCHED still has it";
  EXPECT_EQ(severity("fair-server", "/sys/kernel/debug/sched/fair_server/cpu0/runtime", "50000000"),
            Severity::hint);
  EXPECT_THAT(one("fair-server").remedy, StartsWith("sudo sh -c 'for f in /sys/kernel/debug/"))
      << "an ordinary user's shell cannot list that folder";
  file("/sys/kernel/debug/sched/fair_server/cpu0/runtime", "0");
  EXPECT_THAT(found("fair-server"), IsEmpty());
}

TEST_F(Machine, GivesItsUserPrioritiesAndMemory) {
  const auto limits = [&](const std::string& priority, const std::string& memory) {
    file("/proc/self/limits",
         "Limit                     Soft Limit           Hard Limit           Units     \n"
         "Max locked memory         " +
             memory +
             "              8388608              bytes     \n"
             "Max realtime priority     " +
             priority +
             "                    0                    \n"
             "Max realtime timeout      unlimited            unlimited            us        ");
  };
  file("/proc/self/status", "CapPrm:\t0000000000000000\nCapEff:\t0000000000000000");
  limits("0", "8388608");
  EXPECT_EQ(severity("priority-limit"), Severity::wrong);
  EXPECT_THAT(one("priority-limit").remedy, HasSubstr("limits.d"));
  EXPECT_THAT(one("memory-limit").is, HasSubstr("8388608"));
  EXPECT_EQ(severity("memory-limit"), Severity::wrong);
  limits("98", "unlimited");
  EXPECT_EQ(severity("priority-limit"), Severity::fine);
  EXPECT_EQ(severity("memory-limit"), Severity::fine);
  limits("79", "0");
  EXPECT_EQ(severity("priority-limit"), Severity::wrong) << "below what a message's threads get";
  EXPECT_EQ(severity("priority-limit", "/proc/self/status", "CapEff:\t0000000000804000"), Severity::fine)
      << "CAP_SYS_NICE";
  EXPECT_EQ(severity("memory-limit"), Severity::fine) << "CAP_IPC_LOCK";
  limits("0", "0");
  file("/proc/self/uid_map", "0 1000 1");
  for (const auto* check : {"priority-limit", "memory-limit"}) {
    EXPECT_EQ(severity(check), Severity::wrong) << "capabilities of a user namespace";
    EXPECT_THAT(one(check).remedy, HasSubstr("docker run --ulimit"));
  }
  fs::remove(root_ + "/proc/self/uid_map");
  file("/proc/self/status", "Uid:\t0\t0\t0\t0\nCapEff:\t00000000a80425fb\nCapBnd:\t00000000a80425fb");
  for (const auto* check : {"priority-limit", "memory-limit"})
    EXPECT_THAT(one(check).remedy,
                AllOf(HasSubstr("docker run --cap-add SYS_NICE"), Not(HasSubstr("limits.d"))));
  file("/proc/self/status", "CapEff:\t0000000000000000");
  file("/proc/self/cgroup", "0::/system.slice/robot.service");
  file("/proc/self/environ", "INVOCATION_ID=1f");
  for (const auto* check : {"priority-limit", "memory-limit"})
    EXPECT_THAT(one(check).remedy, AllOf(HasSubstr("edit 'robot.service'"), HasSubstr("LimitRTPRIO=98"),
                                         HasSubstr("LimitMEMLOCK=infinity"), Not(HasSubstr("limits.d"))));
  file("/proc/self/cgroup", "3:cpu,cpuacct:/user\n0::/user");
  file("/sys/fs/cgroup/cpu,cpuacct/user/cpu.rt_runtime_us", "0");
  EXPECT_THAT(one("priority-budget").remedy, HasSubstr("/sys/fs/cgroup/cpu,cpuacct/user/cpu.rt_runtime_us"));
  EXPECT_EQ(severity("priority-budget"), Severity::wrong);
  file("/sys/fs/cgroup/cpu,cpuacct/user/cpu.rt_runtime_us", "-1");
  EXPECT_EQ(one("priority-budget").is, "unlimited");
}

TEST_F(Machine, HasCpusThatAreFastAndAwake) {
  const std::string cpu0 = "/sys/devices/system/cpu/cpu0/", cpu1 = "/sys/devices/system/cpu/cpu1/";
  file(cpu0 + "cpufreq/scaling_governor", "performance");
  file(cpu1 + "cpufreq/scaling_governor", "powersave");
  EXPECT_THAT(one("governor").is, AllOf(HasSubstr("performance on 1"), HasSubstr("powersave on 1")));
  EXPECT_EQ(severity("governor"), Severity::wrong);
  EXPECT_EQ(severity("governor", cpu1 + "cpufreq/scaling_governor", "performance"), Severity::fine);
  for (const auto* state : {"state0", "state1"}) {
    file(cpu0 + "cpuidle/" + state + "/name", state);
    file(cpu0 + "cpuidle/" + state + "/disable", "0");
  }
  file(cpu0 + "cpuidle/state0/latency", "2");
  file(cpu0 + "cpuidle/state1/latency", "133");
  EXPECT_THAT(one("idle-states").is, AllOf(HasSubstr("state1"), HasSubstr("133")));
  EXPECT_EQ(severity("idle-states"), Severity::hint);
  file("/proc/cpuinfo", "processor\t: 0\nBogoMIPS\t: 108.00\nFeatures\t: fp asimd\nCPU implementer\t: 0x41");
  EXPECT_THAT(one("idle-states").remedy, AllOf(HasSubstr("cpuidle.off=1"), Not(HasSubstr("max_cstate"))));
  file("/proc/cpuinfo", "processor\t: 0\nvendor_id\t: GenuineIntel\nflags\t\t: fpu vme");
  EXPECT_THAT(one("idle-states").remedy, AllOf(HasSubstr("max_cstate=1"), Not(HasSubstr("cpuidle.off"))));
  EXPECT_EQ(severity("idle-states", cpu0 + "cpuidle/state1/disable", "1"), Severity::fine);
  EXPECT_EQ(severity("smt", "/sys/devices/system/cpu/smt/active", "1"), Severity::hint);
  EXPECT_EQ(severity("isolated-cpus", "/sys/devices/system/cpu/isolated", ""), Severity::hint);
  EXPECT_EQ(severity("timer-migration", "/proc/sys/kernel/timer_migration", "1"), Severity::fine);
  EXPECT_EQ(severity("isolated-cpus", "/sys/devices/system/cpu/isolated", "1"), Severity::fine);
  EXPECT_EQ(severity("timer-migration"), Severity::hint);
}

TEST_F(Machine, IsToldWhatItsIsolationLacks) {
  const std::string isolated = "/sys/devices/system/cpu/isolated",
                    tickless = "/sys/devices/system/cpu/nohz_full", command_line = "/proc/cmdline";
  file(isolated, "");
  EXPECT_THAT(found("full-isolation"), IsEmpty());
  file(isolated, "2-3");
  file(command_line, "isolcpus=2-3 quiet");
  EXPECT_THAT(one("full-isolation").is,
              AllOf(HasSubstr("CONFIG_NO_HZ_FULL"), HasSubstr("rcu_nocbs, managed_irq")));
  file(tickless, "(null)");
  EXPECT_EQ(one("full-isolation").is, "CPUs 2-3 are isolated without nohz_full, rcu_nocbs, managed_irq");
  EXPECT_THAT(one("full-isolation").remedy,
              HasSubstr("isolcpus=managed_irq,domain,2-3 nohz_full=2-3 rcu_nocbs=2-3"));
  file(tickless, "3");
  EXPECT_THAT(one("full-isolation").is, HasSubstr("nohz_full")) << "of one of them only";
  file(tickless, "1-3");
  EXPECT_EQ(one("full-isolation").is, "CPUs 2-3 are isolated without managed_irq")
      << "RCU's callbacks went with the tick";
  file(command_line, "isolcpus=managed_irq,domain,2-3 nohz_full=1-3");
  EXPECT_EQ(severity("full-isolation"), Severity::fine);
  file(tickless, "");
  file(command_line, "isolcpus=managed_irq,domain,2-3 rcu_nocbs=all");
  EXPECT_EQ(one("full-isolation").is, "CPUs 2-3 are isolated without nohz_full");
}

TEST_F(Machine, IsReal) {
  file("/proc/cpuinfo", "processor\t: 0\nflags\t\t: fpu tsc");
  EXPECT_THAT(found("virtual-machine"), IsEmpty());
  EXPECT_EQ(severity("virtual-machine", "/proc/cpuinfo", "processor\t: 0\nflags\t\t: fpu tsc hypervisor"),
            Severity::hint);
  EXPECT_EQ(severity("stolen-time", "/proc/stat", "cpu  1000 0 1000 8000 0 0 0 1 0 0"), Severity::fine);
  file("/proc/stat", "cpu  100000 0 100000 6800000 0 0 0 1 0 0");
  EXPECT_THAT(one("stolen-time").is, HasSubstr("0.000014 %"));
  file("/proc/stat", "cpu  1000 0 1000 8000 0 0 0 1000 0 0");
  EXPECT_THAT(one("stolen-time").is, HasSubstr("9.1 %"));
  EXPECT_EQ(severity("stolen-time"), Severity::wrong);
}

TEST_F(Machine, SmallestCpuQuotaIsAWarning) {
  file("/proc/self/cgroup", "0::/a/b");
  file("/sys/fs/cgroup/a/b/cpu.max", "max 100000");
  EXPECT_THAT(found("cpu-quota"), IsEmpty());
  file("/sys/fs/cgroup/a/b/cpu.max", "150000 100000");
  file("/sys/fs/cgroup/a/cpu.max", "50000 100000");
  file("/sys/fs/cgroup/a/cpu.stat", "nr_throttled 54\nthrottled_usec 2700000");
  EXPECT_EQ(severity("cpu-quota"), Severity::hint);
  EXPECT_THAT(one("cpu-quota").is, AllOf(HasSubstr("0.5 CPUs"), HasSubstr("54 stops"), HasSubstr("2.7 s")));
  EXPECT_THAT(one("cpu-quota").remedy, HasSubstr("echo max | sudo tee /sys/fs/cgroup/a/cpu.max"));
}

TEST_F(Machine, KeepsTimeAndMemory) {
  file("/sys/devices/system/clocksource/clocksource0/current_clocksource", "hpet");
  file("/sys/devices/system/clocksource/clocksource0/available_clocksource", "hpet acpi_pm");
  EXPECT_THAT(one("clock-source").remedy, HasSubstr("hpet acpi_pm"));
  EXPECT_EQ(severity("clock-source"), Severity::wrong);
  EXPECT_EQ(
      severity("clock-source", "/sys/devices/system/clocksource/clocksource0/current_clocksource", "tsc"),
      Severity::fine);
  synchronised_ = false;
  EXPECT_EQ(severity("clock"), Severity::hint);
  synchronised_ = true;
  EXPECT_EQ(severity("clock"), Severity::fine);
  EXPECT_EQ(severity("swap", "/proc/swaps", "Filename\tType\tSize\tUsed\tPriority"), Severity::fine);
  EXPECT_EQ(
      severity("swap", "/proc/swaps", "Filename\tType\tSize\tUsed\tPriority\n/dev/sda2 partition 1 0 -2"),
      Severity::hint);
  EXPECT_EQ(severity("huge-pages", "/sys/kernel/mm/transparent_hugepage/enabled", "always [madvise] never"),
            Severity::fine);
  EXPECT_EQ(severity("huge-pages", "/sys/kernel/mm/transparent_hugepage/enabled", "[always] madvise never"),
            Severity::hint);
  EXPECT_EQ(severity("numa-balancing", "/proc/sys/kernel/numa_balancing", "1"), Severity::hint);
  EXPECT_EQ(severity("compaction", "/proc/sys/vm/compact_unevictable_allowed", "0"), Severity::fine);
  EXPECT_EQ(severity("compaction", "/proc/sys/vm/compact_unevictable_allowed", "1"), Severity::hint);
  EXPECT_EQ(severity("autogroup", "/proc/sys/kernel/sched_autogroup_enabled", "1"), Severity::hint);
}

// By `ontime tune apply`.
void expect_accepted(const std::string& command) {
  std::istringstream words(command);
  for (std::string word; words >> word;)
    if (const auto equals = word.find('='); equals != word.npos) {
      const auto keys = conditions::keys();
      const auto key = std::ranges::find(keys, "kernel." + word.substr(0, equals), &conditions::Key::path);
      ASSERT_NE(key, keys.end()) << word;
      conditions::Run run;
      EXPECT_NO_THROW(key->set(run, word.substr(equals + 1))) << word;
    }
}

TEST_F(Machine, BufferAdviceIsAcceptedAndLowersNothing) {
  file("/proc/sys/net/core/rmem_max", "212992");
  file("/proc/sys/net/core/wmem_max", "212992");
  EXPECT_THAT(one("buffers").remedy, HasSubstr("wmem-max"));
  expect_accepted(one("buffers").remedy);
  file("/proc/sys/net/core/wmem_max", "8388608");
  EXPECT_THAT(one("buffers").remedy, Not(HasSubstr("wmem-max")));
}

TEST_F(Machine, TakesPacketsIn) {
  EXPECT_EQ(severity("buffers", "/proc/sys/net/core/rmem_max", "212992"), Severity::hint);
  EXPECT_EQ(severity("buffers", "/proc/sys/net/core/rmem_max", "8388608"), Severity::fine);
  EXPECT_EQ(severity("fragments", "/proc/sys/net/ipv4/ipfrag_high_thresh", "262144"), Severity::hint);

  file("/sys/class/net/lo/threaded", "1");  // no hardware: not looked at unless it is named
  file("/sys/class/net/eth0/threaded", "0");
  file("/sys/devices/pci/card/msi_irqs/41", "msix");
  fs::create_directories(root_ + "/sys/devices/pci/card/virtio0");
  fs::create_directory_symlink("../../../devices/pci/card/virtio0", root_ + "/sys/class/net/eth0/device");
  file("/proc/irq/41/effective_affinity_list", "1");
  thread(7, "irq/41-eth0-rx-0", SCHED_FIFO, 50);
  EXPECT_EQ(one("interrupts").is, "eth0: 41 on CPU 1, thread at SCHED_FIFO 50");
  fs::remove_all(root_ + "/sys/devices/pci/card/msi_irqs");
  EXPECT_THAT(found("interrupts"), IsEmpty());
  file("/proc/interrupts",
       "      CPU0  CPU1\n 43:   0   9  GICv2 189 Level  eth0\n 44: 1 0  GICv2 190 Level  eth01\n");
  file("/proc/irq/43/effective_affinity_list", "0");
  EXPECT_EQ(one("interrupts").is, "eth0: 43 on CPU 0");  // a board's own card
  // By the name of its device; and of a bond those of the interfaces below it.
  fs::create_directories(root_ + "/sys/devices/soc/30be0000.ethernet");
  fs::create_directories(root_ + "/sys/class/net/eth1");
  fs::create_directory_symlink("../../../devices/soc/30be0000.ethernet",
                               root_ + "/sys/class/net/eth1/device");
  file("/proc/interrupts",
       " 43: 0 9 GICv2 189 Level eth0\n 51: 0 9 GICv3 150 Level 30be0000.ethernet\n 52: 1 0 GICv3 151 Level "
       "40be0000.ethernet\n 53: 0 9 GICv3 152 Level 30be0000.ethernet-tx0\n");
  file("/proc/irq/51/effective_affinity_list", "0");
  file("/proc/irq/53/effective_affinity_list", "1");
  interfaces_ = {"eth1"};
  EXPECT_EQ(one("interrupts").is, "eth1: 51 on CPU 0; 53 on CPU 1");
  for (const auto* below : {"eth0", "eth1"})
    fs::create_directories(root_ + "/sys/class/net/bond0/lower_" + below);
  interfaces_ = {"bond0"};
  EXPECT_EQ(one("interrupts").is, "bond0: 43 on CPU 0; 51 on CPU 0; 53 on CPU 1");
  fs::remove_all(root_ + "/sys/class/net/eth1");
  interfaces_ = {"eth0"};
  fs::rename(root_ + "/sys/class/net/eth0/device", root_ + "/sys/class/net/eth0/elsewhere");
  EXPECT_THAT(found("interrupts"), IsEmpty()) << "a veth of that name";
  fs::rename(root_ + "/sys/class/net/eth0/elsewhere", root_ + "/sys/class/net/eth0/device");
  interfaces_ = {};
  file("/sys/devices/pci/card/irq", "41");
  EXPECT_EQ(one("interrupts").is, "eth0: 41 on CPU 1, thread at SCHED_FIFO 50");  // wired
  EXPECT_EQ(severity("napi"), Severity::fine);
  file("/sys/class/net/eth0/threaded", "1");
  thread(8, "napi/eth0-8193", SCHED_OTHER, 0);
  EXPECT_THAT(one("napi").remedy, HasSubstr("napi-threads=60 --interface eth0"));
  EXPECT_EQ(severity("napi"), Severity::wrong);
  thread(8, "napi/eth0-8193", SCHED_FIFO, 60);
  EXPECT_THAT(one("napi").is, HasSubstr("SCHED_FIFO 60"));
  EXPECT_EQ(severity("napi"), Severity::fine);
  thread(10, "napi/eth0-8194", SCHED_OTHER, 0, false);
  EXPECT_EQ(severity("napi"), Severity::fine) << "a program may have any name";
  interfaces_ = {"lo"};
  EXPECT_THAT(one("napi").is, HasSubstr("no threads"));
  EXPECT_EQ(severity("napi"), Severity::fine) << "as of a card that is down";
  // As before Linux 5.17, which cut the names of threads.
  interfaces_ = {"enp129s0f0"};
  file("/sys/class/net/enp129s0f0/threaded", "1");
  thread(9, "napi/enp129s0f0", SCHED_FIFO, 60);
  EXPECT_EQ(one("napi").is, "enp129s0f0: threaded, SCHED_FIFO 60");

  EXPECT_THAT(found("irqbalance"), IsEmpty());
  thread(900, "irqbalance", SCHED_OTHER, 0, false);
  EXPECT_THAT(found("irqbalance"), IsEmpty())
      << "its program cannot be read, and nothing tells that it is root's";
  file("/proc/900/status", "Name:\tirqbalance\nUid:\t1000\t1000\t1000\t1000\n");
  EXPECT_THAT(found("irqbalance"), IsEmpty()) << "another user's";
  file("/proc/900/status", "Name:\tirqbalance\nUid:\t0\t0\t0\t0\n");
  EXPECT_EQ(severity("irqbalance"), Severity::hint);
  fs::create_symlink("/usr/sbin/irqbalance (deleted)", root_ + "/proc/900/exe");
  EXPECT_EQ(severity("irqbalance"), Severity::hint);
  fs::remove(root_ + "/proc/900/exe");
  fs::create_symlink("/usr/bin/python3", root_ + "/proc/900/exe");
  EXPECT_THAT(found("irqbalance"), IsEmpty()) << "its name alone";
  thread(901, "irqbalance-ui", SCHED_OTHER, 0, false);
  EXPECT_THAT(found("irqbalance"), IsEmpty());
}

TEST_F(Machine, HasMiddlewaresWithKnownFaults) {
  file("/usr/lib/x86_64-linux-gnu/libddsc.so.0.10.2", "");
  file("/usr/lib/x86_64-linux-gnu/libddsc.so.0debian", "");
  file("/opt/ros/jazzy/lib/libfastrtps.so.2.14.1", "");
  file("/opt/ros/jazzy/lib/libfastrtps.so.2.14", "");  // a link to it
  const auto all = found("middleware");
  ASSERT_THAT(all, SizeIs(2));
  EXPECT_THAT(all[0].is, HasSubstr("Cyclone DDS 0.10.2"));
  EXPECT_EQ(all[0].severity, Severity::hint);
  EXPECT_THAT(all[1].is, HasSubstr("Fast DDS 2.14.1 (/opt/ros/jazzy/lib)"));
  EXPECT_EQ(all[1].severity, Severity::fine);
}

TEST_F(Machine, NonsenseInFilesGivesNoFinding) {
  for (const auto* path :
       {"/proc/self/limits", "/proc/self/status", "/proc/self/cgroup", "/proc/stat", "/proc/cpuinfo",
        "/proc/sys/kernel/sched_rt_runtime_us", "/proc/sys/net/core/rmem_max", "/proc/1/stat",
        "/sys/devices/system/cpu/cpu0/cpuidle/state0/latency", "/sys/class/net/eth0/threaded",
        "/sys/kernel/debug/sched/preempt"})
    file(path, fmt::format("\xff(:x {:)>100}", ""));
  interfaces_ = {"eth0", "../../etc", ""};
  EXPECT_THAT(check({root_, interfaces_, {}}), Not(IsEmpty()));
}

TEST_F(Machine, IsFitIfNothingIsWrong) {
  EXPECT_TRUE(fit({}));
  EXPECT_TRUE(fit({{Severity::hint, "", "", "", ""}}));
  EXPECT_FALSE(fit({{Severity::fine, "", "", "", ""}, {Severity::wrong, "", "", "", ""}}));
}

TEST(ThisMachine, EachFindingHasAReasonAndAFix) {
  for (const auto& finding : check({"", {}, false})) {
    EXPECT_FALSE(finding.check.empty() || finding.is.empty());
    const bool said = !finding.why.empty() && !finding.remedy.empty();
    EXPECT_TRUE(finding.severity == Severity::fine || said) << finding.check;
  }
}

TEST(Counts, OneIsNotPlural) {
  const Finding error{Severity::wrong, "", "", "", ""}, warning{Severity::hint, "", "", "", ""};
  EXPECT_EQ(fitness::counts_of({error, warning, warning}), "1 error, 2 warnings");
  EXPECT_EQ(fitness::counts_of({{}, warning}), "0 errors, 1 warning");
}

}  // namespace
}  // namespace ontime::fitness

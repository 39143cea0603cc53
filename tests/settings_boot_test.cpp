// SPDX-License-Identifier: Apache-2.0
// Plans, warnings, and the files that apply settings at every boot.
#include <fstream>
#include <memory>

#include <sys/prctl.h>
#include <sys/stat.h>

#include "own_run.hpp"
#include "settings/kinds.hpp"
#include "settings_fixture.hpp"

namespace ontime::settings {
namespace {

using test::error_of;
using test::in_child;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::StartsWith;

TEST(Paper, WarnsOfWhatIsAboveTheApplication) {
  EXPECT_THAT(warning(paper(), 80),
              AllOf(StartsWith("irq-threads 90: above the application's 80"), HasSubstr("measure")));
  EXPECT_THAT(warning({{"ksoftirqd", "0=60,1=85"}}, 80), StartsWith("ksoftirqd"));
  EXPECT_EQ(warning({{"ksoftirqd", "60"}}, 80), "");
  EXPECT_EQ(warning({{"ksoftirqd", "0=60,90=2"}}, 80), "") << "CPU 90 is no priority";
  EXPECT_THAT(warning({{"ksoftirqd", "1"}}, 0), HasSubstr("SCHED_OTHER"));
}

TEST(Boot, IsSaidForSystemdTmpfilesAndAShell) {
  const Link link{"eth0", ""};
  const Wishes wishes{{"ksoftirqd", "60"}, {"busy-poll", "50"}};
  const std::vector<Change> changes = {
      {&setting("busy-poll"), {&network_sysctl, "net/core/busy_poll"}, "0", "50"},
      {&setting("ksoftirqd"), {&thread_priority, "14:25:ksoftirqd/0"}, "other:0", "fifo:60"},
      {&setting("napi-threads"), {&thread, "90:25:napi/eth0-8193"}, "other:0:0-1", "fifo:60:0-1"},
      {&setting("rps"), {&steering, "3:eth0/rx-0"}, "none", "0-1,33"}};
  EXPECT_THAT(
      at_every_boot(Form::systemd, wishes, changes, link, {"/usr/bin/env"}),
      AllOf(HasSubstr("ExecStart=/usr/bin/env tune apply --set busy-poll=50 --set ksoftirqd=60 --interface "
                      "eth0\n"),
            HasSubstr("ExecStop=/usr/bin/env tune revert\n")));
  EXPECT_EQ(at_every_boot(Form::tmpfiles, wishes, {changes[0], changes[3]}, link, {}),
            "# /etc/tmpfiles.d/ontime.conf\nw /proc/sys/net/core/busy_poll - - - - 50\n"
            "w /sys/class/net/eth0/queues/rx-0/rps_cpus - - - - 00000002,00000003\n");
  EXPECT_THAT(error_of([&] { at_every_boot(Form::tmpfiles, wishes, changes, link, {}); }),
              StartsWith("ksoftirqd: "));
  const auto script = at_every_boot(Form::shell, wishes, changes, link, {});
  EXPECT_THAT(script,
              AllOf(HasSubstr("echo '50' > '/proc/sys/net/core/busy_poll'\n"),
                    HasSubstr("$(threads 'ksoftirqd/0'); do chrt --fifo --pid 60 \"$pid\"; done\n"),
                    HasSubstr("$(threads 'napi/eth0-[0-9]*'); do chrt --fifo --pid 60 \"$pid\"; done\n")));
}

// The number of an interrupt may be another device's at the next boot.
TEST(Boot, NoFormHasTheNumberOfAnInterrupt) {
  const std::vector<Change> changes = {{&setting("irq-cpus"), {&interrupt, "37:PCI-MSI 524288"}, "0-1", "0"}};
  for (const auto form : {Form::tmpfiles, Form::shell})
    EXPECT_THAT(error_of([&] {
                  at_every_boot(form, {{"irq-cpus", "0"}}, changes, {"eth0", ""}, {});
                }),
                AllOf(StartsWith("irq-cpus: "), HasSubstr("Fix: --print systemd")));
}

// A driver refuses a parameter that it does not support, with its present value, too.
TEST(Boot, ScriptSetsOnlyWhatWasAsked) {
  const std::string before = "rx-usecs=3,rx-frames=0,tx-usecs=5,tx-frames=0,adaptive-rx=on,adaptive-tx=off";
  const auto script = at_every_boot(
      Form::shell,
      {{"coalescing", "rx-frames=1,adaptive-rx=off"}, {"napi-cpus", "0"}, {"napi-threads", "60"}},
      {{&setting("coalescing"),
        {&coalescing, "3:eth0"},
        before,
        with_coalescing(before, "rx-frames=1,adaptive-rx=off")},
       {&setting("napi-cpus"), {&thread, "90:25:napi/eth0-8193"}, "other:0:0-1", "other:0:0"},
       {&setting("napi-threads"), {&thread, "91:25:napi/eth1-8193"}, "other:0:0-1", "fifo:60:0-1"}},
      {"eth0", ""}, {});
  EXPECT_THAT(
      script,
      AllOf(HasSubstr("ethtool --coalesce 'eth0' rx-frames 1 adaptive-rx off\n"),
            HasSubstr("$(threads 'napi/eth0-[0-9]*'); do taskset --cpu-list --pid 0 \"$pid\"; done\n"),
            HasSubstr("$(threads 'napi/eth1-[0-9]*'); do chrt --fifo --pid 60 \"$pid\"; done\n")));
}

TEST(Plan, APriorityOfOneCpuConcernsNoOther) {
  const auto threads = [](const std::string& asked) {
    std::vector<std::string> titles;
    for (const auto& change : plan({{"ksoftirqd", asked}}, {})) titles.push_back(change.thing.title());
    return titles;
  };
  try {
    EXPECT_THAT(threads("0=60"), ElementsAre("ksoftirqd/0"));
    EXPECT_EQ(threads("60").size(), online_cpus().size());
  } catch (const Error& error) {
    GTEST_SKIP() << error.what();
  }
}

TEST(Boot, NetworkNamespaceIsRefusedInEveryForm) {
  for (const auto form : {Form::systemd, Form::tmpfiles, Form::shell})
    EXPECT_THROW(at_every_boot(form, {{"gro", "off"}}, {}, {"eth0", "robot"}, {"/usr/bin/env"}), WrongInput);
}

TEST(Plan, UnknownCpusAndInterfacesAreWrongInput) {
  EXPECT_THROW(setting("rps").wanted("1000", {&steering, "3:eth0/rx-0"}, "none"), Unknown);
  EXPECT_THROW(plan({{"rps", "0"}}, {"nonet0", ""}), WrongInput);
  EXPECT_THROW(show({"nonet0", ""}), WrongInput);
}

// Any user has a network namespace with interfaces, and so threads, of any name.
TEST(Boot, NamesWithSpecialCharactersAreRefusedOrEscaped) {
  const auto script_for = [](const std::string& name) {
    return at_every_boot(Form::shell, {},
                         {{&setting("napi-threads"), {&thread, "90:25:" + name}, "other:0:0", "fifo:60:0"}},
                         {}, {});
  };
  for (const char bad : std::string("';`$\"\\*[( \n"))
    EXPECT_THAT(script_for(std::string("napi/eth0") + bad + "-12"),
                HasSubstr("$(threads 'napi/eth0.-[0-9]*');"));
  EXPECT_THAT(script_for("napi/eth0.5-12"), HasSubstr("$(threads 'napi/eth0[.]5-[0-9]*');"));
  EXPECT_THAT(script_for("irq/41-ahci[0000"), HasSubstr("$(threads 'irq/[0-9]+-ahci.0000');"));
  EXPECT_THAT(error_of([] { plan({{"rps", "0"}}, {"e';reboot;'", ""}); }), HasSubstr("interface name"));
}

TEST(Boot, SystemdUnitNeedsPlainWordsAndAProgramOfRoot) {
  const auto refused_of = [](const Link& link, const std::string& program) {
    return error_of([&] { at_every_boot(Form::systemd, {{"ksoftirqd", "60"}}, {}, link, {program}); });
  };
  EXPECT_EQ(refused_of({}, "/usr/bin/env"), "");
  for (const std::string bad : {"eth0\nExecStartPre=/tmp/x", "a b", "%h", "$x", "'"}) {
    EXPECT_THAT(refused_of({bad, ""}, "/usr/bin/env"), HasSubstr("cannot be"));
    EXPECT_THAT(refused_of({}, "/usr/bin/" + bad), HasSubstr("cannot be"));
  }
  EXPECT_THAT(refused_of({}, "/usr/bin/none"), HasSubstr("install"));
  EXPECT_THAT(refused_of({}, "/tmp/none"), HasSubstr("install"));
  EXPECT_NO_THROW(at_every_boot(Form::systemd, {{"ksoftirqd", "60"}}, {}, {}, {"/tmp/none", false}))
      << "that of another machine cannot be judged here";
  if (geteuid() != 0) return;
  std::string folder = "/var/ontime-settings-test-XXXXXX";
  ASSERT_NE(mkdtemp(folder.data()), nullptr);
  const auto program = folder + "/ontime";
  std::ofstream(program) << "x";
  EXPECT_EQ(refused_of({}, program), "");
  for (const auto& [path, mode] : {std::pair(folder, 0777), std::pair(program, 0775)}) {
    ASSERT_EQ(chown(path.c_str(), 0, 12345), 0);
    ASSERT_EQ(chmod(path.c_str(), mode), 0);
    EXPECT_THAT(refused_of({}, program), AllOf(HasSubstr(path), HasSubstr("install")));
    ASSERT_EQ(chmod(path.c_str(), 0755), 0);
  }
  ASSERT_EQ(chown(program.c_str(), 12345, 0), 0);
  EXPECT_THAT(refused_of({}, program), HasSubstr("install"));
  std::filesystem::remove_all(folder);
}

TEST(Boot, ScriptFindsKernelThreadsByTheirWholeName) {
  const auto script = at_every_boot(
      Form::shell, {},
      {{&setting("ksoftirqd"), {&thread_priority, "14:25:ksoftirqd/0"}, "other:0", "fifo:60"}}, {}, {});
  const auto begin = script.find("threads()"), end = script.find("for pid");
  const auto found = [&](const std::string& pattern) {
    const auto command = script.substr(begin, end - begin) + "threads '" + pattern + "' | wc -l";
    const std::unique_ptr<FILE, int (*)(FILE*)> pipe(popen(command.c_str(), "r"), pclose);
    int count = -1;
    EXPECT_EQ(std::fscanf(pipe.get(), "%d", &count), 1);
    return count;
  };
  if (found("kthreadd|ksoftirqd/0") == 0) GTEST_SKIP() << "the kernel's threads are not to be seen from here";
  in_child([&] {
    prctl(PR_SET_NAME, "ksoftirqd/0");
    EXPECT_EQ(found("ksoftirqd/0"), 1) << "a process with that name is not counted";
    EXPECT_EQ(found("softirqd/0"), 0);
  });
}

}  // namespace
}  // namespace ontime::settings

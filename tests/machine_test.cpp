// SPDX-License-Identifier: Apache-2.0
#include "machine/machine.hpp"

#include <algorithm>
#include <random>
#include <string>
#include <vector>

#include <arpa/inet.h>
#include <fcntl.h>
#include <gmock/gmock.h>
#include <netinet/in.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include "machine/clock.hpp"
#include "machine/command.hpp"
#include "machine/proc.hpp"
#include "own_run.hpp"

namespace ontime::machine {
namespace {

using test::error_of;
using test::in_child;
using ::testing::AllOf;
using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;

[[maybe_unused]] const auto* const own_run = ::testing::AddGlobalTestEnvironment(new test::OwnRun);

// --- what /proc says

TEST(Proc, TicksAndStalls) {
  Activity activity;
  parse_ticks("cpu  10 20 30 400 50 6 7 8 9 10\ncpu0 1 1 1 1 1 1 1 1 1 1\n", activity);
  EXPECT_EQ(activity.total_ticks, 531u);
  EXPECT_EQ(activity.busy_ticks, 81u);
  EXPECT_EQ(activity.stolen_ticks, 8u);
  EXPECT_EQ(parse_stall("some avg10=0.00 avg60=1.00 avg300=0.00 total=123\nfull avg10=0.00 total=7\n"), 123);
  for (const auto* text : {"", "full total=1", "some avg10=0.00", "some total=x"})
    EXPECT_EQ(parse_stall(text), -1);
}

TEST(Proc, PreemptionBySurestWord) {
  const std::string debian = "#1 SMP PREEMPT_DYNAMIC Debian 6.1.0-1 (2023)";
  EXPECT_EQ(preemption("1\n", {}, "", debian), "rt");
  EXPECT_EQ(preemption({}, {}, "", "#1 SMP PREEMPT_RT Debian"), "rt");
  EXPECT_EQ(preemption("0\n", "none (voluntary) full\n", "preempt=full", debian), "voluntary");
  EXPECT_EQ(preemption({}, "none voluntary full (lazy)\n", "", debian), "lazy");
  EXPECT_EQ(preemption({}, {}, "quiet preempt=full ro", debian), "full");
  EXPECT_EQ(preemption({}, {}, "preempt=voluntary ro preempt=full", debian), "full") << "the last one counts";
  EXPECT_EQ(preemption({}, {}, "nopreempt=full", debian), "dynamic");
  EXPECT_EQ(preemption({}, {}, "", "#1 SMP PREEMPT Mon"), "full");
  EXPECT_EQ(preemption({}, {}, "", "#1 SMP Mon"), "none or voluntary");
  EXPECT_FALSE(preemption({}, {}, "", ""));
  EXPECT_EQ(preemption({}, ")(", "", "#1 SMP Mon"), "none or voluntary");
}

TEST(Proc, CgroupsFromTheInnermostOut) {
  const std::string text = "4:memory:/a/b\n3:cpu,cpuacct:/c\n1:name=systemd:/x\n0::/d:e/f\n";
  EXPECT_THAT(cgroups_of(text, "memory"), ElementsAre("/a/b", "/a", ""));
  EXPECT_THAT(cgroups_of(text, "cpuacct"), ElementsAre("/c", ""));
  EXPECT_THAT(cgroups_of(text, ""), ElementsAre("/d:e/f", "/d:e", ""));
  EXPECT_THAT(cgroups_of("0::/\n", ""), ElementsAre(""));
  EXPECT_THAT(cgroups_of(text, "mem"), IsEmpty());
  EXPECT_THAT(cgroups_of("nonsense", ""), IsEmpty());
}

// --- this machine

TEST(Describe, SaysEverythingAndGuessesNothing) {
  const auto machine = describe();
  for (const auto* key :
       {"hostname", "simulated", "kernel_release", "kernel_version", "kernel_command_line", "preemption",
        "rt_runtime_us", "rt_period_us", "autogroup", "boot_id", "clock", "cpu_model", "cpu_count",
        "isolated_cpus", "governor", "clocksource", "virtual_machine", "memory_bytes", "limits"})
    EXPECT_TRUE(machine.contains(key)) << key;
  for (const auto* key : {"rtprio", "memlock_bytes", "cgroup_memory_bytes"})
    EXPECT_TRUE(machine["limits"].contains(key)) << key;
  EXPECT_EQ(machine["kernel_release"], word(text_of("/proc/sys/kernel/osrelease")));
  EXPECT_EQ(machine["hostname"], word(text_of("/proc/sys/kernel/hostname")));
  EXPECT_GE(machine["cpu_count"], 1);
  EXPECT_GT(machine["memory_bytes"], 0);
  for (const auto& [key, value] : machine.items())
    EXPECT_TRUE(value.dump() != "\"\"" || key == "isolated_cpus") << key << " is empty, not null";
}

TEST(Describe, AMachineOfTheLabSaysSo) {
  EXPECT_EQ(simulated("quiet " + simulated_by("QEMU 7.2.22, e1000e") + " panic=-1"), "QEMU 7.2.22, e1000e");
  EXPECT_FALSE(simulated("quiet panic=-1"));
}

TEST(Describe, LimitsAreThisProcesss) {
  in_child([] {
    const rlimit limit{4096, 4096};
    ASSERT_EQ(setrlimit(RLIMIT_MEMLOCK, &limit), 0);
    EXPECT_EQ(describe()["limits"]["memlock_bytes"], 4096);
  });
}

TEST(ActivityBetween, IsAShare) {
  const Activity first{100, 1000, 10, 0, -1, 5000, 1'000'000'000, 0, 0};
  const Activity last{125, 1100, 15, 250'000, -1, 9'000'000, 2'000'000'000, 1'000'000'000, 1'000'000'000};
  const auto share = between(first, last);
  EXPECT_EQ(share["cpu_busy"], 0.25);
  EXPECT_EQ(share["cpu_stolen"], 0.05);
  EXPECT_EQ(share["cpu_pressure"], 0.25);
  EXPECT_TRUE(share["memory_pressure"].is_null());
  EXPECT_EQ(share["io_pressure"], 1.0);
  EXPECT_EQ(share["suspended_s"], 0);
  EXPECT_EQ(share["clock_moved_s"], 0);
}

TEST(ActivityBetween, TellsASleepFromAClockThatWasSet) {
  constexpr std::int64_t s = 1'000'000'000;
  Activity first, last;
  last.at_ns = 10 * s;
  last.boot_ns = last.realtime_ns = 70 * s;
  EXPECT_EQ(between(first, last)["suspended_s"], 60);
  EXPECT_EQ(between(first, last)["clock_moved_s"], 0);
  last.boot_ns = 10 * s;
  last.realtime_ns = -3590 * s;
  EXPECT_EQ(between(first, last)["suspended_s"], 0);
  EXPECT_EQ(between(first, last)["clock_moved_s"], -3600);
}

TEST(ActivityBetween, SlewedClockRunsFastOrSlowBesideTheHardwares) {
  constexpr std::int64_t s = 1'000'000'000;
  Activity first, last;
  last.raw_ns = 10 * s;
  last.at_ns = last.boot_ns = last.realtime_ns = 10 * s + s / 100;
  EXPECT_EQ(between(first, last)["clock_slew_ppm"], 1000);
  EXPECT_EQ(between(first, last)["clock_moved_s"], 0) << "all three are slewed alike";
  last.at_ns = 10 * s - s / 100;
  EXPECT_EQ(between(first, last)["clock_slew_ppm"], -1000);
}

TEST(ActivityBetween, NothingWhereNoTimePassed) {
  const auto now = activity();
  for (const auto& share : between(now, now)) EXPECT_TRUE(share.is_null());
  EXPECT_GT(now.total_ticks, 0u);
  EXPECT_GE(now.total_ticks, now.busy_ticks);
  EXPECT_GT(now.at_ns, 0);
  EXPECT_GT(now.raw_ns, 0);
}

TEST(ActivityBetween, IsAlwaysAShareOrNothing) {
  std::mt19937_64 random(1);
  for (int round = 0; round < 2000; ++round) {
    const auto some = [&] { return random() >> (random() % 64); };
    const auto stall = [&] { return static_cast<std::int64_t>(some() >> 1) - 1; };
    const Activity first{some(), some(), some(), stall(), stall(), stall(), stall()};
    const Activity last{some(), some(), some(), stall(), stall(), stall(), stall()};
    const auto shares = between(first, last);
    for (const auto& [key, share] : shares.items())
      EXPECT_TRUE(key.ends_with("_s") || share.is_null() || (share >= 0.0 && share <= 1.0)) << key << share;
  }
}

TEST(GroupMemory, CountsPagesOfFilesWithThoseOfGroupsWithin) {
  EXPECT_EQ(parse_file_pages("anon 5\ninactive_file 30\nactive_file 12\nslab 7\n"), 42U) << "version 2";
  EXPECT_EQ(parse_file_pages("cache 9\ninactive_file 1\nactive_file 2\ntotal_cache 9\ntotal_inactive_file 4\n"
                             "total_active_file 5\n"),
            9U)
      << "version 1";
  EXPECT_EQ(parse_file_pages("nonsense"), 0U);
  EXPECT_EQ((GroupMemory{10, 4}.left_bytes()), 6U);
  EXPECT_EQ((GroupMemory{10, 11}.left_bytes()), 0U);
}

TEST(Interfaces, AreFoundByTheirAddresses) {
  EXPECT_EQ(interface_with("127.0.0.1"), "lo");
  EXPECT_EQ(interface_with("192.0.2.77"), std::nullopt);
  EXPECT_EQ(interface_with("nonsense"), std::nullopt);
}

TEST(Interfaces, LoopbackIsOneAndNoNameComesTwice) {
  auto all = interfaces();
  const auto loopback =
      std::find_if(all.begin(), all.end(), [](const Interface& one) { return one.loopback; });
  ASSERT_NE(loopback, all.end());
  EXPECT_EQ(loopback->name, "lo");
  EXPECT_THAT(loopback->addresses, Each(StartsWith("127.")));
  std::vector<std::string> names;
  std::transform(all.begin(), all.end(), std::back_inserter(names),
                 [](const Interface& one) { return one.name; });
  std::sort(names.begin(), names.end());
  EXPECT_EQ(std::unique(names.begin(), names.end()), names.end());
}

// --- the clock

TEST(Clock, IsAsDescribed) {
  const auto clock = clock_state();
  for (const auto* key : {"synchronised", "source", "error_ns", "reference", "realtime_offset_ns"})
    EXPECT_TRUE(clock.contains(key)) << key;
  EXPECT_EQ(clock["synchronised"], !clock["source"].is_null());
  EXPECT_TRUE(clock["synchronised"] == true || clock["error_ns"].is_null());
  timespec realtime{}, monotonic{};
  clock_gettime(CLOCK_REALTIME, &realtime);
  clock_gettime(CLOCK_MONOTONIC, &monotonic);
  const auto offset_s = clock["realtime_offset_ns"].get<std::int64_t>() / 1'000'000'000;
  EXPECT_NEAR(static_cast<double>(offset_s), static_cast<double>(realtime.tv_sec - monotonic.tv_sec), 2);
}

TEST(Clock, ChronyReportsSourceAndError) {
  const std::string good =
      "C0A80001,server.lan,3,1700000000.123456789,-0.000012000,0.000001,0.00002,-12.3,0.001,0.02,0.000400000,"
      "0.000100000,64.2,Normal\n";
  const auto clock = parse_chrony(good);
  ASSERT_TRUE(clock);
  EXPECT_TRUE(clock->synchronised);
  EXPECT_EQ(clock->error_ns, 312'000) << "offset, dispersion and half of the delay";
  EXPECT_EQ(clock->reference, "server.lan");
  const auto with = [&](const std::string& what, const std::string& instead) {
    auto text = good;
    return text.replace(text.find(what), what.size(), instead);
  };
  for (const auto& text : {with("Normal", "Not synchronised"), with("C0A80001", "7F7F0101")}) {
    ASSERT_TRUE(parse_chrony(text)) << text;
    EXPECT_FALSE(parse_chrony(text)->synchronised) << text;
    EXPECT_FALSE(parse_chrony(text)->error_ns) << text;
  }
  for (const auto& text : {std::string(), std::string("506 Cannot talk to daemon\n"), with(",Normal", ""),
                           with("-0.000012000", "x"), with("0.000400000", "nan")})
    EXPECT_FALSE(parse_chrony(text)) << text;
  EXPECT_FALSE(parse_chrony(with("0.000400000", "1e300"))->error_ns);
}

TEST(Clock, PtpReportsGrandmasterAndError) {
  const std::string good =
      "sending: GET CURRENT_DATA_SET\n"
      "sending: GET PARENT_DATA_SET\n"
      "\tec4670.fffe.0a1b2c-0 seq 0 RESPONSE MANAGEMENT CURRENT_DATA_SET \n"
      "\t\tstepsRemoved     1\n\t\toffsetFromMaster -23.0\n\t\tmeanPathDelay    1287.0\n"
      "\tec4670.fffe.0a1b2c-0 seq 1 RESPONSE MANAGEMENT PARENT_DATA_SET \n"
      "\t\tparentPortIdentity                    507c6f.fffe.123456-1\n"
      "\t\tgrandmasterPriority1                  128\n"
      "\t\tgrandmasterIdentity                   507c6f.fffe.123456\n";
  const auto clock = parse_ptp(good);
  ASSERT_TRUE(clock);
  EXPECT_TRUE(clock->synchronised);
  EXPECT_EQ(clock->error_ns, 1310);
  EXPECT_EQ(clock->reference, "507c6f.fffe.123456");
  for (const auto* missing : {"stepsRemoved", "offsetFromMaster", "meanPathDelay", "grandmasterIdentity"}) {
    auto text = good;
    EXPECT_FALSE(parse_ptp(text.replace(text.find(missing), 4, "x"))) << missing;
  }
  EXPECT_FALSE(parse_ptp(""));
  EXPECT_FALSE(parse_ptp("sending: GET CURRENT_DATA_SET\n"));
}

TEST(Answer, IsThereInTimeOrNotAtAll) {
  using namespace std::chrono_literals;
  EXPECT_EQ(answer_of({"echo", "a b"}, 60s), "a b\n");
  EXPECT_TRUE(answer_of({"seq", "20000"}, 60s).value_or("").ends_with("\n20000\n")) << "to its end";
  EXPECT_FALSE(answer_of({"false"}, 60s));
  EXPECT_FALSE(answer_of({"sleep", "1000"}, 1ms));
  EXPECT_FALSE(answer_of({"/there/is/none"}, 60s));
}

// --- what went over a link, and what did not

TEST(TrafficOf, AnInterface) {
  const std::string text =
      "Inter-|   Receive                                                |  Transmit\n"
      " face |bytes    packets errs drop fifo frame compressed multicast|bytes    packets errs drop fifo "
      "colls carrier compressed\n"
      "    lo: 99 1 0 0 0 0 0 0 99 1 0 0 0 0 0 0\n"
      "  eth0:18446744073709551615 5000000000 1 2 3 4 5 6 7000000000 8 9 10 11 12 13 14\n";
  const auto eth0 = parse_traffic(text, "eth0");
  ASSERT_TRUE(eth0);
  EXPECT_EQ(eth0->received_bytes, 18446744073709551615U);
  EXPECT_EQ(eth0->received_packets, 5'000'000'000U);
  EXPECT_EQ(eth0->sent_bytes, 7'000'000'000U);
  EXPECT_EQ(eth0->sent_packets, 8U);
  for (const auto* name : {"eth", "eth1", "face", "", "Inter-|"})
    EXPECT_FALSE(parse_traffic(text, name)) << name;
  EXPECT_FALSE(parse_traffic("", "lo"));
  EXPECT_FALSE(traffic("no-such-link"));
}

TEST(DropsOf, EachPlaceAreRead) {
  const std::string dev =
      "Inter-|   Receive  |  Transmit\n face |bytes ...\n"
      "  eth0: 1 2 3 40 5 6 7 8 9 10 11 120 13 14 15 16\n    lo: 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16\n";
  EXPECT_EQ(parse_dropped(dev, "eth0"), (std::pair<Drops::Count, Drops::Count>(40, 120)));
  EXPECT_EQ(parse_dropped(dev, "eth1"), (std::pair<Drops::Count, Drops::Count>()));
  const std::string snmp =
      "Ip: Forwarding ReasmFails\nIp: 1 7\nUdp: InDatagrams RcvbufErrors SndbufErrors\nUdp: 117507977 172 3\n"
      "UdpLite: InDatagrams RcvbufErrors\nUdpLite: 9 9\n";
  EXPECT_EQ(parse_snmp(snmp, "Udp", "RcvbufErrors"), 172U);
  EXPECT_EQ(parse_snmp(snmp, "Ip", "ReasmFails"), 7U);
  EXPECT_EQ(parse_snmp(snmp, "Udp", "MemErrors"), std::nullopt) << "this kernel does not count it";
  EXPECT_EQ(parse_snmp("Udp: A\nUdp:", "Udp", "A"), std::nullopt);
  const std::string udp =
      "   sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout inode ref "
      "pointer drops\n"
      "  7: 0100007F:1EDC 00000000:0000 07 00000000:00000000 00:00000000 00000000     0        0 4711 2 "
      "0000000000000000 5\n"
      "  8: 0100007F:1EDD 00000000:0000 07 00000000:00000000 00:00000000 00000000     0        0 4712 2 "
      "0000000000000000 6\n";
  EXPECT_EQ(parse_socket_drops(udp, {4711}), 5U) << "another process's are not ours";
  EXPECT_EQ(parse_socket_drops(udp, {}), 0U);
  EXPECT_EQ(parse_backlog_drops("06c7f99e 0000001f 00000007\n00000001 00000001 00000000\n"), 32U);
  EXPECT_EQ(parse_socket_drops("", {4711}), std::nullopt);
  EXPECT_EQ(parse_backlog_drops(""), std::nullopt);
}

TEST(DropsOf, UnknownCountsAreNullNotZero) {
  Drops before, now;
  before.udp_receive = before.udp_send = before.backlog = 7;
  now.udp_receive = 9;
  now.udp_send = 3;
  now.fragments = 5;
  const auto dropped = between(before, now);
  EXPECT_EQ(dropped.at("udp_receive"), 2);
  EXPECT_TRUE(dropped.at("udp_send").is_null()) << "set back";
  EXPECT_TRUE(dropped.at("fragments").is_null());
  EXPECT_TRUE(dropped.at("backlog").is_null());
}

TEST(TrafficOf, RecreatedInterfaceHasNoTraffic) {
  const Traffic before{.sent_bytes = 5000, .sent_packets = 5, .received_bytes = 5000, .received_packets = 5};
  auto now = before;
  now.sent_bytes += 100;
  EXPECT_EQ(between(before, now).at("sent_bytes"), 100);
  now.received_bytes = 10;
  EXPECT_THAT(between(before, now).at("gone").get<std::string>(), ::testing::HasSubstr("set back"));
  EXPECT_FALSE(between(before, now).contains("sent_bytes"));
  EXPECT_TRUE(between(before, {}).contains("gone"));
}

TEST(TrafficSince, CountersThatFallShortAreReadOnceMore) {
  auto before = traffic("lo").value();
  int waits = 0;
  const auto since_with = [&](std::uint64_t least_bytes) {
    waits = 0;
    return since(before, "lo", least_bytes, [&] { ++waits; });
  };
  EXPECT_TRUE(since_with(0).contains("sent_bytes"));
  EXPECT_EQ(waits, 0);
  EXPECT_TRUE(since_with(std::uint64_t{1} << 60).contains("sent_bytes"));
  EXPECT_EQ(waits, 1);
  before.sent_bytes = ~std::uint64_t{0};
  EXPECT_TRUE(since_with(1).contains("gone")) << "it was set back";
  EXPECT_TRUE(since(before, "no such link", 1).contains("gone"));
}

TEST(DropsOf, SocketWithoutRoomIsSeen) {
  const int to = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0),
            from = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  sockaddr_in address{};
  socklen_t size = sizeof address;
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  auto* const at = reinterpret_cast<sockaddr*>(&address);
  ASSERT_EQ(bind(to, at, sizeof address), 0);
  ASSERT_EQ(getsockname(to, at, &size), 0);
  const int little = 1;
  setsockopt(to, SOL_SOCKET, SO_RCVBUF, &little, sizeof little);
  const auto before = drops("lo");
  const std::string message(1000, 'x');
  for (int i = 0; i < 100; ++i) sendto(from, message.data(), message.size(), 0, at, sizeof address);
  const auto dropped = between(before, drops("lo"));
  EXPECT_GT(dropped.at("own_sockets"), 0);
  EXPECT_GE(dropped.at("udp_receive"), dropped.at("own_sockets"));
  close(to);
  close(from);
}

TEST(TrafficOf, LoopbackCountsWhatIsSent) {
  const int one = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0),
            other = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t bytes = sizeof address;
  ASSERT_EQ(bind(other, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
  ASSERT_EQ(getsockname(other, reinterpret_cast<sockaddr*>(&address), &bytes), 0);
  const auto before = traffic("lo");
  ASSERT_TRUE(before);
  const std::string message(1000, 'x');
  EXPECT_EQ(
      sendto(one, message.data(), message.size(), 0, reinterpret_cast<sockaddr*>(&address), sizeof address),
      1000);
  const auto after = traffic("lo");
  ASSERT_TRUE(after);
  EXPECT_GE(after->sent_packets, before->sent_packets + 1);
  EXPECT_GE(after->sent_bytes, before->sent_bytes + message.size());
  EXPECT_GE(after->received_bytes, before->received_bytes + message.size());
  close(one);
  close(other);
}

TEST(SharedMemory, SegmentsOfADdsAreNamedOnce) {
  const std::string text =
      "7f00-7f01 rw-s 00000000 00:1a 5   /dev/shm/fastrtps_0a1b2c\n"
      "7f02-7f03 r--s 00000000 00:1a 5   /dev/shm/fastrtps_0a1b2c\n"
      "7f04-7f05 rw-s 00000000 00:1a 6   /dev/shm/fastdds_x_el (deleted)\n"
      "7f06-7f07 rw-s 00000000 00:1a 7   /dev/shm/iceoryx_mgmt\n"
      "7f08-7f09 rw-s 00000000 00:1a 8   /dev/shm/iox_0_p\n"
      "7f0a-7f0b rw-s 00000000 00:1a 9   /dev/shm/sem.fastrtps_port\n"
      "7f0c-7f0d r-xp 00000000 08:01 9   /usr/lib/libfastrtps_x.so\n"
      "7f0e-7f0f rw-p 00000000 00:00 0   [stack]\n";
  EXPECT_THAT(parse_segments(text),
              ElementsAre("fastdds_x_el", "fastrtps_0a1b2c", "iceoryx_mgmt", "iox_0_p"));
  EXPECT_THAT(parse_segments(""), IsEmpty());
}

TEST(SharedMemory, IsWhatThisProcessHasMapped) {
  EXPECT_THAT(shared_memory(), IsEmpty());
  const auto name = "fastrtps_ontime_test_" + std::to_string(getpid());
  const int fd = shm_open(name.c_str(), O_RDWR | O_CREAT | O_EXCL, 0600);
  ASSERT_GE(fd, 0);
  ASSERT_EQ(ftruncate(fd, 4096), 0);
  void* const mapped = mmap(nullptr, 4096, PROT_READ, MAP_SHARED, fd, 0);
  ASSERT_NE(mapped, MAP_FAILED);
  EXPECT_THAT(shared_memory(), ElementsAre(name));
  shm_unlink(name.c_str());
  EXPECT_THAT(shared_memory(), ElementsAre(name)) << "it is in use still";
  munmap(mapped, 4096);
  close(fd);
  EXPECT_THAT(shared_memory(), IsEmpty());
}

TEST(Ip, SaysWhatItSaid) {
  const auto said = error_of([] { iproute2({"ip", "link", "show", "no-such-link"}); });
  if (said.find("iproute2") != std::string::npos) GTEST_SKIP() << said;
  EXPECT_THAT(said, AllOf(StartsWith("ip link show no-such-link failed: "),
                          HasSubstr("no-such-link\" does not exist")));
}

// As where another program left a FIFO in /run/netns.
TEST(Ip, IsNotWaitedForWithoutEnd) {
  EXPECT_THAT(error_of([] {
                iproute2({"sleep", "60"}, std::chrono::milliseconds(50));
              }),
              StartsWith("sleep 60 was killed"));
}

TEST(Answer, IsNotAwaitedOnceItIsInterrupted) {
  int asked = 0;
  const auto interrupted = [&] { return ++asked > 1; };
  EXPECT_EQ(answer_of({"sleep", "infinity"}, std::chrono::hours(24), interrupted), std::nullopt);
}

}  // namespace
}  // namespace ontime::machine

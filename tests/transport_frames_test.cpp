// SPDX-License-Identifier: Apache-2.0
// Transports below IP, over a veth pair of the test's own.
#include <algorithm>
#include <array>
#include <atomic>
#include <functional>
#include <initializer_list>
#include <mutex>
#include <thread>

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <linux/bpf.h>
#include <linux/capability.h>
#include <linux/if_link.h>
#include <net/if.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include "own_link.hpp"
#include "sinks.hpp"
#include "transport/transport.hpp"

namespace ontime::transport {
namespace {

using namespace std::chrono_literals;
using testing::AllOf;
using testing::HasSubstr;

constexpr auto a_while = 60'000ms, not_at_all = 200ms;

class BelowIp : public testing::TestWithParam<const char*> {
 protected:
  void SetUp() override {
    if (geteuid() != 0) GTEST_SKIP() << "network namespaces need root";
    if (const auto names = available(); std::find(names.begin(), names.end(), GetParam()) == names.end())
      GTEST_SKIP() << "there is no transport " << GetParam();
    link_.emplace();
    config.max_payload_bytes = 1000;
  }
  std::unique_ptr<Endpoint> open(Role role, Sink& sink, const std::string& transport = GetParam()) {
    auto copy = config;
    copy.role = role;
    if (copy.interface.empty()) copy.interface = role == Role::client ? "near" : "far";
    if (role == Role::server) copy.peers.clear();
    return load(transport).open(copy, sink);
  }
  std::string error(Role role, const std::string& transport = GetParam()) {
    try {
      open(role, keep, transport);
    } catch (const Error& failure) {
      return failure.what();
    }
    return "none";
  }
  // Of a process that gave up rights of its own.
  std::string error_without(const std::function<bool()>& give_up) {
    const std::string transport = GetParam();
    const auto& plugin = load(transport);  // its user may not look into our folders
    config.interface = "far";
    config.role = Role::server;
    std::array<int, 2> pipe{};
    EXPECT_EQ(pipe2(pipe.data(), O_CLOEXEC), 0);
    const pid_t child = fork();
    if (child == 0) {
      std::string said = "none";
      try {
        if (!give_up()) said = "it could not";
        plugin.open(config, keep);
      } catch (const Error& failure) {
        said = failure.what();
      }
      _exit(write(pipe[1], said.data(), said.size()) < 0 ? 1 : 0);
    }
    close(pipe[1]);
    std::array<char, 1000> said{};
    const auto bytes = read(pipe[0], said.data(), said.size());
    close(pipe[0]);
    waitpid(child, nullptr, 0);
    return {said.data(), static_cast<std::size_t>(std::max<ssize_t>(bytes, 0))};
  }
  Config config;
  Keep keep;
  std::optional<OwnLink> link_;
};
INSTANTIATE_TEST_SUITE_P(, BelowIp, testing::Values("ethernet", "xdp"),
                         [](const auto& one) { return std::string(one.param); });

TEST_P(BelowIp, CarriesEverySizeThatOneFrameHoldsThereAndBack) {
  Echo echo;
  config.max_payload_bytes = 1468;
  const auto server = open(Role::server, echo);
  echo.endpoint = server.get();
  const auto client = open(Role::client, keep);
  EXPECT_FALSE(client->send(1, {})) << "to whom?";
  ASSERT_TRUE(within(a_while, [&] { return client->matched().both(); }));
  for (const std::size_t size : {0, 1, 15, 16, 500, 1467, 1468}) {
    std::vector<std::byte> payload(size);
    for (std::size_t i = 0; i < size; ++i) payload[i] = static_cast<std::byte>(i * 7);
    const int before = keep.arrivals;
    ASSERT_TRUE(client->send(size, payload));
    ASSERT_TRUE(within(a_while, [&] { return keep.arrivals > before; })) << size;
    const std::lock_guard lock(keep.mutex);
    EXPECT_EQ(keep.last_sequence, size);
    EXPECT_EQ(keep.last, payload);
  }
  EXPECT_FALSE(client->send(1, std::vector<std::byte>(1469)));
  EXPECT_TRUE(server->matched().both());
  EXPECT_EQ(client->facts().at("carrier"), "Ethernet");
  EXPECT_EQ(client->facts().at("peer"), server->facts().at("address"));
}

// What waits for the launch is the link's queueing discipline, and here is none.
TEST_P(BelowIp, SaysWhenWhatItSendsIsToLeaveWhereItCan) {
  if (GetParam() == std::string("xdp")) GTEST_SKIP() << "it passes by all queueing disciplines";
  config.launch_ns = 1'000'000;
  config.priority = 6;
  Echo echo;
  const auto server = open(Role::server, echo);
  echo.endpoint = server.get();
  const auto client = open(Role::client, keep);
  ASSERT_TRUE(within(a_while, [&] { return client->matched().both(); }));
  const std::vector<std::byte> payload(500);
  ASSERT_TRUE(client->launch(1, payload, 1));
  ASSERT_TRUE(within(a_while, [&] { return keep.arrivals == 1; }));
}

// More than the rings have room for, one after the other: each slot is used again.
TEST_P(BelowIp, GoesOnForever) {
  Echo echo;
  const auto server = open(Role::server, echo);
  echo.endpoint = server.get();
  const auto client = open(Role::client, keep);
  ASSERT_TRUE(within(a_while, [&] { return client->matched().both(); }));
  const std::vector<std::byte> payload(500);
  for (int i = 1; i <= 2000; ++i) {
    ASSERT_TRUE(client->send(static_cast<std::uint64_t>(i), payload)) << i;
    ASSERT_TRUE(within(a_while, [&] { return keep.arrivals == i; })) << i;
  }
  EXPECT_EQ(client->losses().overwritten, 0U);
}

TEST_P(BelowIp, DividesNoMessage) {
  config.max_payload_bytes = 1469;
  EXPECT_THAT(error(Role::client), AllOf(HasSubstr("1469 bytes is too large for one frame of near"),
                                         HasSubstr("1468 bytes at most"), HasSubstr("MTU of 1500")));
  config.max_payload_bytes = 0;
  EXPECT_EQ(error(Role::server), "none") << "as many as the link carries";
}

TEST_P(BelowIp, DomainsAndTopicsKeepApart) {
  Echo echo;
  const auto server = open(Role::server, echo);
  config.domain = 1;
  EXPECT_FALSE(within(not_at_all, [client = open(Role::client, keep)] { return client->matched().both(); }));
  config.domain = 0;
  config.ping_topic = "/arm/ping";
  EXPECT_FALSE(within(not_at_all, [client = open(Role::client, keep)] { return client->matched().both(); }));
  config.pong_topic = "/arm/ping";
  EXPECT_THAT(error(Role::server), HasSubstr("/arm/ping"));
}

TEST_P(BelowIp, PeerIsWhoHasTheAddress) {
  Echo echo;
  const auto server = open(Role::server, echo);
  config.peers = {"10.9.0.3"};
  {
    const auto client = open(Role::client, keep);
    EXPECT_FALSE(within(not_at_all, [&] { return client->matched().both(); }));
    EXPECT_THAT(client->seen(), HasSubstr("10.9.0.3"));
  }
  config.peers = {"10.9.0.2:7900"};
  const auto client = open(Role::client, keep);
  EXPECT_TRUE(within(a_while, [&] { return client->matched().both(); }));
}

TEST_P(BelowIp, ClientOutlivesARestartOfTheServer) {
  Echo first, echo;  // which outlive the server's thread
  auto server = open(Role::server, first);
  const auto client = open(Role::client, keep);
  ASSERT_TRUE(within(a_while, [&] { return client->matched().both(); }));
  server.reset();
  server = open(Role::server, echo);  // what the first held is free again
  echo.endpoint = server.get();
  EXPECT_TRUE(within(a_while, [&] {
    client->send(1, std::vector<std::byte>(500));
    return keep.arrivals > 0;
  }));
}

TEST_P(BelowIp, WaitsetEndsWhenInterrupted) {
  config.receive = Receive::waitset;
  for (const char* busy : {"off", "on"})
    for (const auto role : {Role::server, Role::client}) {
      config.options["busy-poll"] = busy;
      const auto endpoint = open(role, keep);
      std::thread waiting([&] { endpoint->receive(); });
      std::this_thread::sleep_for(5ms);
      endpoint->interrupt();
      waiting.join();
      endpoint->receive();  // and every later one
      EXPECT_TRUE(endpoint->threads().empty());
    }
}

TEST_P(BelowIp, TellsWhatFoundNoRoom) {
  Echo echo;
  config.receive = Receive::waitset;
  const auto server = open(Role::server, echo);
  config.receive = Receive::listener;
  const auto client = open(Role::client, keep);
  std::thread answering([&] { server->receive(); });  // the call that each look makes
  EXPECT_TRUE(within(a_while, [&] { return client->matched().both(); }));
  server->interrupt();
  answering.join();
  EXPECT_EQ(server->losses().overwritten, 0U);
  // No receiver is left.
  EXPECT_TRUE(within(a_while, [&] {
    client->send(1, std::vector<std::byte>(500));
    return server->losses().overwritten.value_or(0) > 0;
  }));
  const auto lost = *server->losses().overwritten;
  EXPECT_EQ(server->losses().overwritten, lost) << "as often as it is asked";
}

TEST_P(BelowIp, OutlivesALinkThatGoesDown) {
  Echo echo;
  const auto server = open(Role::server, echo);
  echo.endpoint = server.get();
  const auto client = open(Role::client, keep);
  ASSERT_TRUE(within(a_while, [&] { return client->matched().both(); }));
  OwnLink::ip("link set far down");
  client->send(1, std::vector<std::byte>(500));
  OwnLink::ip("link set far up");
  EXPECT_TRUE(within(a_while, [&] {
    client->send(2, std::vector<std::byte>(500));
    return keep.arrivals > 0;
  }));
}

TEST_P(BelowIp, SaysWhatIsWrongAtOpening) {
  config.options["busy-poll"] = "perhaps";
  EXPECT_THAT(error(Role::client), HasSubstr("on or off"));
  config.options.clear();
  config.peers = {"no-such-host.invalid"};
  EXPECT_THAT(error(Role::client), HasSubstr("no-such-host.invalid"));
  config.peers.clear();
  config.interface = "nonet0";
  EXPECT_THAT(error(Role::client), HasSubstr("no interface nonet0"));
  config.interface = "far";
  OwnLink::ip("link set far down");
  EXPECT_THAT(error(Role::client), HasSubstr("far is down"));
  if (OwnLink::try_ip("link add tunnel type ipip local 10.9.0.1 remote 10.9.0.9") &&
      OwnLink::try_ip("link set tunnel up")) {
    config.interface = "tunnel";
    EXPECT_THAT(error(Role::client), HasSubstr("tunnel is not Ethernet"));
  }
  Config none;
  EXPECT_THROW(load(GetParam()).open(none, keep), WrongInput);
}

TEST_P(BelowIp, SaysWhatPermissionItWants) {
  EXPECT_THAT(error_without([] { return setuid(65534) == 0; }),
              AllOf(HasSubstr("no"), HasSubstr("socket"), HasSubstr("root"), HasSubstr("CAP_NET_RAW")));
}

TEST_P(BelowIp, FindsTheOtherOfTheTwo) {
  const std::string other = GetParam() == std::string("xdp") ? "ethernet" : "xdp";
  if (const auto names = available(); std::find(names.begin(), names.end(), other) == names.end())
    GTEST_SKIP() << "there is no transport " << other;
  Echo echo;
  const auto server = open(Role::server, echo, other);
  echo.endpoint = server.get();
  const auto client = open(Role::client, keep);
  ASSERT_TRUE(within(a_while, [&] { return client->matched().both(); }));
  client->send(1, std::vector<std::byte>(500));
  EXPECT_TRUE(within(a_while, [&] { return keep.arrivals == 1; }));
}

TEST(Ethernet, WorksOnLoopback) {
  if (geteuid() != 0) GTEST_SKIP() << "a raw socket needs root";
  const OwnLink link;
  Config config;
  config.interface = "lo";
  config.max_payload_bytes = 60'000;
  config.role = Role::server;
  Echo echo;
  const auto server = load("ethernet").open(config, echo);
  echo.endpoint = server.get();
  config.role = Role::client;
  config.peers = {"127.0.0.1"};
  Keep keep;
  const auto client = load("ethernet").open(config, keep);
  ASSERT_TRUE(within(a_while, [&] { return client->matched().both(); }));
  client->send(1, std::vector<std::byte>(60'000));
  EXPECT_TRUE(within(a_while, [&] { return keep.arrivals == 1; }));
}

// --- the XDP program ---

class Xdp : public BelowIp {
 protected:
  static bool has_program(const std::string& interface) {
    return OwnLink::try_ip("link show dev " + interface + " | grep -q xdp");
  }
};
INSTANTIATE_TEST_SUITE_P(, Xdp, testing::Values("xdp"), [](const auto&) { return "xdp"; });

TEST_P(Xdp, LeavesAllOtherFramesToTheKernel) {
  const auto server = open(Role::server, keep);
  ASSERT_TRUE(has_program("far"));
  config.domain = 1;  // of the same EtherType, too
  Echo echo;
  const auto beside = open(Role::server, echo, "ethernet");
  echo.endpoint = beside.get();
  Keep heard;
  config.role = Role::client;
  config.interface = "near";
  const auto client = load("ethernet").open(config, heard);
  ASSERT_TRUE(within(a_while, [&] { return client->matched().both(); }));
  client->send(1, std::vector<std::byte>(500));
  EXPECT_TRUE(within(a_while, [&] { return heard.arrivals == 1; }));
  EXPECT_EQ(keep.arrivals, 0);
}

TEST_P(Xdp, LeavesNothingBehind) {
  {
    const auto server = open(Role::server, keep);
    EXPECT_TRUE(has_program("far"));
    EXPECT_THAT(server->facts().at("xdp"), testing::MatchesRegex("(native|generic) (zero-)?copy"));
    EXPECT_THAT(error(Role::server), HasSubstr("already has an XDP program")) << "asked before the queue";
    EXPECT_TRUE(has_program("far"));
  }
  EXPECT_TRUE(within(a_while, [] { return !has_program("far"); }));
  config.options["queue"] = "77";
  EXPECT_THAT(error(Role::server), AllOf(HasSubstr("queue 77 of far does not exist"), HasSubstr("ethtool")));
  config.options["queue"] = "first";
  EXPECT_THAT(error(Role::server), HasSubstr("'first' is not a queue number"));
  EXPECT_FALSE(has_program("far"));
}

TEST_P(Xdp, LeavesForeignProgramAlone) {
  std::array<bpf_insn, 2> pass{};
  pass[0].code = BPF_ALU64 | BPF_MOV | BPF_K;
  pass[0].imm = XDP_PASS;
  pass[1].code = BPF_JMP | BPF_EXIT;
  bpf_attr load{};
  load.prog_type = BPF_PROG_TYPE_XDP;
  load.insns = reinterpret_cast<std::uint64_t>(pass.data());
  load.insn_cnt = pass.size();
  load.license = reinterpret_cast<std::uint64_t>("GPL");
  const auto program = syscall(SYS_bpf, BPF_PROG_LOAD, &load, sizeof load);
  ASSERT_GE(program, 0);
  bpf_attr attach{};
  attach.link_create.prog_fd = static_cast<std::uint32_t>(program);
  attach.link_create.target_ifindex = if_nametoindex("far");
  attach.link_create.attach_type = BPF_XDP;
  attach.link_create.flags = XDP_FLAGS_SKB_MODE;
  const auto attached = syscall(SYS_bpf, BPF_LINK_CREATE, &attach, sizeof attach);
  ASSERT_GE(attached, 0);
  EXPECT_THAT(error(Role::server), AllOf(HasSubstr("far already has an XDP program"), HasSubstr("xdp off")));
  EXPECT_TRUE(has_program("far"));
  close(static_cast<int>(attached));
  close(static_cast<int>(program));
  EXPECT_TRUE(within(a_while, [] { return !has_program("far"); }));
  EXPECT_EQ(error(Role::server), "none");
}

bool keep_only(std::initializer_list<unsigned> capabilities) {
  __user_cap_header_struct head{.version = _LINUX_CAPABILITY_VERSION_3, .pid = 0};
  std::array<__user_cap_data_struct, 2> kept{};
  for (const unsigned one : capabilities) {
    kept.at(one / 32).effective |= 1U << one % 32;
    kept.at(one / 32).permitted |= 1U << one % 32;
  }
  return syscall(SYS_capset, &head, kept.data()) == 0;
}

// The socket can then be opened, but the calls after it are denied.
TEST_P(Xdp, NamesTheMissingPermission) {
  const auto wants =
      AllOf(HasSubstr("no permission for"), HasSubstr("root"), HasSubstr("CAP_NET_ADMIN and CAP_BPF"));
  EXPECT_THAT(error_without([] {
                return keep_only({CAP_IPC_LOCK, CAP_NET_RAW});
              }),
              AllOf(wants, HasSubstr("map of sockets")));
  EXPECT_THAT(error_without([] {
                return keep_only({CAP_IPC_LOCK, CAP_NET_RAW, CAP_BPF});
              }),
              AllOf(wants, HasSubstr("map of sockets")));
  EXPECT_THAT(error_without([] { return keep_only({CAP_IPC_LOCK, CAP_NET_RAW, CAP_NET_ADMIN}); }), wants);
  EXPECT_EQ(error_without([] {
              return keep_only({CAP_IPC_LOCK, CAP_NET_RAW, CAP_NET_ADMIN, CAP_BPF});
            }),
            "none");
}

// What the kernel has taken and could not send goes when it can: it was not refused.
TEST_P(Xdp, SendsWhatALinkThatWasDownKept) {
  Echo echo;
  const auto server = open(Role::server, echo);
  echo.endpoint = server.get();
  const auto client = open(Role::client, keep);
  ASSERT_TRUE(within(a_while, [&] { return client->matched().both(); }));
  OwnLink::ip("link set near down");
  const std::vector<std::byte> payload(500);
  for (std::uint64_t i = 1; i <= 10; ++i) EXPECT_TRUE(client->send(i, payload)) << i;
  EXPECT_EQ(echo.arrivals, 0);
  OwnLink::ip("link set near up");
  EXPECT_TRUE(client->send(11, payload));
  EXPECT_TRUE(within(a_while, [&] { return keep.arrivals == 11; })) << keep.arrivals;
}

TEST_P(Xdp, IsNotForLoopback) {
  config.interface = "lo";
  EXPECT_THAT(error(Role::server), AllOf(HasSubstr("lo has one queue"), HasSubstr("ethernet")));
}

}  // namespace
}  // namespace ontime::transport

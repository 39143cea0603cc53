// SPDX-License-Identifier: Apache-2.0
// Cyclone DDS, Fast DDS and OpenDDS answer each other and themselves.
#include <algorithm>
#include <fstream>
#include <map>
#include <random>

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include "dds_ends.hpp"
#include "transport/dds.hpp"

namespace ontime::transport::test {
namespace {

constexpr std::size_t payload_sizes[] = {0, 1, 500, 32768, max_payload_bytes};

std::vector<std::byte> random_payload(std::size_t bytes, std::mt19937& random) {
  std::vector<std::byte> payload(bytes);
  for (std::byte& byte : payload) byte = static_cast<std::byte>(random());
  message::put_server_times(payload, {0, 0});
  return payload;
}

void ask(const std::string& transport, const Config& config) {
  std::mt19937 random(1);
  Answers answers;
  End end(transport, config, answers);
  await_match(end);
  std::uint64_t index = message::max_index - 2;  // the highest ones too must survive the wire
  for (const std::size_t bytes : payload_sizes)
    exchange(end, answers, message::sequence_of(0xABCDEF, index++), random_payload(bytes, random));
}

struct Pair {
  std::string client;
  std::string server;
  Reliability reliability;
  Receive receive;
};

std::string name_of(const testing::TestParamInfo<Pair>& info) {
  return info.param.client + "_to_" + info.param.server +
         (info.param.reliability == Reliability::reliable ? "_reliable" : "_best_effort") +
         (info.param.receive == Receive::listener ? "_listener" : "_waitset");
}

class DdsPair : public testing::TestWithParam<Pair> {
  void SetUp() override {
    for (const auto& transport : {GetParam().client, GetParam().server})
      if (!have(transport)) GTEST_SKIP() << transport << " is not built";
  }
};

TEST_P(DdsPair, EveryPayloadComesBack) {
  const Pair& pair = GetParam();
  Process serving([&](const auto& await_end) {
    serve(pair.server, config_of(Role::server, pair.reliability, pair.receive), await_end);
  });
  EXPECT_EQ(
      in_own_process([&] { ask(pair.client, config_of(Role::client, pair.reliability, pair.receive)); }), "");
  EXPECT_EQ(serving.finish(), "");
}

const Pair pairs[] = {
    {"cyclonedds", "cyclonedds", Reliability::best_effort, Receive::listener},
    {"cyclonedds", "cyclonedds", Reliability::reliable, Receive::waitset},
    {"cyclonedds", "fastdds", Reliability::best_effort, Receive::waitset},
    {"cyclonedds", "fastdds", Reliability::reliable, Receive::listener},
    {"fastdds", "cyclonedds", Reliability::best_effort, Receive::listener},
    {"fastdds", "cyclonedds", Reliability::reliable, Receive::waitset},
    {"fastdds", "fastdds", Reliability::best_effort, Receive::waitset},
    {"fastdds", "fastdds", Reliability::reliable, Receive::listener},
    {"opendds", "opendds", Reliability::best_effort, Receive::listener},
    {"opendds", "opendds", Reliability::best_effort, Receive::waitset},
    {"opendds", "opendds", Reliability::reliable, Receive::listener},
    {"opendds", "opendds", Reliability::reliable, Receive::waitset},
    {"opendds", "cyclonedds", Reliability::best_effort, Receive::listener},
    {"opendds", "cyclonedds", Reliability::reliable, Receive::waitset},
    {"cyclonedds", "opendds", Reliability::best_effort, Receive::waitset},
    {"cyclonedds", "opendds", Reliability::reliable, Receive::listener},
    {"opendds", "fastdds", Reliability::best_effort, Receive::waitset},
    {"opendds", "fastdds", Reliability::reliable, Receive::listener},
    {"fastdds", "opendds", Reliability::best_effort, Receive::listener},
    {"fastdds", "opendds", Reliability::reliable, Receive::waitset},
};
INSTANTIATE_TEST_SUITE_P(All, DdsPair, testing::ValuesIn(pairs), name_of);

class Dds : public testing::TestWithParam<const char*> {
 protected:
  void SetUp() override {
    if (!have(GetParam())) GTEST_SKIP() << GetParam() << " is not built";
  }
  static Config client() { return config_of(Role::client); }
  static Config server() { return config_of(Role::server); }
};
INSTANTIATE_TEST_SUITE_P(All, Dds, testing::Values("cyclonedds", "fastdds", "opendds"),
                         [](const auto& of) { return std::string(of.param); });

TEST_P(Dds, AServerOutlivesItsClients) {
  Process serving([&](const auto& await_end) {
    Echo echo;
    End end(GetParam(), server(), echo);
    echo.endpoint = end.operator->();
    await_end();
    const auto alone = [&] { return end->matched().readers == 0 && end->matched().writers == 0; };
    require(eventually(alone), "a client that left is still matched");
  });
  // One after the other in one process: what the first had open must be gone.
  EXPECT_EQ(in_own_process([&] {
              ask(GetParam(), client());
              ask(GetParam(), client());
            }),
            "");
  EXPECT_EQ(serving.finish(), "");
}

TEST_P(Dds, ServersOfOtherDomainsDoNotAnswer) {
  Config elsewhere = server();
  elsewhere.domain = free_domain() + 1;
  Process stranger([&](const auto& await_end) { serve(GetParam(), elsewhere, await_end); });
  Process serving([&](const auto& await_end) { serve(GetParam(), server(), await_end); });
  EXPECT_EQ(in_own_process([&] {
              Answers answers;
              End end(GetParam(), client(), answers);
              await_match(end);
              require(end->matched().readers == 1, "more than one reader");
              exchange(end, answers, 1, {});
            }),
            "");
}

TEST_P(Dds, TakenPortIsReplacedByAnother) {
  const int taken = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  const int of_domain = dds::base_port + dds::ports_per_domain * free_domain();
  address.sin_port = htons(static_cast<std::uint16_t>(of_domain + 11));  // the first participant's, for data
  ASSERT_EQ(bind(taken, reinterpret_cast<sockaddr*>(&address), sizeof address), 0) << "the port is not free";
  Process serving([&](const auto& await_end) { serve(GetParam(), server(), await_end); });
  EXPECT_EQ(in_own_process([&] { ask(GetParam(), client()); }), "");
  EXPECT_EQ(serving.finish(), "");
  close(taken);
}

TEST_P(Dds, AnIncompatibleQosIsSeen) {
  Process serving([&](const auto& await_end) { serve(GetParam(), server(), await_end); });
  Config demanding = client();
  demanding.qos.reliability = Reliability::reliable;
  EXPECT_EQ(in_own_process([&] {
              Answers answers;
              End end(GetParam(), demanding, answers);
              const std::string expected = "a writer of rt/pong offers best-effort, ontime requests reliable";
              require(eventually([&] { return end->seen() == expected; }), "seen: " + end->seen());
              require(!end->matched().both(), "matched despite the QoS");
            }),
            "");
}

TEST_P(Dds, InterruptEndsThisAndEveryLaterReceive) {
  EXPECT_EQ(in_own_process([&] {
              Config config = client();
              config.receive = Receive::waitset;
              Answers answers;
              const auto endpoint = load(GetParam()).open(config, answers);
              std::thread receiver([&] { endpoint->receive(); });
              endpoint->interrupt();
              receiver.join();
              endpoint->receive();
            }),
            "");
}

TEST_P(Dds, ItsThreadsAreTold) {
  EXPECT_EQ(in_own_process([&] {
              Answers answers;
              End end(GetParam(), client(), answers);
              const auto threads = end->threads();
              for (const std::string role : {"receive", "discovery", "timer"})
                require(std::any_of(threads.begin(), threads.end(),
                                    [&](const Thread& thread) { return thread.role == role; }),
                        "no thread for " + role);
              for (const Thread& thread : threads) require(thread.tid != gettid(), "our own thread is told");
            }),
            "");
}

// A program with file capabilities is not dumpable, and then its own /proc/self/task/TID/syscall is root's.
TEST_P(Dds, ItsThreadsAreToldWhereTheKernelDoesNotTell) {
  EXPECT_EQ(in_own_process([&] {
              const std::string transport = GetParam();
              const Plugin& plugin = load(transport);  // while we may read the folder
              require(getuid() != 0 || (setgid(65534) == 0 && setuid(65534) == 0),
                      "cannot become user 65534");
              prctl(PR_SET_DUMPABLE, 1);
              Answers answers;
              const auto end = plugin.open(client(), answers);
              const auto roles = [&] {
                std::map<pid_t, std::string> found;
                for (const Thread& thread : end->threads()) found[thread.tid] = thread.role;
                return found;
              };
              const auto told = roles();
              prctl(PR_SET_DUMPABLE, 0);
              std::string word;
              require(!(std::ifstream("/proc/self/syscall") >> word), "the kernel still shows it");
              require(roles() == told, "other roles");
              for (const auto& [tid, role] : told) require(role != "unknown", "a role is unknown");
            }),
            "");
}

TEST_P(Dds, TopicsAreNamedAsInRos) {
  Config robot = server();
  robot.ping_topic = "/robot/ping";
  robot.pong_topic = "/robot/pong";
  Process serving([&](const auto& await_end) { serve(GetParam(), robot, await_end); });
  robot.role = Role::client;
  EXPECT_EQ(in_own_process([&] { ask(GetParam(), robot); }), "");
  EXPECT_EQ(in_own_process([&] {
              Answers answers;
              End end(GetParam(), client(), answers);
              const std::string expected = "no reader of rt/ping, no writer of rt/pong";
              require(eventually([&] { return end->seen().find(expected) != std::string::npos; }),
                      "seen: " + end->seen());
            }),
            "");
}

TEST_P(Dds, InvalidTopicIsRefused) {
  for (const std::string name :
       {"", "/", "ping", "/robot/", "/robot//ping", "/9lives", "/a b", "/r\u00e9ponse"}) {
    Config config = client();
    config.ping_topic = name;
    const auto said = refusal(GetParam(), config);
    EXPECT_EQ(said.find("wrong input: " + std::string(GetParam()) + ": \"" + name + "\" is not a topic"), 0U)
        << said;
  }
  Config config = client();
  config.pong_topic = config.ping_topic;
  EXPECT_NE(refusal(GetParam(), config).find("wrong input"), std::string::npos);
}

TEST_P(Dds, UnsupportedConfigIsRefused) {
  const auto wrong_input = [](const Config& config, const std::string& named) {
    const auto said = refusal(GetParam(), config);
    EXPECT_EQ(said.find("wrong input: "), 0U) << said;
    EXPECT_NE(said.find(named), std::string::npos) << said;
  };
  Config config = client();
  config.domain = 233;
  wrong_input(config, "domain 233");
  config = client();
  config.max_payload_bytes = std::size_t{1} << 40;
  wrong_input(config, "too large");
  config = client();
  config.peers = {"127.0.0.1:99999"};
  wrong_input(config, "127.0.0.1:99999");
  config = client();
  config.interface = "no-such-if";
  EXPECT_NE(refusal(GetParam(), config).find("no-such-if"), std::string::npos);
}

}  // namespace
}  // namespace ontime::transport::test

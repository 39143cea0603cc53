// SPDX-License-Identifier: Apache-2.0
// Cyclone DDS and Fast DDS answer each other and themselves. Each end is a process of its own, for two
// vendors' libraries must never meet; all of it is in a network namespace of its own where the kernel permits
// that.
#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <functional>
#include <mutex>
#include <optional>
#include <random>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include <fcntl.h>
#include <gtest/gtest.h>
#include <net/if.h>
#include <sched.h>
#include <signal.h>
#include <sys/ioctl.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "message/message.hpp"
#include "transport/transport.hpp"

namespace ontime::transport {
namespace {

using namespace std::chrono_literals;

// Only so that a broken transport does not hang the test. Longer than Fast DDS's lease of 20 s, for which one
// is still matched whose farewell, a single datagram, was lost.
constexpr auto time_limit = 40s;
constexpr std::size_t payload_sizes[] = {0, 1, 500, 32768, 131072};
constexpr message::ServerTimes marks{.received_ns = 0x1111, .sent_ns = 0x2222};

int domain = 0;

void bring_loopback_up() {
  const int socket = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  ifreq request{};
  std::string("lo").copy(request.ifr_name, IFNAMSIZ - 1);
  ioctl(socket, SIOCGIFFLAGS, &request);
  request.ifr_flags = static_cast<short>(request.ifr_flags | IFF_UP);
  ioctl(socket, SIOCSIFFLAGS, &request);
  close(socket);
}

class Isolation : public testing::Environment {
  void SetUp() override {
    // Without it everything would be skipped, and nobody would notice.
    ASSERT_NE(std::getenv("ONTIME_TRANSPORT_PATH"), nullptr)  // NOLINT(concurrency-mt-unsafe): no threads yet
        << "name the folder of the transports";
    if (unshare(CLONE_NEWNET) == 0 || unshare(CLONE_NEWUSER | CLONE_NEWNET) == 0)
      bring_loopback_up();
    else
      domain = 100 + getpid() % 60 * 2;  // the best chance to be alone, with a second domain beside
  }
};
const auto* const isolation = testing::AddGlobalTestEnvironment(new Isolation);

void require(bool condition, const std::string& what) {
  if (!condition) throw std::runtime_error(what);
}

bool eventually(const std::function<bool()>& condition) {
  const auto end = std::chrono::steady_clock::now() + time_limit;
  while (!condition()) {
    if (std::chrono::steady_clock::now() > end) return false;
    std::this_thread::sleep_for(1ms);
  }
  return true;
}

std::int64_t monotonic_ns() {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  return std::int64_t{now.tv_sec} * 1'000'000'000 + now.tv_nsec;
}

// A process that runs a function; what the function throws is its result.
class Process {
 public:
  explicit Process(const std::function<void(const std::function<void()>& await_end)>& run) {
    int end[2];
    int result[2];
    if (pipe2(end, O_CLOEXEC) != 0 || pipe2(result, O_CLOEXEC) != 0) throw std::runtime_error("no pipe");
    pid_ = fork();
    if (pid_ == 0) {
      prctl(PR_SET_PDEATHSIG, SIGKILL);
      close(end[1]);
      std::string text;
      try {
        run([&] {
          char nothing = 0;
          while (read(end[0], &nothing, 1) > 0) {
          }
        });
      } catch (const std::exception& e) {
        text = e.what();
      }
      _exit(write(result[1], text.data(), text.size()) == static_cast<ssize_t>(text.size()) ? 0 : 1);
    }
    close(end[0]);
    close(result[1]);
    end_ = end[1];
    result_ = result[0];
  }
  ~Process() {
    if (pid_ > 0) finish();
  }
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  // Asks it to end; returns what went wrong.
  std::string finish() {
    close(end_);
    std::string text;
    char bytes[256];
    for (ssize_t n = 0; (n = read(result_, bytes, sizeof bytes)) > 0;)
      text.append(bytes, static_cast<std::size_t>(n));
    close(result_);
    int status = 0;
    waitpid(pid_, &status, 0);
    pid_ = 0;
    if (WIFSIGNALED(status)) text += " died of signal " + std::to_string(WTERMSIG(status));
    if (WIFEXITED(status) && WEXITSTATUS(status) != 0)
      text += " ended with " + std::to_string(WEXITSTATUS(status));
    return text;
  }

 private:
  pid_t pid_ = 0;
  int end_ = -1;
  int result_ = -1;
};

std::string in_own_process(const std::function<void()>& run) {
  return Process([&](const auto&) { run(); }).finish();
}

Config config_of(Role role, Reliability reliability, Receive receive) {
  Config config;
  config.role = role;
  config.receive = receive;
  config.qos.reliability = reliability;
  config.max_payload_bytes = *std::max_element(std::begin(payload_sizes), std::end(payload_sizes));
  config.interface = "lo";
  config.address = "127.0.0.1";
  config.domain = domain;
  return config;
}

// An endpoint, and the thread that receives for it where it does not by itself.
class End {
 public:
  End(const std::string& transport, const Config& config, Sink& sink)
      : endpoint_(load(transport).open(config, sink)) {
    if (config.receive == Receive::waitset)
      receiver_ = std::thread([this] {
        while (!ends_) endpoint_->receive();
      });
  }
  ~End() {
    ends_ = true;
    endpoint_->interrupt();
    if (receiver_.joinable()) receiver_.join();
  }
  End(const End&) = delete;
  End& operator=(const End&) = delete;

  Endpoint* operator->() { return endpoint_.get(); }

 private:
  std::unique_ptr<Endpoint> endpoint_;
  std::atomic<bool> ends_{false};
  std::thread receiver_;
};

struct Echo final : Sink {
  void arrived(std::uint64_t sequence, std::span<std::byte> payload, std::int64_t) noexcept override {
    message::put_server_times(payload, marks);
    if (Endpoint* const to = endpoint) to->send(sequence, payload);
  }
  std::atomic<Endpoint*> endpoint{nullptr};
};

void serve(const std::string& transport, const Config& config, const std::function<void()>& await_end) {
  Echo echo;
  End end(transport, config, echo);
  echo.endpoint = end.operator->();
  await_end();
}

class Answers final : public Sink {
 public:
  struct Answer {
    std::uint64_t sequence;
    std::vector<std::byte> payload;
    std::int64_t arrival_ns;
  };

  void arrived(std::uint64_t sequence, std::span<std::byte> payload,
               std::int64_t arrival_ns) noexcept override {
    const std::lock_guard lock(mutex_);
    last_ = Answer{sequence, {payload.begin(), payload.end()}, arrival_ns};
    changed_.notify_one();
  }
  std::optional<Answer> await(std::uint64_t sequence) {
    std::unique_lock lock(mutex_);
    const bool came = changed_.wait_for(lock, 500ms, [&] { return last_ && last_->sequence == sequence; });
    return came ? last_ : std::nullopt;
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::optional<Answer> last_;
};

std::vector<std::byte> random_payload(std::size_t bytes, std::mt19937& random) {
  std::vector<std::byte> payload(bytes);
  for (std::byte& byte : payload) byte = static_cast<std::byte>(random());
  message::put_server_times(payload, {0, 0});
  return payload;
}

void exchange(End& end, Answers& answers, std::uint64_t sequence, std::vector<std::byte> payload) {
  std::optional<Answers::Answer> answer;
  const std::int64_t before_ns = monotonic_ns();
  // Best effort may lose a message, and so may reliable where only the last one is kept: hence repeated.
  const bool answered = eventually([&] {
    require(end->send(sequence, payload), "send refused " + std::to_string(payload.size()) + " bytes");
    answer = answers.await(sequence);
    return answer.has_value();
  });
  require(answered, "no answer to " + std::to_string(payload.size()) + " bytes");
  require(before_ns <= answer->arrival_ns && answer->arrival_ns <= monotonic_ns(), "a wrong arrival time");
  message::put_server_times(payload, marks);
  require(answer->payload == payload, "other bytes came back");
}

void await_match(End& end) {
  require(eventually([&] { return end->matched().both(); }), "not matched; seen: " + end->seen());
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

bool have(const std::string& transport) {
  const auto found = available();
  return std::find(found.begin(), found.end(), transport) != found.end();
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
};
INSTANTIATE_TEST_SUITE_P(All, DdsPair, testing::ValuesIn(pairs), name_of);

class Dds : public testing::TestWithParam<const char*> {
 protected:
  void SetUp() override {
    if (!have(GetParam())) GTEST_SKIP() << GetParam() << " is not built";
  }
  static Config client() { return config_of(Role::client, Reliability::best_effort, Receive::listener); }
  static Config server() { return config_of(Role::server, Reliability::best_effort, Receive::listener); }

  // What open() says to such a config.
  static std::string refusal(const Config& config) {
    return in_own_process([&] {
      Answers answers;
      End end(GetParam(), config, answers);
    });
  }
};
INSTANTIATE_TEST_SUITE_P(All, Dds, testing::Values("cyclonedds", "fastdds"),
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
  elsewhere.domain = domain + 1;
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

TEST_P(Dds, AnIncompatibleQosIsSeen) {
  Process serving([&](const auto& await_end) { serve(GetParam(), server(), await_end); });
  Config demanding = client();
  demanding.qos.reliability = Reliability::reliable;
  EXPECT_EQ(in_own_process([&] {
              Answers answers;
              End end(GetParam(), demanding, answers);
              const std::string expected = "a writer of rt/pong offers best-effort, we ask for reliable";
              require(eventually([&] { return end->seen() == expected; }), "seen: " + end->seen());
              require(!end->matched().both(), "matched all the same");
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

TEST_P(Dds, WhatItCannotDoIsRefused) {
  Config config = client();
  config.domain = 233;
  EXPECT_NE(refusal(config).find("domain 233"), std::string::npos);
  config = client();
  config.options["no-such"] = "1";
  EXPECT_NE(refusal(config).find("no-such"), std::string::npos);
  config = client();
  config.max_payload_bytes = std::size_t{1} << 40;
  EXPECT_NE(refusal(config).find("too large"), std::string::npos);
  config = client();
  config.interface = "no-such-if";
  EXPECT_NE(refusal(config).find("no-such-if"), std::string::npos);
  config = client();
  config.peers = {"127.0.0.1:99999"};
  EXPECT_NE(refusal(config).find("127.0.0.1:99999"), std::string::npos);
}

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
              Config config = config_of(Role::client, Reliability::best_effort, Receive::listener);
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
    Config config = config_of(Role::client, Reliability::best_effort, Receive::listener);
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
              Config config = config_of(Role::client, Reliability::best_effort, Receive::listener);
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
    Config config = config_of(Role::client, Reliability::best_effort, Receive::listener);
    config.options["profiles"] = path_;
    Answers answers;
    End end("fastdds", config, answers);
  });
  EXPECT_NE(refusal.find(path_), std::string::npos) << refusal;
}

}  // namespace
}  // namespace ontime::transport

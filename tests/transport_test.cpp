// SPDX-License-Identifier: Apache-2.0
#include "transport/transport.hpp"

#include <array>
#include <atomic>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <mutex>
#include <thread>

#include <arpa/inet.h>
#include <dirent.h>
#include <dlfcn.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/auxv.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "message/message.hpp"
#include "sinks.hpp"
#include "transport/clock.hpp"
#include "transport/dds.hpp"

namespace {
thread_local std::int64_t received_ns = 0;  // when the kernel last handed this thread a datagram
std::atomic<std::int64_t> last_launch_tai_ns = 0;
std::atomic<int> without_launch_time = 0;  // datagrams that were written
bool disk_fails = false;                   // no folder can be read to its end
}  // namespace

// This program stands between the transport and the kernel.
extern "C" ssize_t recvfrom(int fd, void* __restrict data, std::size_t bytes, int flags,
                            sockaddr* __restrict from, socklen_t* __restrict length) {
  const auto got = syscall(SYS_recvfrom, fd, data, bytes, flags, from, length);
  received_ns = ontime::transport::now_ns();
  return got;
}

extern "C" ssize_t sendmsg(int fd, const msghdr* message, int flags) {
  const auto* const head = CMSG_FIRSTHDR(message);
  if (head != nullptr && head->cmsg_type == SCM_TXTIME) {
    std::int64_t tai_ns = 0;
    std::memcpy(&tai_ns, CMSG_DATA(head), sizeof tai_ns);
    last_launch_tai_ns = tai_ns;
  }
  return syscall(SYS_sendmsg, fd, message, flags);
}
extern "C" ssize_t sendto(int fd, const void* data, std::size_t bytes, int flags, const sockaddr* to,
                          socklen_t length) {
  ++without_launch_time;
  return syscall(SYS_sendto, fd, data, bytes, flags, to, length);
}

extern "C" dirent* readdir(DIR* folder) {
  static const auto real = reinterpret_cast<dirent* (*)(DIR*)>(dlsym(RTLD_NEXT, "readdir"));
  auto* const entry = real(folder);
  if (entry == nullptr && disk_fails) errno = EIO;
  return entry;
}

namespace ontime::transport {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;

// Setting the system's time, by a daemon or a person, changes no measured time.
TEST(Clock, IsMonotonic) {
  const auto monotonic_ns = [] {
    timespec now{};
    clock_gettime(CLOCK_MONOTONIC, &now);
    return std::int64_t{now.tv_sec} * 1'000'000'000 + now.tv_nsec;
  };
  const auto before = monotonic_ns();
  const auto now = now_ns();
  EXPECT_LE(before, now);
  EXPECT_LE(now, monotonic_ns());
}

TEST(Load, FindsWhatIsThereAndNamesItOtherwise) {
  EXPECT_STREQ(load("udp").name, "udp");
  EXPECT_THAT(available(), testing::Contains("udp"));
  try {
    load("telepathy");
    FAIL();
  } catch (const Error& error) {
    EXPECT_THAT(error.what(),
                testing::AllOf(HasSubstr("telepathy"), HasSubstr("udp"), HasSubstr("looked in")));
  }
}

TEST(Load, FolderThatCannotBeReadIsNamedAndHidesNoTransport) {
  disk_fails = true;
  EXPECT_STREQ(load("udp").name, "udp");
  EXPECT_THAT(available(), testing::Contains("udp"));
  try {
    load("telepathy");
    ADD_FAILURE();
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("Input/output error"));
  }
  disk_fails = false;
}

TEST(Load, FifoIsNotWaitedForWithoutEnd) {
  const auto folder = std::filesystem::path(testing::TempDir()) / "ontime-fifos";
  const auto index = folder / "share/ament_index/resource_index/ontime_transport";
  std::filesystem::create_directories(index);
  mkfifo((folder / "ontime_transport_fifo.so").c_str(), 0600);
  mkfifo((index / "packaged").c_str(), 0600);
  // NOLINTBEGIN(concurrency-mt-unsafe): one thread
  const std::string before = std::getenv("ONTIME_TRANSPORT_PATH");
  setenv("ONTIME_TRANSPORT_PATH", (before + ":" + folder.string()).c_str(), 1);
  setenv("AMENT_PREFIX_PATH", folder.c_str(), 1);
  EXPECT_FALSE(declared("fifo"));
  EXPECT_FALSE(declared("packaged"));
  EXPECT_THAT([] { load("packaged"); },
              testing::ThrowsMessage<Error>(testing::HasSubstr((index / "packaged").string())));
  unsetenv("AMENT_PREFIX_PATH");
  setenv("ONTIME_TRANSPORT_PATH", before.c_str(), 1);
  // NOLINTEND(concurrency-mt-unsafe)
  std::filesystem::remove_all(folder);
}

// The object would be loaded, and its code would run.
TEST(Load, LooksForNoFileThatANameLeadsTo) {
  const auto there = std::filesystem::path(testing::TempDir()) / "ontime_transport_stranger.so";
  const auto elsewhere = std::filesystem::relative(there, std::filesystem::path("/")).string();
  for (const auto& name : {"../" + elsewhere, "/" + elsewhere, std::string("a/b"), std::string(".."),
                           std::string("."), std::string()}) {
    try {
      find(name);
      FAIL() << name;
    } catch (const Error& error) {
      EXPECT_THAT(error.what(), HasSubstr("is not a transport's name")) << name;
    }
    EXPECT_FALSE(declared(name)) << name;
  }
}

void expect_no_environment() {
  ASSERT_NE(std::getenv("ONTIME_TRANSPORT_PATH"), nullptr);  // NOLINT(concurrency-mt-unsafe)
  EXPECT_THAT(available(), testing::IsEmpty());
  try {
    load("udp");
    FAIL();
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), testing::AllOf(HasSubstr("ONTIME_TRANSPORT_PATH ignored"),
                                             HasSubstr("file capabilities"), HasSubstr("rtprio")));
  }
  const auto variable = dds::users_variable("ONTIME_TRANSPORT_PATH");
  EXPECT_EQ(variable.value, "");
  EXPECT_THAT(variable.ignored, HasSubstr("ONTIME_TRANSPORT_PATH"));
}

// By a copy of this program that belongs to another user and runs as that user; file capabilities look the
// same to it (getauxval(AT_SECURE)).
TEST(Load, FollowsNoEnvironmentWithPrivileges) {
  if (getauxval(AT_SECURE) != 0) {
    expect_no_environment();
    std::fflush(stdout);
    _exit(HasFailure() ? 1 : 0);  // before a leak checker, which cannot look into such a process
  }
  const std::string copy = testing::TempDir() + "ontime_transport_test_" + std::to_string(getpid());
  std::filesystem::copy_file("/proc/self/exe", copy);
  const bool can = chown(copy.c_str(), 65534, 65534) == 0 && chmod(copy.c_str(), 04755) == 0;
  struct statvfs folder {};
  statvfs(copy.c_str(), &folder);
  if (!can || (folder.f_flag & ST_NOSUID) != 0) {
    unlink(copy.c_str());
    GTEST_SKIP() << "only root can make such a copy, and only where the folder lets it run as another";
  }
  const std::string command = copy + " --gtest_filter=Load.FollowsNoEnvironmentWithPrivileges 2>&1";
  std::FILE* const child = popen(command.c_str(), "r");
  std::string said;
  for (int letter = 0; (letter = std::fgetc(child)) != EOF;) said += static_cast<char>(letter);
  const int status = pclose(child);
  unlink(copy.c_str());
  EXPECT_EQ(status, 0) << said;
}

TEST(Dds, NamesReasonsForUnseenPeer) {
  Config config;
  EXPECT_THAT(dds::others_without_our_topics(config, 0, {}), testing::ContainsRegex("firewall.*--peer"));
  config.peers = {"127.0.0.1"};
  EXPECT_THAT(dds::others_without_our_topics(config, 0, {}),
              testing::AllOf(testing::HasSubstr("firewall"), testing::Not(testing::HasSubstr("--peer"))));
  config.security.emplace();
  EXPECT_THAT(dds::others_without_our_topics(config, 0, {}),
              testing::ContainsRegex("firewall.*; or: DDS Security admits only"));
  EXPECT_THAT(dds::others_without_our_topics(config, 1, {}),
              testing::ContainsRegex("1 other DDS participant.*; DDS Security admits only"));
}

// And looks at the moment: that of the datagram which this thread was handed, and not an earlier one.
class KeepTimed final : public Keep {
 public:
  void arrived(std::uint64_t sequence, std::span<std::byte> payload,
               std::int64_t arrival_ns) noexcept override {
    EXPECT_GT(received_ns, 0);
    EXPECT_GE(arrival_ns, received_ns);
    Keep::arrived(sequence, payload, arrival_ns);
  }
};

template <typename Done>
bool within_a_while(Done done) {
  return within(60s, done);
}

class Udp : public testing::Test {
 protected:
  Udp() {
    config.max_payload_bytes = 60'000;
    config.address = "127.0.0.1";
    config.domain = 4'000 + getpid() % 20'000;  // below the ports that any client may have
    config.peers = {"127.0.0.1"};
  }
  std::unique_ptr<Endpoint> open(Role role, Sink& sink) {
    auto copy = config;
    copy.role = role;
    return load("udp").open(copy, sink);
  }
  Config config;
};

TEST_F(Udp, CarriesEverySizeThereAndBack) {
  Echo echo;
  const auto server = open(Role::server, echo);
  echo.endpoint = server.get();
  KeepTimed keep;
  const auto client = open(Role::client, keep);
  ASSERT_TRUE(within_a_while([&] { return client->matched().both(); }));
  for (const std::size_t size : {0, 1, 15, 16, 500, 1472, 1473, 60'000}) {
    std::vector<std::byte> payload(size);
    for (std::size_t i = 0; i < size; ++i) payload[i] = static_cast<std::byte>(i * 7);
    const int before = keep.arrivals;
    ASSERT_TRUE(client->send(size, payload));
    ASSERT_TRUE(within_a_while([&] { return keep.arrivals > before; })) << size;
    const std::lock_guard lock(keep.mutex);
    EXPECT_EQ(keep.last_sequence, size);
    EXPECT_EQ(keep.last, payload);
  }
  EXPECT_FALSE(client->send(1, std::vector<std::byte>(60'001)));
  EXPECT_EQ(client->facts().at("carrier"), "UDPv4");
}

// All of it, from the first word on, for an etf drops what does not: and each its own.
TEST_F(Udp, SaysWhenWhatItSendsIsToLeave) {
  config.launch_ns = 1'000'000;
  Echo echo;
  std::unique_ptr<Endpoint> server;
  try {
    server = open(Role::server, echo);
  } catch (const Error& refused) {
    EXPECT_THAT(refused.what(), HasSubstr("CAP_NET_ADMIN"));
    GTEST_SKIP() << refused.what();
  }
  echo.endpoint = server.get();
  KeepTimed keep;
  without_launch_time = 0;
  const auto client = open(Role::client, keep);
  ASSERT_TRUE(within_a_while([&] { return client->matched().both(); }));
  const std::vector<std::byte> payload(500);
  ASSERT_TRUE(client->send(1, payload));
  ASSERT_TRUE(within_a_while([&] { return keep.arrivals == 1; }));
  EXPECT_EQ(without_launch_time, 0);
  EXPECT_GT(last_launch_tai_ns, 0);
  const auto ahead_ns = [] {  // of CLOCK_TAI
    timespec tai{};
    clock_gettime(CLOCK_TAI, &tai);
    return std::int64_t{tai.tv_sec} * 1'000'000'000 + tai.tv_nsec - now_ns();
  }();
  echo.endpoint = nullptr;
  for (const auto after_ns : {1'000'000'000LL, 1'003'000'000LL}) {
    const auto at_ns = now_ns() + after_ns;
    ASSERT_TRUE(client->launch(2, payload, at_ns));
    EXPECT_LT(std::abs(last_launch_tai_ns - (at_ns + ahead_ns)), 500'000'000);
  }
}

TEST_F(Udp, ClientOutlivesARestartOfTheServer) {
  KeepTimed keep;
  Echo first_echo;
  Echo echo;
  auto server = open(Role::server, first_echo);
  const auto client = open(Role::client, keep);
  ASSERT_TRUE(within_a_while([&] { return client->matched().both(); }));
  server.reset();
  server = open(Role::server, echo);  // with another key
  echo.endpoint = server.get();
  EXPECT_TRUE(within_a_while([&] {
    client->send(1, std::vector<std::byte>(500));
    return keep.arrivals > 0;
  }));
}

// A sender that forges the address of its datagrams does not know what we send there.
TEST_F(Udp, ServerAnswersNoMessageWithoutItsCookieAndNeverWithMoreBytes) {
  Echo echo;
  const auto server = open(Role::server, echo);
  echo.endpoint = server.get();
  const int spoofer = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  const timeval patience{0, 200'000};
  setsockopt(spoofer, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(static_cast<std::uint16_t>(7900 + config.domain));
  inet_pton(AF_INET, "127.0.0.1", &to.sin_addr);
  ASSERT_EQ(connect(spoofer, reinterpret_cast<sockaddr*>(&to), sizeof to), 0);

  std::array<std::byte, 600> datagram{};
  const std::array<std::uint32_t, 4> header{0x6d746e6f, 3, 0x1234,
                                            0x5678};  // a message with a guessed cookie
  std::memcpy(datagram.data(), header.data(), sizeof header);
  const auto bytes = sizeof header + message::encode(1, std::vector<std::byte>(500),
                                                     std::span(datagram).subspan(sizeof header));
  for (std::size_t length = 0; length <= bytes; length += 4) {
    ASSERT_EQ(send(spoofer, datagram.data(), length, 0), static_cast<ssize_t>(length));
    if (length != 16 && length != bytes && length != 12) continue;
    std::array<std::byte, 2000> answer{};
    while (true) {
      const auto got = recv(spoofer, answer.data(), answer.size(), 0);
      if (got < 0) break;
      EXPECT_LE(got, 16) << "a cookie at most";
      EXPECT_GE(length, 16U) << "and none for less than its own size";
    }
  }
  EXPECT_EQ(echo.arrivals, 0);
  close(spoofer);
}

TEST_F(Udp, SaysWhatIsWrongAtOpening) {
  KeepTimed keep;
  const auto error = [&](Role role) -> std::string {
    try {
      open(role, keep);
    } catch (const Error& failure) {
      return failure.what();
    }
    return "none";
  };
  const auto server = open(Role::server, keep);
  EXPECT_THAT(error(Role::server),  // both as `ontime pong` has it, and as a scenario
              AllOf(HasSubstr("busy"), HasSubstr("--domain N"), HasSubstr("domain: N"),
                    HasSubstr("--option port=N"), HasSubstr("options.port: N")));
  config.peers = {};
  EXPECT_THAT(error(Role::client), HasSubstr("--peer"));
  config.peers = {"127.0.0.1:99999"};
  EXPECT_THAT(error(Role::client), HasSubstr("'99999' is not a UDP port"));
  config.peers = {"no-such-host.invalid"};
  EXPECT_THAT(error(Role::client), HasSubstr("no-such-host.invalid"));
  config.max_payload_bytes = 65'500;
  EXPECT_THAT(error(Role::server), HasSubstr("65500"));
}

TEST_F(Udp, RefusesWhatItHasNot) {
  KeepTimed keep;
  config.options = {{"port", "many"}};
  EXPECT_THROW(open(Role::server, keep), WrongInput);
  config.options = {};
  config.domain = 60'000;
  EXPECT_THROW(open(Role::server, keep), WrongInput);
}

TEST_F(Udp, AnotherProgramOnThePortIsNoSilentHost) {
  const int other = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  sockaddr_in at{};
  at.sin_family = AF_INET;
  at.sin_port = htons(static_cast<std::uint16_t>(7900 + config.domain));
  inet_pton(AF_INET, "127.0.0.1", &at.sin_addr);
  ASSERT_EQ(bind(other, reinterpret_cast<sockaddr*>(&at), sizeof at), 0);
  KeepTimed keep;
  const auto client = open(Role::client, keep);
  EXPECT_THAT(client->seen(), HasSubstr("no reply"));
  client->matched();
  std::array<char, 100> hello{};
  socklen_t length = sizeof at;
  ASSERT_GT(recvfrom(other, hello.data(), hello.size(), 0, reinterpret_cast<sockaddr*>(&at), &length), 0);
  ASSERT_EQ(sendto(other, "what?", 5, 0, reinterpret_cast<sockaddr*>(&at), length), 5);
  EXPECT_TRUE(within_a_while([&] { return client->seen().find("is no pong") != std::string::npos; }));
  EXPECT_FALSE(client->matched().both());
  close(other);
}

TEST_F(Udp, SaysSinceWhenItHasAPeer) {
  Echo echo;
  const auto server = open(Role::server, echo);
  KeepTimed keep;
  const auto client = open(Role::client, keep);
  EXPECT_EQ(server->matched().changed_ns, 0);
  ASSERT_TRUE(within_a_while([&] { return client->matched().both(); }));
  EXPECT_GT(client->matched().changed_ns, 0);
  EXPECT_LE(client->matched().changed_ns, now_ns());
}

// Nothing receives, so the socket's buffer fills.
TEST_F(Udp, TellsWhatFoundNoRoom) {
  config.receive = Receive::waitset;
  KeepTimed keep;
  const auto server = open(Role::server, keep);
  config.receive = Receive::listener;
  const auto client = open(Role::client, keep);
  EXPECT_EQ(server->losses().overwritten, 0U);
  EXPECT_EQ(server->losses().on_the_way, std::nullopt);
  const std::vector<std::byte> large(60'000);
  EXPECT_TRUE(within_a_while([&] {
    client->send(1, large);
    return server->losses().overwritten.value_or(0) > 0;
  }));
  const auto lost = *server->losses().overwritten;
  for (int i = 0; i < 10; ++i) client->send(1, large);
  EXPECT_EQ(server->losses().overwritten, lost + 10);
}

TEST_F(Udp, WaitsetEndsWhenInterrupted) {
  config.receive = Receive::waitset;
  KeepTimed keep;
  for (const auto role : {Role::server, Role::client}) {
    const auto endpoint = open(role, keep);
    std::thread waiting([&] { endpoint->receive(); });
    std::this_thread::sleep_for(5ms);
    endpoint->interrupt();
    waiting.join();
    endpoint->receive();  // and every later one
    EXPECT_TRUE(endpoint->threads().empty());
  }
}

}  // namespace
}  // namespace ontime::transport

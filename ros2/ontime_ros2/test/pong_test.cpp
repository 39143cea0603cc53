// SPDX-License-Identifier: Apache-2.0
// The server as a node, as a user of ROS 2 starts it, and a server node that a user wrote.
#include <array>
#include <chrono>
#include <filesystem>
#include <string>
#include <thread>
#include <vector>

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <linux/capability.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "ends.hpp"
#include "message/message.hpp"

namespace ontime::transport {
namespace {

using namespace std::chrono_literals;
using testing::AllOf;
using testing::ContainsRegex;
using testing::HasSubstr;
using testing::Not;

// A program that lies beside this one, and all that it says.
class Program {
 public:
  Program(
      const std::string& name, std::vector<std::string> arguments,
      const std::function<void()>& before = [] {}) {
    const auto file = std::filesystem::read_symlink("/proc/self/exe").parent_path() / name;
    int said[2];
    if (pipe2(said, O_CLOEXEC) != 0) throw std::system_error(errno, std::system_category(), "pipe");
    arguments.insert(arguments.begin(), file.string());
    std::vector<char*> raw;
    raw.reserve(arguments.size() + 1);
    for (std::string& argument : arguments) raw.push_back(argument.data());
    raw.push_back(nullptr);
    pid_ = fork();
    if (pid_ == 0) {
      prctl(PR_SET_PDEATHSIG, SIGKILL);
      before();
      dup2(said[1], STDOUT_FILENO);
      dup2(said[1], STDERR_FILENO);
      execv(file.c_str(), raw.data());
      _exit(127);
    }
    close(said[1]);
    said_ = said[0];
  }
  ~Program() {
    if (pid_ != 0) end();
    close(said_);
  }
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;

  // Reads on until it says that; false if it ends before.
  bool says(const std::string& text) {
    while (output_.find(text) == std::string::npos) {
      std::array<char, 4096> bytes;
      const ssize_t count = read(said_, bytes.data(), bytes.size());
      if (count <= 0) return false;
      output_.append(bytes.data(), static_cast<std::size_t>(count));
    }
    return true;
  }
  // Its exit code, once it ends by itself.
  int exit_code() {
    says("\1 never");
    int status = 0;
    waitpid(std::exchange(pid_, 0), &status, 0);
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }
  void end() {
    kill(pid_, SIGTERM);
    waitpid(std::exchange(pid_, 0), nullptr, 0);
  }
  const std::string& output() const { return output_; }

 private:
  pid_t pid_ = 0;
  int said_ = -1;
  std::string output_;
};

Program pong(
    const std::string& rmw, std::vector<std::string> ros_arguments,
    const std::function<void()>& before = [] {}) {
  if (!ros_arguments.empty()) ros_arguments.insert(ros_arguments.begin(), "--ros-args");
  return {"pong", std::move(ros_arguments), [&] {
            set("RMW_IMPLEMENTATION", rmw);
            before();
          }};
}

// What becomes of pings to those topics.
std::string ping(
    const std::string& rmw, const std::string& ping_topic, const std::string& pong_topic,
    const std::function<void(Config&)>& change = [](Config&) {}) {
  return in_own_process([&] {
    Config config = config_of(Role::client, {{"rmw", rmw}});
    config.ping_topic = ping_topic;
    config.pong_topic = pong_topic;
    change(config);
    Answers answers;
    const auto endpoint = two_ends::plugin().open(config, answers);
    require(two_ends::await_match(*endpoint), "no match; seen: " + endpoint->seen());
    exchange(*endpoint, answers, message::server_times_bytes);
  });
}

class Pong : public testing::TestWithParam<const char*> {};

TEST_P(Pong, AnswersWhereTheUserPutsIt) {
  const std::string rmw = GetParam();
  {
    auto in_namespace = pong(rmw, {"-r", "__ns:=/robot"});
    ASSERT_TRUE(in_namespace.says("answers /robot/ping on /robot/pong")) << in_namespace.output();
    EXPECT_EQ(ping(rmw, "/robot/ping", "/robot/pong"), "");
  }
  auto remapped = pong(rmw, {"-r", "/ping:=/arm/set_point", "-r", "/pong:=/arm/echo"});
  ASSERT_TRUE(remapped.says("answers /arm/set_point on /arm/echo")) << remapped.output();
  EXPECT_EQ(ping(rmw, "/arm/set_point", "/arm/echo"), "");
}

TEST_P(Pong, IsInTheDomainOfTheEnvironment) {
  const std::string rmw = GetParam();
  auto there = pong(rmw, {}, [] { set("ROS_DOMAIN_ID", "42"); });
  ASSERT_TRUE(there.says("in domain 42")) << there.output();
  // The transport's domain is what it is told, whatever the environment has.
  EXPECT_EQ(ping(rmw, "/ping", "/pong", [](Config& config) { config.domain = 42; }), "");
}

TEST_P(Pong, GivesPrioritiesByWhatThreadsDoAndSaysThem) {
  auto ends = pong(GetParam(), {"-p", "priority:=3", "-p", "background_priority:=2"});
  if (!ends.says("answers /ping")) {
    EXPECT_THAT(ends.output(), AllOf(HasSubstr("cannot give SCHED_FIFO 3"), HasSubstr("rtprio")));
    GTEST_SKIP() << "this process may not have real-time priorities";
  }
  std::istringstream lines(ends.output());
  int passed = 0, others = 0;
  for (std::string line; std::getline(lines, line);) {
    if (line.find("thread ") == line.npos) continue;
    if (line.find("(resend)") != line.npos) {
      EXPECT_THAT(line,
                  HasSubstr("SCHED_OTHER"));  // it would spin for locks of those that it keeps from running
      continue;
    }
    const bool is_passed = line.find("(receive)") != line.npos || line.find("(delivery)") != line.npos ||
                           line.find("(send)") != line.npos;
    EXPECT_THAT(line, HasSubstr(is_passed ? "SCHED_FIFO 3" : "SCHED_FIFO 2"));
    ++(is_passed ? passed : others);
  }
  EXPECT_GE(passed, 2) << ends.output();  // the executor's, and one of the DDS
  EXPECT_GE(others, 2) << ends.output();
}

// What Fast DDS takes by itself between two ends of one machine.
TEST(PongsThreads, SharedMemoryReceiversGetThePriority) {
  auto ends = pong("rmw_fastrtps_cpp", {"-p", "priority:=3"});
  if (!ends.says("answers /ping")) GTEST_SKIP() << ends.output();
  EXPECT_THAT(ends.output(), ContainsRegex(":shm[0-9]+ \\(receive\\): SCHED_FIFO 3"));
}

TEST_P(Pong, LeavesTheBackgroundAloneUnlessAsked) {
  auto ends = pong(GetParam(), {"-p", "priority:=3"});
  if (!ends.says("answers /ping")) GTEST_SKIP() << ends.output();
  EXPECT_THAT(ends.output(), AllOf(HasSubstr("executor (receive): SCHED_FIFO 3"), HasSubstr("SCHED_OTHER"),
                                   Not(HasSubstr("discovery): SCHED_FIFO"))));
}

INSTANTIATE_TEST_SUITE_P(On, Pong, testing::ValuesIn(rmws),
                         [](const auto& each) { return std::string(each.param); });

TEST(PongsParameters, InvalidParameterEndsPong) {
  struct Case {
    const char* parameter;
    const char* said;
  };
  for (const auto& [parameter, said] :
       {Case{"priority:=120", "is not a priority: 1 to 99"}, Case{"priority:=high", "of type {integer}"},
        Case{"depth:=0", "depth: 0 is less than 1"},
        Case{"priorty:=50", "'priorty'; known: background_priority"},
        Case{"reliability:=perhaps", "'perhaps' is not one of reliable, best-effort"}}) {
    auto ends = pong("rmw_cyclonedds_cpp", {"-p", parameter});
    EXPECT_EQ(ends.exit_code(), 2) << parameter;
    EXPECT_THAT(ends.output(), HasSubstr(said));
  }
}

TEST(PongsParameters, DeniedParameterIsReported) {
  auto ends = pong("rmw_cyclonedds_cpp", {"-p", "priority:=3"}, [] {
    const rlimit none{0, 0};
    setrlimit(RLIMIT_RTPRIO, &none);
    prctl(PR_CAPBSET_DROP, CAP_SYS_NICE);  // fails for who has it not
  });
  EXPECT_EQ(ends.exit_code(), 3);
  EXPECT_THAT(ends.output(), AllOf(HasSubstr("SCHED_FIFO 3"), HasSubstr("rtprio")));
}

// No more than a subscription, a publisher and the environment as ROS 2 leaves it.
std::string ping_a_node_of_the_users(const std::string& rmw) {
  const Program echo("bare_ros2", {"pong"}, [&] { set("RMW_IMPLEMENTATION", rmw); });
  return ping(rmw, "/ping", "/pong");
}

TEST(NodeOfTheUsers, Answers) {
  for (const std::string rmw : rmws) EXPECT_EQ(ping_a_node_of_the_users(rmw), "") << rmw;
}

// There the middlewares look for each other by multicast, as on a real link.
TEST(NodeOfTheUsers, AnswersWhereLoopbackHasMulticast) {
  if (!isolated()) GTEST_SKIP() << "the host's own lo is left alone";
  give_loopback_multicast(true);
  for (const std::string rmw : rmws) EXPECT_EQ(ping_a_node_of_the_users(rmw), "") << rmw;
  give_loopback_multicast(false);
}

}  // namespace
}  // namespace ontime::transport

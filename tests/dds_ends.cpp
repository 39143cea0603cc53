// SPDX-License-Identifier: Apache-2.0
#include "dds_ends.hpp"

#include <algorithm>
#include <chrono>
#include <cstdlib>

#include <fcntl.h>
#include <net/if.h>
#include <sched.h>
#include <signal.h>
#include <sys/ioctl.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "transport/clock.hpp"

namespace ontime::transport::test {
namespace {

using namespace std::chrono_literals;

// Only so that a broken transport does not hang the test. Longer than Fast DDS's lease of 20 s, for which one
// is still matched whose farewell, a single datagram, was lost.
constexpr auto time_limit = 40s;

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
    // Without it everything would be skipped, unnoticed.
    ASSERT_NE(std::getenv("ONTIME_TRANSPORT_PATH"), nullptr)  // NOLINT(concurrency-mt-unsafe): no threads yet
        << "name the folder of the transports";
    if (unshare(CLONE_NEWNET) == 0 || unshare(CLONE_NEWUSER | CLONE_NEWNET) == 0)
      bring_loopback_up();
    else
      domain = 100 + getpid() % 60 * 2;  // the best chance to be alone, with a second domain beside
  }
};
const auto* const isolation = testing::AddGlobalTestEnvironment(new Isolation);

}  // namespace

int free_domain() { return domain; }

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

Process::Process(const std::function<void(const std::function<void()>& await_end)>& run) {
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

Process::~Process() {
  if (pid_ > 0) finish();
}

std::string Process::finish() {
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

std::string in_own_process(const std::function<void()>& run) {
  return Process([&](const auto&) { run(); }).finish();
}

Config config_of(Role role, Reliability reliability, Receive receive) {
  Config config;
  config.role = role;
  config.receive = receive;
  config.qos.reliability = reliability;
  config.max_payload_bytes = max_payload_bytes;
  config.interface = "lo";
  config.address = "127.0.0.1";
  config.domain = domain;
  return config;
}

bool have(const std::string& transport) {
  const auto found = available();
  return std::find(found.begin(), found.end(), transport) != found.end();
}

End::End(const std::string& transport, const Config& config, Sink& sink)
    : endpoint_(load(transport).open(config, sink)) {
  if (config.receive == Receive::waitset)
    receiver_ = std::thread([this] {
      while (!ends_) endpoint_->receive();
    });
}

End::~End() {
  ends_ = true;
  endpoint_->interrupt();
  if (receiver_.joinable()) receiver_.join();
}

void serve(const std::string& transport, const Config& config, const std::function<void()>& await_end) {
  Echo echo;
  End end(transport, config, echo);
  echo.endpoint = end.operator->();
  await_end();
}

void Answers::arrived(std::uint64_t sequence, std::span<std::byte> payload,
                      std::int64_t arrival_ns) noexcept {
  const std::lock_guard lock(mutex_);
  last_ = Answer{sequence, {payload.begin(), payload.end()}, arrival_ns};
  changed_.notify_one();
}

std::optional<Answers::Answer> Answers::await(std::uint64_t sequence) {
  std::unique_lock lock(mutex_);
  const bool came = changed_.wait_for(lock, 500ms, [&] { return last_ && last_->sequence == sequence; });
  return came ? last_ : std::nullopt;
}

void exchange(End& end, Answers& answers, std::uint64_t sequence, std::vector<std::byte> payload) {
  std::optional<Answers::Answer> answer;
  const std::int64_t before_ns = now_ns();
  // Best effort may lose a message, and so may reliable where only the last one is kept: hence repeated.
  const bool answered = eventually([&] {
    require(end->send(sequence, payload), "send refused " + std::to_string(payload.size()) + " bytes");
    answer = answers.await(sequence);
    return answer.has_value();
  });
  require(answered, "no answer to " + std::to_string(payload.size()) + " bytes");
  require(before_ns <= answer->arrival_ns && answer->arrival_ns <= now_ns(), "a wrong arrival time");
  message::put_server_times(payload, marks);
  require(answer->payload == payload, "other bytes came back");
}

void await_match(End& end) {
  require(eventually([&] { return end->matched().both(); }), "not matched; seen: " + end->seen());
}

std::string refusal(const std::string& transport, const Config& config) {
  return in_own_process([&] {
    Answers answers;
    try {
      End end(transport, config, answers);
    } catch (const WrongInput& wrong) {
      throw std::runtime_error(std::string("wrong input: ") + wrong.what());
    }
  });
}

}  // namespace ontime::transport::test

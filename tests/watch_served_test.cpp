// SPDX-License-Identifier: Apache-2.0
// What Prometheus is served: only metrics, also beside odd and silent clients.
#include <atomic>
#include <cstring>
#include <thread>

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include "watch/watch.hpp"

namespace ontime::watch {
namespace {

using namespace std::chrono_literals;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

// --- HTTP ---

class Served : public ::testing::Test {
 protected:
  Served() { metrics_.set("ontime_measuring 1\n"); }
  ~Served() override {
    for (const int socket : sockets_) ::close(socket);
  }

  int connect(std::uint32_t from = INADDR_LOOPBACK) { return connect(metrics_, from); }
  int connect(const Metrics& metrics, std::uint32_t from = INADDR_LOOPBACK) {
    const auto address = metrics.address();
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(static_cast<std::uint16_t>(std::stoi(address.substr(address.rfind(':') + 1))));
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    const int socket = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockets_.push_back(socket);
    const timeval patience{20, 0};
    ::setsockopt(socket, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    sockaddr_in own = to;
    own.sin_port = 0;
    own.sin_addr.s_addr = htonl(from);
    EXPECT_EQ(::bind(socket, reinterpret_cast<const sockaddr*>(&own), sizeof own), 0);
    EXPECT_EQ(::connect(socket, reinterpret_cast<const sockaddr*>(&to), sizeof to), 0);
    return socket;
  }
  static std::string read_all(int socket) {
    std::string text;
    char buffer[4096];
    for (ssize_t n = 0; (n = ::recv(socket, buffer, sizeof buffer, 0)) > 0;)
      text.append(buffer, static_cast<std::size_t>(n));
    return text;
  }
  std::string ask(const std::string& request) { return ask(metrics_, request); }
  std::string ask(const Metrics& metrics, const std::string& request) {
    const int socket = connect(metrics);
    EXPECT_EQ(::send(socket, request.data(), request.size(), MSG_NOSIGNAL),
              static_cast<ssize_t>(request.size()));
    return read_all(socket);
  }

  Metrics metrics_{"127.0.0.1:0"};
  std::vector<int> sockets_;
};

TEST_F(Served, NewestTextIsAwaitedByWhoHasFetchedAnother) {
  metrics_.set("ontime_measuring 1\n");
  EXPECT_FALSE(metrics_.is_awaited()) << "no client fetches";
  ask("GET /metrics HTTP/1.1\r\nHost: x\r\n\r\n");
  ask("GET /x HTTP/1.1\r\nHost: x\r\n\r\n");
  EXPECT_FALSE(metrics_.is_awaited());
  metrics_.set("ontime_measuring 0\n");
  ask("GET /x HTTP/1.1\r\nHost: x\r\n\r\n");
  EXPECT_TRUE(metrics_.is_awaited());
  ask("GET /metrics HTTP/1.1\r\nHost: x\r\n\r\n");
  EXPECT_FALSE(metrics_.is_awaited());
}

TEST_F(Served, OnlyMetricsAreServed) {
  const auto answer = ask("GET /metrics HTTP/1.1\r\nHost: x\r\n\r\n");
  EXPECT_THAT(answer, StartsWith("HTTP/1.1 200"));
  EXPECT_THAT(answer, HasSubstr("text/plain; version=0.0.4"));
  EXPECT_THAT(answer, HasSubstr("\r\n\r\nontime_measuring 1\n"));
  EXPECT_THAT(ask("GET / HTTP/1.1\r\nHost: x\r\n\r\n"), StartsWith("HTTP/1.1 404"));
  EXPECT_THAT(ask("DELETE /metrics HTTP/1.1\r\nHost: x\r\n\r\n"), StartsWith("HTTP/1.1 405"));
  const auto head = ask("HEAD /metrics HTTP/1.1\r\nHost: x\r\n\r\n");
  EXPECT_THAT(head, StartsWith("HTTP/1.1 200"));
  EXPECT_THAT(head, Not(HasSubstr("ontime_measuring")));
}

TEST_F(Served, InvalidRequestDoesNotStopTheNext) {
  const std::string bad[] = {
      "\r\n\r\n\r\n\r\n",
      std::string(100, '\0'),
      "GET\r\n\r\n",
      "SSH-2.0-x\r\n",
      "GET /metrics HTTP/9.9\r\n\r\n",
      "\x16\x03\x01\x02",
      "POST /metrics HTTP/1.1\r\nContent-Length: 99999999\r\n\r\nx",
      "GET /metrics HTTP/1.1\r\nContent-Length: -1\r\n\r\n",
      "GET /" + std::string(20'000, 'a') + " HTTP/1.1\r\n\r\n",
      "GET /metrics HTTP/1.1\r\n" + std::string(500, 'h') + ": " + std::string(9'000, 'v') + "\r\n\r\n"};
  for (const auto& request : bad) {
    const int socket = connect();
    ::send(socket, request.data(), request.size(), MSG_NOSIGNAL);
    ::shutdown(socket, SHUT_WR);
    EXPECT_THAT(read_all(socket), Not(HasSubstr("ontime_measuring"))) << request.substr(0, 40);
  }
  EXPECT_THAT(ask("GET /metrics HTTP/1.1\r\nHost: x\r\n\r\n"), HasSubstr("ontime_measuring 1"));
}

TEST_F(Served, SilentClientsTimeOutSoThatOthersAreServed) {
  for (int i = 0; i < 6; ++i) {
    const int socket = connect();
    ::send(socket, "GET /met", 8, MSG_NOSIGNAL);
  }
  EXPECT_THAT(ask("GET /metrics HTTP/1.1\r\nHost: x\r\n\r\n"), HasSubstr("ontime_measuring 1"));
  EXPECT_THAT(read_all(sockets_.front()), Not(HasSubstr("ontime_measuring")));
}

constexpr const char* get = "GET /metrics HTTP/1.1\r\nHost: x\r\n\r\n";

TEST_F(Served, OldTextIsNoAnswer) {
  Metrics hanging("127.0.0.1:0", {.fresh = 0ms, .patience = 0ms, .valid = 0ms});
  EXPECT_THAT(ask(hanging, get), StartsWith("HTTP/1.1 503"));
  hanging.set("ontime_measuring 1\n");
  const auto answer = ask(hanging, get);
  EXPECT_THAT(answer, StartsWith("HTTP/1.1 503"));
  EXPECT_THAT(answer, Not(HasSubstr("ontime_measuring")));
  EXPECT_FALSE(hanging.is_awaited()) << "it was not sent";
  hanging.end();
  EXPECT_THAT(ask(hanging, get), HasSubstr("ontime_measuring 1")) << "none follows";
}

TEST_F(Served, RequestThatWaitsIsNoSilentClient) {
  Metrics hanging("127.0.0.1:0", {.fresh = 0ms, .patience = 2500ms, .valid = 0ms});
  EXPECT_THAT(ask(hanging, get), StartsWith("HTTP/1.1 503"));
}

TEST_F(Served, RequestWaitsForTheNextText) {
  Metrics asked("127.0.0.1:0", {.fresh = 0ms, .patience = 1h, .valid = 1h});
  asked.set("ontime_measuring 1\n");
  EXPECT_FALSE(asked.is_wanted());
  std::thread caller([&] {
    while (!asked.is_wanted()) std::this_thread::sleep_for(1ms);
    asked.set("ontime_measuring 0\n");
  });
  EXPECT_THAT(ask(asked, get), HasSubstr("ontime_measuring 0"));
  caller.join();
  EXPECT_FALSE(asked.is_wanted());
}

// Each sends a byte in time for its connection to stay.
TEST_F(Served, ManyClientsOfOneAddressDoNotKeepOthersOut) {
  for (int i = 0; i < 64; ++i) {
    const int socket = connect(INADDR_LOOPBACK + 1);
    ::send(socket, "G", 1, MSG_NOSIGNAL);
  }
  std::atomic<bool> is_over = false;
  std::thread dripping([&, slow = sockets_] {
    while (!is_over) {
      for (const int socket : slow) ::send(socket, "G", 1, MSG_NOSIGNAL);
      std::this_thread::sleep_for(100ms);
    }
  });
  const int socket = connect();
  const timeval patience{5, 0};  // the others stay for longer
  ::setsockopt(socket, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
  ::send(socket, get, std::strlen(get), MSG_NOSIGNAL);
  EXPECT_THAT(read_all(socket), HasSubstr("ontime_measuring 1"));
  is_over = true;
  dripping.join();
}

TEST(MetricsAddress, InvalidOrTakenAddressIsRefused) {
  for (const auto* wrong :
       {"", "x", "127.0.0.1:", "127.0.0.1:70000", "host:9464", ":9464", "127.0.0.1:-1", "[::1:9464 "})
    EXPECT_THROW(Metrics{wrong}, std::invalid_argument) << wrong;
  EXPECT_THAT(Metrics("0").address(), StartsWith("127.0.0.1:")) << "a port alone is on loopback";
  const Metrics first("127.0.0.1:0");
  EXPECT_THROW(Metrics(first.address()), std::runtime_error) << "another process has it";
  EXPECT_THROW(Metrics("192.0.2.1:9464"), std::runtime_error) << "no address of this machine";
}

}  // namespace
}  // namespace ontime::watch

// SPDX-License-Identifier: Apache-2.0
// A hand-written round trip over plain sockets: the reference for ontime's loop.
//   bare_udp pong PORT BYTES
//   bare_udp ping PORT BYTES SECONDS     round trips on loopback, a line of JSON
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <string>
#include <vector>

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/time.h>

#include "bare.hpp"

namespace {

sockaddr_in loopback(int port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  return address;
}

int pong(int fd, const sockaddr_in& address, std::vector<char> message) {
  if (bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) return bare::failed("bind");
  sockaddr_in from{};
  while (true) {
    socklen_t length = sizeof from;
    const auto bytes =
        recvfrom(fd, message.data(), message.size(), 0, reinterpret_cast<sockaddr*>(&from), &length);
    if (bytes < 0) return bare::failed("recvfrom");
    sendto(fd, message.data(), static_cast<std::size_t>(bytes), 0, reinterpret_cast<sockaddr*>(&from),
           length);
  }
}

int ping(int fd, const sockaddr_in& address, std::vector<char> message, double seconds) {
  // A datagram may be lost, and pong may start later than ping.
  const timeval timeout{0, 500'000};
  setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &timeout, sizeof timeout);
  if (connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0)
    return bare::failed("connect");
  bare::RoundTrips round_trips(seconds);
  std::vector<char> answer(message.size());
  for (std::uint64_t sequence = 0; !round_trips.done(); ++sequence) {
    std::memcpy(message.data(), &sequence, sizeof sequence);
    const auto sent_ns = bare::now_ns();
    send(fd, message.data(), message.size(), 0);
    const auto bytes = recv(fd, answer.data(), answer.size(), 0);
    const auto received_ns = bare::now_ns();
    const bool answered = bytes == static_cast<ssize_t>(message.size()) &&
                          std::memcmp(answer.data(), &sequence, sizeof sequence) == 0;
    round_trips.add(answered, sent_ns, received_ns);
  }
  return round_trips.print();
}

}  // namespace

int main(int argc, char** argv) {
  const std::vector<std::string> arguments(argv + 1, argv + argc);
  const int fd = socket(AF_INET, SOCK_DGRAM, 0);
  if (fd < 0) return bare::failed("socket");
  if (arguments.size() == 3 && arguments[0] == "pong")
    return pong(fd, loopback(std::stoi(arguments[1])), std::vector<char>(std::stoul(arguments[2])));
  if (arguments.size() == 4 && arguments[0] == "ping")
    return ping(fd, loopback(std::stoi(arguments[1])), std::vector<char>(std::stoul(arguments[2])),
                std::stod(arguments[3]));
  std::fputs("usage: bare_udp pong PORT BYTES | ping PORT BYTES SECONDS\n", stderr);
  return 2;
}

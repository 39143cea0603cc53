// SPDX-License-Identifier: Apache-2.0
// Both ends of a round trip, each in a process of its own, for a process keeps its first RMW.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <thread>

#include <sys/types.h>

#include "transport/transport.hpp"

namespace ontime::two_ends {

// The transport that lies beside this program, in the build tree as when installed.
const transport::Plugin& plugin();

// A network of this process's own where the kernel permits it; then no other program answers.
bool isolate();
bool set_loopback(int flag, bool on);  // an IFF_ of its interface; false if the kernel does not

struct Echo final : transport::Sink {
  void arrived(std::uint64_t sequence, std::span<std::byte> payload, std::int64_t) noexcept override {
    if (transport::Endpoint* const to = endpoint) to->send(sequence, payload);
  }
  std::atomic<transport::Endpoint*> endpoint{nullptr};
};

// A process that runs a function with a pipe's end to read from, which ends when it shall, and one to write
// its result to. What the function throws is the result too.
class Child {
 public:
  explicit Child(const std::function<void(int end, int result)>& run);
  ~Child();
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

  std::string result();                   // all of it, once
  std::string result(std::size_t bytes);  // the next of it; less where it ends
  void finish();                          // asks it to end, and waits; the destructor does so too

 private:
  pid_t pid_ = 0;
  int to_ = -1;
  int from_ = -1;
};

void await_end(int end);

// The thread that receives where the transport does not by itself.
class Receiving {
 public:
  Receiving(transport::Endpoint& endpoint, transport::Receive receive);
  ~Receiving();
  Receiving(const Receiving&) = delete;
  Receiving& operator=(const Receiving&) = delete;

 private:
  transport::Endpoint& endpoint_;
  std::atomic<bool> ends_{false};
  std::thread thread_;
};

// Answers until it shall end.
void serve(const transport::Config& config, int end);

bool await_match(transport::Endpoint& endpoint);

}  // namespace ontime::two_ends

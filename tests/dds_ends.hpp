// SPDX-License-Identifier: Apache-2.0
// Ends of a DDS transport for tests: each in a process of its own, for two vendors' libraries must never
// meet; all of it in a network namespace of its own where the kernel permits that.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include <gtest/gtest.h>
#include <sys/types.h>

#include "message/message.hpp"
#include "transport/transport.hpp"

namespace ontime::transport::test {

inline constexpr std::size_t max_payload_bytes = 131072;
inline constexpr message::ServerTimes marks{.received_ns = 0x1111, .sent_ns = 0x2222};

int free_domain();  // no other process uses it, nor the next one

void require(bool condition, const std::string& what);
bool eventually(const std::function<bool()>& condition);  // within a time so long that it means never

// A process that runs a function; what the function throws is its result.
class Process {
 public:
  explicit Process(const std::function<void(const std::function<void()>& await_end)>& run);
  ~Process();
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  std::string finish();  // asks it to end; returns what went wrong

 private:
  pid_t pid_ = 0;
  int end_ = -1;
  int result_ = -1;
};

std::string in_own_process(const std::function<void()>& run);

// On the loopback interface.
Config config_of(Role role, Reliability reliability = Reliability::best_effort,
                 Receive receive = Receive::listener);

bool have(const std::string& transport);

// An endpoint, and the thread that receives for it where it does not by itself.
class End {
 public:
  End(const std::string& transport, const Config& config, Sink& sink);
  ~End();
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

void serve(const std::string& transport, const Config& config, const std::function<void()>& await_end);

class Answers final : public Sink {
 public:
  struct Answer {
    std::uint64_t sequence;
    std::vector<std::byte> payload;
    std::int64_t arrival_ns;
  };

  void arrived(std::uint64_t sequence, std::span<std::byte> payload,
               std::int64_t arrival_ns) noexcept override;
  std::optional<Answer> await(std::uint64_t sequence);

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::optional<Answer> last_;
};

void exchange(End& end, Answers& answers, std::uint64_t sequence, std::vector<std::byte> payload);
void await_match(End& end);

// What opening such an end says, "wrong input: " before it if that is what it is; empty if it opens.
std::string refusal(const std::string& transport, const Config& config);

}  // namespace ontime::transport::test

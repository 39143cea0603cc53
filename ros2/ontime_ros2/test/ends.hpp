// SPDX-License-Identifier: Apache-2.0
// What the tests of the transport share: configurations, an end that awaits answers, and what opening throws.
#pragma once

#include <algorithm>
#include <condition_variable>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "transport/transport.hpp"
#include "two_ends/two_ends.hpp"

namespace ontime::transport {

using two_ends::Receiving;
using Options = std::map<std::string, std::string>;

inline constexpr std::size_t payload_sizes[] = {0, 1, 500, 32'768};
inline constexpr const char* rmws[] = {"rmw_cyclonedds_cpp", "rmw_fastrtps_cpp"};

// In the domain and on the link that all tests of a program share: lo, where the kernel permits in a network
// of its own.
Config config_of(Role role, const Options& options);

// Whether this program has a network of its own, and then whether lo has multicast there.
bool isolated();
void give_loopback_multicast(bool on);

void set(const char* name, const std::string& value);  // in the environment
void require(bool condition, const std::string& what);

// What the function throws, as text, after "wrong input: " if it is that; of a process of its own.
std::string in_own_process(const std::function<void()>& run);

std::string error_of(
    const Config& config, const std::function<void()>& before = [] {});

class Answers final : public Sink {
 public:
  void arrived(std::uint64_t sequence, std::span<std::byte> payload,
               std::int64_t arrival_ns) noexcept override;
  std::optional<std::vector<std::byte>> await(std::uint64_t sequence);

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::uint64_t sequence_ = 0;
  std::vector<std::byte> payload_;
};

// Sends every payload size and waits for its reply. The first `others_bytes` bytes of a reply may differ:
// ontime's server writes its times there.
void exchange(Endpoint& endpoint, Answers& answers, std::size_t others_bytes = 0);

}  // namespace ontime::transport

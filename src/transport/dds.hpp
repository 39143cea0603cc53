// SPDX-License-Identifier: Apache-2.0
// What every DDS transport does alike: what it accepts, and how it tells people what it saw.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <sys/types.h>

#include "transport/transport.hpp"

namespace ontime::transport::dds {

inline constexpr int max_domain = 232;            // the last domain with valid ports
inline constexpr int participants_per_host = 32;  // number of a peer's ports to try

// Ports of domain d, participant p, as RTPS has them: 7400 + 250 d + offset, and + 2 p where not multicast.
inline constexpr int base_port = 7400;
inline constexpr int ports_per_domain = 250;
inline constexpr const char* multicast_group = "239.255.0.1";

bool is_loopback(const std::string& address);

// A variable of the environment that has another value, or none, as long as this lives. An ordinary thread's,
// while no other reads the environment.
class Override {
 public:
  Override(const char* name, const std::optional<std::string>& value);
  ~Override() { set(before_); }
  Override(const Override&) = delete;
  Override& operator=(const Override&) = delete;

 private:
  void set(const std::optional<std::string>& value) const;

  const char* const name_;
  std::optional<std::string> before_;
};

// Not where this program has file capabilities: its caller would choose what it reads and loads.
bool follows_environment();

// A variable of the user's, empty if it is not set. If it is set and not followed, `ignored` says so.
struct Variable {
  std::string value;
  std::string ignored{};
};
Variable users_variable(const char* name);

// As they are on the wire: "rt/ping" for ROS 2's "/ping".
std::string topic_written(const Config& config);
std::string topic_read(const Config& config);

// A thread of this process. Those of a middleware are found by what was started while it opened.
struct Task {
  pid_t tid;
  std::string name;
};
std::string name_of(pid_t tid);
std::vector<Task> tasks();  // in order of their creation
std::vector<Task> started_since(const std::vector<Task>& before);

// Who is matched: set by the middleware's own threads, read by any without a lock.
class Matches {
 public:
  void set_readers(int count) noexcept { set(readers_, count); }
  void set_writers(int count) noexcept { set(writers_, count); }
  Matched now() const noexcept { return {readers_, writers_, changed_ns_}; }

 private:
  void set(std::atomic<int>& of, int count) noexcept;

  std::atomic<int> readers_{0}, writers_{0};
  std::atomic<std::int64_t> changed_ns_{0};
};

// Counts what is missing between the messages that were taken: each writer numbers its own. Real-time safe;
// noted by one thread at a time, read by any.
class Gaps {
 public:
  using Writer = std::array<std::uint8_t, 16>;  // its GUID
  void note(const Writer& writer, std::int64_t number) noexcept;
  std::uint64_t missing() const noexcept { return missing_.load(std::memory_order_relaxed); }

 private:
  struct Last {
    Writer writer{};
    std::int64_t number = 0;  // DDS begins with 1
  };
  std::array<Last, 16> lasts_{};  // the latest first; who has been silent for longest is forgotten
  std::atomic<std::uint64_t> missing_{0};
};

// Throws WrongInput for what no DDS transport can do, and Error where this host has not the link.
void check(const Config& config, const std::string& transport, std::span<const Option> options);

// What Endpoint::facts() tells. `source`: whence its configuration is.
std::map<std::string, std::string> facts(const Config& config, const std::string& middleware,
                                         const std::string& carrier, const std::string& source);

// Throws Error if this host has not that link, or it does not run.
void check_link(const Config& config, const std::string& transport);

// This process's internet sockets, by file descriptor; the kernel's number tells one from a later one that
// has the same descriptor.
using Sockets = std::map<int, std::uint64_t>;
Sockets sockets();

// Binds each that was opened since `before` to the link under test, if one is named: then the kernel sends
// and receives by no other, whatever a vendor's configuration or a peer says of addresses. (What two ends on
// one host send each other never leaves it.) Throws Error where the kernel does not.
void keep_to_link(const Sockets& before, const Config& config, const std::string& transport);

// Names participants on this host that search on another link than ours, for people; empty without such
// participants.
std::string others_elsewhere(const Config& config);

struct Peer {
  std::string address;     // IPv4
  std::uint16_t port = 0;  // 0: any participant of that host
};
// Of HOST[:PORT]. Throws WrongInput if that is no port, and Error if there is no such host.
Peer resolve(const std::string& peer, const std::string& transport);

// DDS says only for which policy it refused a match, by the number that the standard gives it. A reader may
// not request more than a writer offers, so the peer's value follows for policies with two values.
enum class Policy : std::uint32_t { other = 0, durability = 2, reliability = 11 };
std::string refused_writer(const Config& config, Policy policy);
std::string refused_reader(const Config& config, Policy policy);
std::string other_type(const std::string& topic, const std::string& type);
std::string others_without_our_topics(const Config& config, std::size_t participants, Matched matched);

}  // namespace ontime::transport::dds

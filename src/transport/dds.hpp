// SPDX-License-Identifier: Apache-2.0
// Shared by the DDS transports: checks of their configuration, and texts about what they saw.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include <sys/types.h>

#include "transport/transport.hpp"

namespace ontime::transport::dds {

inline constexpr int max_domain = 232;            // the last domain with valid ports
inline constexpr int participants_per_host = 32;  // number of a peer's ports to try

// RTPS ports of domain d, participant p: 7400 + 250 d + offset; for unicast also + 2 p.
inline constexpr int base_port = 7400;
inline constexpr int ports_per_domain = 250;
inline constexpr const char* multicast_group = "239.255.0.1";

bool is_loopback(const std::string& address);

// While it lives, a variable of the environment has another value, or none. Ordinary thread, while no other
// thread reads the environment.
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

// The user's variable; empty if it is not set. If it is set but not followed, `ignored` names it.
struct Variable {
  std::string value;
  std::string ignored{};
};
Variable users_variable(const char* name);

// The names on the wire: "rt/ping" for ROS 2's "/ping".
std::string topic_written(const Config& config);
std::string topic_read(const Config& config);

// A thread of this process. A middleware's threads are those that started while it opened.
struct Task {
  pid_t tid;
  std::string name;
};
std::string name_of(pid_t tid);
std::vector<Task> tasks();  // in order of their creation
std::vector<Task> started_since(const std::vector<Task>& before);

// Numbers of matched readers and writers: set by the middleware's threads, read by any thread without a lock.
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

// Counts missing messages by the gaps in each writer's numbers. Real-time safe; one thread at a time notes,
// any thread reads.
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
  std::array<Last, 16> lasts_{};  // the latest first; the longest silent writer is forgotten
  std::atomic<std::uint64_t> missing_{0};
};

// Throws WrongInput if no DDS transport can do it, and Error if this host does not have the link.
void check(const Config& config, const std::string& transport);

// For Endpoint::facts(). `source`: where its configuration comes from.
std::map<std::string, std::string> facts(const Config& config, const std::string& middleware,
                                         const std::string& carrier, const std::string& source);

// Throws Error if this host does not have that link, or the link does not run.
void check_link(const Config& config, const std::string& transport);

// This process's internet sockets: file descriptor and the kernel's inode, which differs for a later socket
// with the same descriptor.
using Sockets = std::map<int, std::uint64_t>;
Sockets sockets();

// Binds each socket that was opened since `before` to the link under test, if one is named. Then the kernel
// sends and receives only there, whatever addresses a vendor's configuration or a peer states. (Messages
// between two ends on one host never leave it.) Throws Error if the kernel refuses.
void keep_to_link(const Sockets& before, const Config& config, const std::string& transport);

// For people: participants on this host that search on another link; "": none.
std::string others_elsewhere(const Config& config);

struct Peer {
  std::string address;     // IPv4
  std::uint16_t port = 0;  // 0: any participant of that host
};
// Parses HOST[:PORT]. Throws WrongInput for an invalid port, and Error for an unknown host.
Peer resolve(const std::string& peer, const std::string& transport);

// DDS reports only the policy for which it refused a match, by its number in the standard. A reader may not
// request more than a writer offers, so for policies with two values this tells the peer's value.
enum class Policy : std::uint32_t { other = 0, durability = 2, reliability = 11 };
std::string refused_writer(const Config& config, Policy policy);
std::string refused_reader(const Config& config, Policy policy);
std::string other_type(const std::string& topic, const std::string& type);
std::string others_without_our_topics(const Config& config, std::size_t participants, Matched matched);

}  // namespace ontime::transport::dds

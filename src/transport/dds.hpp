// SPDX-License-Identifier: Apache-2.0
// What every DDS transport does alike: what it accepts, and how it tells people what it saw.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "transport/transport.hpp"

namespace ontime::transport::dds {

inline constexpr int max_domain = 232;  // the last one whose ports exist
inline constexpr std::size_t max_payload_bytes = std::size_t{1}
                                                 << 20;  // tested; DDS itself would go to 2 GiB
inline constexpr int participants_per_host = 32;         // so many ports of a peer are tried

// Ports of domain d, participant p, as RTPS has them: 7400 + 250 d + offset, and + 2 p where not multicast.
inline constexpr int base_port = 7400;
inline constexpr int ports_per_domain = 250;

std::int64_t monotonic_ns() noexcept;

bool is_loopback(const std::string& address);

const char* topic_written(Role role);
const char* topic_read(Role role);

// Throws Error for what no DDS transport can do.
void check(const Config& config, const std::string& transport, std::span<const Option> options);

struct Peer {
  std::string address;     // IPv4
  std::uint16_t port = 0;  // 0: any participant of that host
};
// Of HOST[:PORT]. Throws Error if there is no such host.
Peer resolve(const std::string& peer, const std::string& transport);

// DDS says only for which policy it refused a match. A reader may not ask for more than a writer offers, so
// what the other end has follows for the policies of two values.
enum class Policy { reliability, durability, other };
std::string refused_writer(const Config& config, Policy policy);
std::string refused_reader(const Config& config, Policy policy);
std::string other_type(const std::string& topic, const std::string& type);
std::string others_without_our_topics(const Config& config, std::size_t participants, Matched matched);

}  // namespace ontime::transport::dds

// SPDX-License-Identifier: Apache-2.0
// A message's path through both ends, and where it was delayed.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "explain/delay.hpp"
#include "explain/packets.hpp"
#include "explain/timeline.hpp"
#include "explain/usual.hpp"

namespace ontime::explain {

struct KnownThread {
  std::int32_t id;
  std::string role;
};
// A time in which the end's interface was down.
struct Down {
  std::int64_t from_ns, to_ns;
  bool taken;  // taken down; false: it had no carrier
};
// One end of a run. `timeline` may be nullptr: its machine was not traced.
struct End {
  const char* name;  // "controller", "component"
  std::vector<KnownThread> threads;
  const Timeline* timeline = nullptr;
  std::string interface {};
  std::vector<Down> downs{};  // in order
  bool has(std::int32_t thread) const;
};

// A sent packet is queued or dropped within this time.
inline constexpr std::int64_t before_queue_ns = 1'000'000;
// For this long after a link was down, ARP may have to find the peer again (it tries once a second).
inline constexpr std::int64_t forgotten_ns = 3'000'000'000;

// The minimum size of a message's first packet.
std::int64_t least_packet_bytes(std::int64_t payload_bytes);

class Way {
 public:
  // `one_machine`: both ends have one timeline.
  Way(End client, End server, const Usual&, std::int64_t payload_bytes, bool one_machine);

  // The delay above the usual duration, by cause, the largest first. Without the server's times both legs are
  // one unknown part.
  std::vector<Part> delays_of(const roundtrip::Sample&);
  // Where a lost message ended, as far as the trace shows it.
  std::vector<Part> loss_of(const roundtrip::Sample&, std::int64_t until_ns);

 private:
  static void thread(Delay&, const End&, std::int32_t id, const std::string& role, Stage,
                     std::int64_t from_ns, std::int64_t to_ns);
  void receiver(Delay&, const End&, std::int64_t from_ns, std::int64_t to_ns) const;
  void held_in_queue(Delay&, const End& from, const Packet&, std::int64_t until_ns) const;
  void brought(Delay&, const End& to, std::int32_t id, std::int64_t from_ns, std::int64_t to_ns) const;
  void taken_in(Delay&, const End& to, const trace::Event& received, std::int64_t to_ns) const;
  Part drop_of(const Packet&, const End& from, const End& to) const;
  void passage(Delay&, const End& from, const End& to, const Packet&, std::int64_t from_ns) const;
  void leg(Delay&, const End& from, const End& to, std::int64_t from_ns, std::int64_t to_ns) const;
  std::optional<Part> link_down(Stage, std::int64_t from_ns, std::int64_t to_ns,
                                std::int64_t most_felt_ns) const;
  void rest(Delay&, std::size_t leg, const Leg&) const;
  Packet last_packet(const End& from, std::int64_t from_ns, std::int64_t to_ns) const;
  Packet packet(const End& from, const End& to, std::int64_t from_ns, std::int64_t to_ns) const;
  Packet lost_packet(const End& from, const End& to, std::int64_t from_ns, std::int64_t to_ns) const;
  bool may_have_come(const Packet&, const End& to, const trace::Event&, std::int64_t to_ns) const;
  bool not_sent(Delay&, const End& from, std::int64_t from_ns) const;
  bool lost_between(Delay&, const End& from, const End& to, const Packet&, std::int64_t from_ns,
                    std::int64_t until_ns) const;
  void not_taken_in(Delay&, const End& to, const Packet&, std::int64_t until_ns) const;
  Packet answer_lost(Delay&, std::int64_t there_ns, std::int64_t until_ns) const;
  Part last_seen(const Packet& there, const Packet& back) const;
  const KnownThread* receives(const End&, std::int64_t at_ns) const;
  static const KnownThread* with(const End&, const std::string& role);

  const End client_, server_;
  const Usual& usual_;
  const std::int64_t payload_bytes_;
  const std::int64_t packet_bytes_;
  const bool one_machine_;
  const bool is_handed_over_;  // a packet is the same at both ends
};

}  // namespace ontime::explain

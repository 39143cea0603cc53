// SPDX-License-Identifier: Apache-2.0
// A message's way through both ends, and where it was held up.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "explain/explain.hpp"
#include "explain/packets.hpp"
#include "explain/timeline.hpp"
#include "explain/usual.hpp"

namespace ontime::explain {

struct KnownThread {
  std::int32_t id;
  std::string role;
};
// A time in which the end's interface could carry nothing.
struct Down {
  std::int64_t from_ns, to_ns;
  bool taken;  // down, by somebody; false: it had no carrier
};
// One end of a run. `timeline` may be nullptr: its machine was not traced.
struct End {
  const char* name;  // "controller", "component"
  std::vector<KnownThread> threads;
  const Timeline* timeline = nullptr;
  std::string interface {};
  std::vector<Down> downs{};  // in order
};

class Way {
 public:
  // `one_machine`: both ends have one timeline.
  Way(End client, End server, const Usual&, std::int64_t payload_bytes, bool one_machine);

  // All of what is above the usual, by cause, the largest first.
  std::vector<Part> delays_of(const roundtrip::Sample&);
  // Where it went, as far as can be seen.
  std::vector<Part> loss_of(const roundtrip::Sample&, std::int64_t until_ns);

 private:
  // Of a leg: what held it up, and what the threads did beside.
  struct Found {
    std::vector<Part> parts;
    std::int64_t held_ns = 0, ran_ns = 0;
    std::vector<Stretch> ran, slept;
    Part last{};  // whose thread was looked at last
  };

  void add(Found&, Part, std::int64_t ns, const std::vector<Stretch>& when) const;
  void add(Found&, const Part&, const Stretch& when) const;
  void thread(Found&, const End&, std::int32_t id, const std::string& role, Stage, std::int64_t from_ns,
              std::int64_t to_ns) const;
  // `outranked_ns`: how long, of its wait, a real-time thread was kept from CPUs by ordinary ones.
  void waited(Found&, const Timeline&, const Part&, const Stretch&, std::int64_t outranked_ns) const;
  void receiver(Found&, const End&, std::int64_t from_ns, std::int64_t to_ns) const;
  void held_in_queue(Found&, const End& from, const Packet&, std::int64_t until_ns) const;
  void brought(Found&, const End& to, std::int32_t id, std::int64_t from_ns, std::int64_t to_ns) const;
  void leg(Found&, const End& from, const End& to, std::int64_t from_ns, std::int64_t to_ns) const;
  std::optional<Part> link_down(Stage, std::int64_t from_ns, std::int64_t to_ns,
                                std::int64_t most_felt_ns) const;
  void rest(Found&, std::size_t leg, const Leg&) const;
  Packet packet(const End& from, const End& to, std::int64_t from_ns, std::int64_t to_ns) const;
  bool not_sent(Found&, const End& from, std::int64_t from_ns) const;
  bool lost_between(Found&, const End& from, const End& to, const Packet&, std::int64_t from_ns,
                    std::int64_t until_ns) const;
  const KnownThread* receives(const End&, std::int64_t at_ns) const;
  static const KnownThread* with(const End&, const std::string& role);

  const End client_, server_;
  const Usual& usual_;
  const std::int64_t packet_bytes_;  // a packet of a message has as many at least
  const bool one_machine_;
  const bool is_handed_over_;  // a packet is the same at both ends
};

}  // namespace ontime::explain

// SPDX-License-Identifier: Apache-2.0
// From which message of a chain's first topic does one of its last topic come, and how long did each part of
// the way take? A take leads to what the same thread publishes before it takes again, waits, or begins a
// timer's or a service's callback. Pure; memory is bounded by the numbers below.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "listen/listen.hpp"
#include "listen/probing.hpp"
#include "listen/rows.hpp"

namespace ontime::listen {

// Follows one chain.
class ChainFollower {
 public:
  // Messages kept of each publisher; publishers kept, the latest.
  static constexpr std::size_t most_remembered = 1024, most_publishers = 32;
  static constexpr std::size_t most_begun = 4096, most_paths = 32, most_threads = 1024;
  // A path may be replaced after this silence, if most_paths are in use.
  static constexpr std::int64_t idle_ns = 60'000'000'000;
  // A message that came no further in this time has ended.
  static constexpr std::int64_t under_way_ns = 10'000'000'000;
  // A publish stamps its message within this time, or before its thread continues with something else.
  static constexpr std::int64_t stamped_ns = 100'000'000;

  // `party_of` names a process. Paths have ids from `first_id` on. `probing` lives longer than this.
  ChainFollower(ChainWish, std::function<Party(std::uint32_t)> party_of, const Probing& probing,
                std::uint64_t first_id);

  struct Message {
    const std::string& topic;
    std::uint32_t process, thread;  // that published or took it
    std::uint64_t publisher;        // 0: not known
    // Of the publisher's. Of a take the last one before its stamp; empty: taken before, or too old.
    std::optional<std::uint64_t> number;
    std::int64_t at_ns;
    std::int64_t stamp_ns = 0;  // of a take
  };
  // In order of time, but for a few microseconds.
  void published(const Message&);
  void taken(const Message&);
  void turned(std::uint32_t thread, std::int64_t at_ns);
  // Events before the next one are missing.
  void interrupt();
  void retire(std::uint32_t process);

  Chain findings() const;
  void keep_rows(KeepRow keep) { keep_row_ = std::move(keep); }

 private:
  // How far a message of the first topic came: 0 it was published; then, by turns, what came of it was taken
  // by a node on the way, and published. So a message that ended at a stage ended in the part of that index.
  using Stage = std::uint8_t;
  static constexpr std::size_t most_stages = 2 * ChainWish::most_topics;
  struct Journey {
    std::uint64_t origin = 0;
    std::array<std::int64_t, most_stages> at_ns{};
    std::array<std::uint32_t, ChainWish::most_topics + 1> processes{};
  };
  // The last take of a thread or a process; without a journey, its origin is unknown.
  struct Hand {
    std::uint32_t process = 0;
    std::size_t topic = 0;
    std::optional<Journey> journey;
  };
  struct Sent {
    std::uint64_t number = 0;
    std::uint32_t thread = 0;
    std::int64_t stamped_ns = 0;  // at the latest
    std::optional<Journey> journey;
  };
  struct Publisher {
    std::uint32_t process = 0;
    std::int64_t last_ns = 0;
    std::deque<Sent> messages;  // by number
  };
  struct Origin {
    std::array<std::int64_t, most_stages> at_ns{};  // by stage
    Stage stage = 0;
    bool is_unclear = false;  // which way it went on is not known
  };
  using Ended = std::vector<std::uint64_t>;

  std::optional<std::size_t> position_of(const std::string& topic) const;
  Stage last_stage() const { return static_cast<Stage>(2 * wish_.steps.size() - 1); }
  bool continues(std::size_t topic, std::uint32_t process) const;
  Journey begin(const Message&);
  const Hand* hand_of(std::size_t topic, const Message&) const;
  void remember(const Message&, std::optional<Journey>);
  struct Origins {
    const Journey* journey = nullptr;  // nullptr: unknown
    bool is_forgotten = false;         // it was known, but too long ago
  };
  Origins find(const Message&, std::size_t topic);
  void note(std::uint32_t thread);
  void end_call(std::uint32_t thread, std::int64_t at_ns);
  void reach(const Journey&, std::size_t stage);
  void arrive(const Journey&);
  ChainPath* path_of(const Journey&);
  bool make_room_for_path();
  void forget_under_way();
  // Its end is known, and ontime's probes did not delay its take until the next message was taken.
  bool is_clear(const Origin& origin, std::int64_t next_ns) const {
    return !origin.is_unclear &&
           (origin.stage % 2 != 0 || !probing_.is_most_of(origin.at_ns[origin.stage], next_ns));
  }
  Ended ended() const;
  std::int64_t silent_ns() const;

  const ChainWish wish_;
  const std::function<Party(std::uint32_t)> party_of_;
  const Probing& probing_;
  std::map<std::uint32_t, Hand> hands_;                // by thread
  std::vector<std::map<std::uint32_t, Hand>> latest_;  // by topic and process
  std::vector<std::set<std::uint32_t>> publishing_;    // by topic: processes that published it
  std::map<std::uint64_t, Publisher> publishers_;      // by id
  std::map<std::uint32_t, std::pair<std::uint64_t, std::uint64_t>> calls_;  // by thread: publisher and number
  std::deque<Origin> origins_;
  std::uint64_t first_origin_ = 0;  // number of the first of them
  Stage furthest_ = 0;              // that one before them has reached, since nothing was unknown
  Chain found_;                     // but for `ended`, of those that are in origins_
  std::map<std::vector<std::uint32_t>, ChainPath> paths_;  // by processes
  std::vector<ChainPath> ended_paths_;
  std::uint64_t next_id_;
  std::int64_t now_ns_ = 0;
  std::int64_t last_arrival_ns_ = 0, waiting_since_ns_ = 0;  // 0: none; nothing has gone in since the last
  std::optional<std::set<std::uint32_t>> noted_;  // threads seen since events were lost, if any were
  KeepRow keep_row_;
};

}  // namespace ontime::listen

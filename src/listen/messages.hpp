// SPDX-License-Identifier: Apache-2.0
// What was published and taken in the processes of one machine becomes flows: which take belongs to which
// publish, which messages are missing, late, doubled or out of order. Pure; memory grows with publishers,
// readers and flows, not with messages.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <map>
#include <string>
#include <tuple>

#include "listen/listen.hpp"
#include "listen/sequence.hpp"

namespace ontime::listen {

struct Observation {
  enum class Kind : std::uint8_t { published, taken };
  Kind kind = Kind::published;
  bool after_loss = false;     // the sensor lost events just before this one
  std::int64_t at_ns = 0;      // one clock for all; a publish begins, a take has returned
  std::int64_t stamp_ns = 0;   // when the writer says it published, by the same clock; 0: unknown
  std::uint64_t endpoint = 0;  // of the process
  std::uint32_t process = 0;
  std::array<std::uint8_t, 16>
      writer{};  // of a take: the writer as the reader's middleware names it; 0: unknown
};

// A stamp tells which publish a take belongs to: it is between that publish and the next of the same
// publisher. A writer is taken for one of this machine's publishers after its stamps fit that publisher alone
// for a second, and as long as they fit.
class Messages {
 public:
  explicit Messages(const Limits& limits) : limits_(limits) {}

  void name_process(std::uint32_t process, const std::string& name) { processes_[process] = name; }
  void name_topic(std::uint32_t process, std::uint64_t endpoint, const std::string& topic);
  // In order of time, but for a few microseconds.
  void add(const Observation&);

  std::vector<Flow> flows() const;
  std::vector<Miss> take_misses();  // their times are those of the observations

 private:
  static constexpr std::size_t remembered =
      Sequence::window;  // messages of a publisher that a take may belong to

  using Endpoint = std::pair<std::uint32_t, std::uint64_t>;
  struct Publisher {
    std::string topic;
    std::uint64_t count = 0;  // publishes so far; the last of them is number count - 1
    std::vector<std::int64_t> begun_ns = std::vector<std::int64_t>(remembered);  // by number modulo its size
    std::int64_t first_ns = 0;
    bool is_broken = true;  // no period begins with the last publish
    Distribution period;
    std::uint64_t late = 0;
    bool fits(std::int64_t stamp_ns) const;
    std::optional<std::uint64_t> last_before(std::int64_t stamp_ns) const;
    std::int64_t begun(std::uint64_t number) const { return begun_ns[number % remembered]; }
  };
  struct Link {
    std::string topic;
    std::uint64_t messages = 0;
    std::int64_t first_ns = 0, last_ns = 0, last_stamp_ns = 0;
    bool is_broken = false;  // no period begins with the last take, and nothing before it counts as lost
    Distribution period, age;
    std::uint64_t duplicated = 0, reordered = 0, late = 0;
    std::optional<Endpoint> publisher, candidate;
    std::int64_t candidate_since_ns = 0;
    int fits = 0, misfits = 0;  // of the candidate's stamps; of the publisher's, misfits in a row
    Sequence sequence;          // of the publisher's numbers
    std::vector<std::int64_t> stamps = std::vector<std::int64_t>(remembered);  // of those taken, by number
  };
  using Writer = std::tuple<std::uint32_t, std::uint64_t, std::array<std::uint8_t, 16>>;

  void published(const Observation&);
  void taken(const Observation&);
  void identify(Link&, const Observation&);
  void doubt(Link&, const Observation&);
  void place(Link&, const Publisher&, const Observation&);
  void miss(Miss::Kind, std::int64_t value_ns, const Link&, const Observation&);
  Party party(std::uint32_t process) const;

  const Limits limits_;
  std::map<std::uint32_t, std::string> processes_;
  std::map<Endpoint, std::string> topics_;
  std::map<Endpoint, Publisher> publishers_;
  std::map<Writer, Link> links_;
  std::deque<Miss> misses_;
};

}  // namespace ontime::listen

// SPDX-License-Identifier: Apache-2.0
// What was published and taken in the processes of one machine becomes flows: which take belongs to which
// publish, which messages are missing, late, doubled or out of order. Pure; memory is bounded by most_live
// and most_ended.
#pragma once

#include <array>
#include <bitset>
#include <cstdint>
#include <deque>
#include <map>
#include <set>
#include <string>
#include <tuple>

#include "listen/chains.hpp"
#include "listen/listen.hpp"
#include "listen/misses.hpp"
#include "listen/probing.hpp"
#include "listen/rows.hpp"
#include "listen/sequence.hpp"

namespace ontime::listen {

struct Observation {
  // turned: the thread waits, or begins a callback that takes no message.
  enum class Kind : std::uint8_t { published, taken, turned };
  Kind kind = Kind::published;
  bool after_loss = false;     // the sensor lost events just before this one
  std::int64_t at_ns = 0;      // one clock for all; a publish begins, a take has returned
  std::int64_t stamp_ns = 0;   // when the writer says it published, by the same clock; 0: unknown
  std::uint64_t endpoint = 0;  // of the process
  std::uint32_t process = 0;
  std::uint32_t thread = 0;
  std::array<std::uint8_t, 16>
      writer{};  // of a take: the writer as the reader's middleware names it; 0: unknown
};

// A stamp shows which publish a take belongs to: it is between that publish and the next of the same
// publisher. A writer is taken for one of this machine's publishers after its stamps fit that publisher alone
// for a second, and as long as they fit.
class Messages {
 public:
  // Publishers and flows that are followed at once; and flows of ended processes that are kept.
  static constexpr std::size_t most_live = 1024, most_ended = 256, most_names = 16384;
  // How long after the end of a process its last messages may be taken.
  static constexpr std::int64_t still_taken_ns = 10'000'000'000;
  // A topic's name arrives after its first messages; on a busy machine within this time.
  static constexpr std::int64_t named_within_ns = 2'000'000'000;
  // An endpoint may be replaced after this silence, if most_live are in use.
  static constexpr std::int64_t idle_ns = 60'000'000'000;

  explicit Messages(const Limits&, std::vector<ChainWish> = {});
  Messages(const Messages&) = delete;
  Messages& operator=(const Messages&) = delete;

  void begin_process(std::uint32_t process, const std::string& name);
  void end_process(std::uint32_t process, std::int64_t at_ns);
  // Of processes that ended long before, only the flows stay.
  void retire_ended(std::int64_t now_ns);
  void name_topic(std::uint32_t process, std::uint64_t endpoint, const std::string& topic);
  bool has_name(std::uint32_t process, std::uint64_t endpoint) const {
    return topics_.contains({process, endpoint});
  }
  // In order of time, but for a few microseconds.
  void add(Observation);
  // Some messages until then were not observed: nothing counts across that time, and messages published in it
  // are unknown.
  void interrupt(std::int64_t until_ns);
  // A silence ended by a pause: counts as one late period from this time on. Each silence counts once.
  void count_silence(std::uint64_t flow, std::int64_t from_ns, std::int64_t ns);
  // The clock of stamps was set: stamps until then are useless. Periods use another clock.
  void forget_stamps(std::int64_t until_ns);
  // Call it before add() of what was observed since.
  void add_probing(std::int64_t from_ns, std::int64_t to_ns) { probing_.add(from_ns, to_ns); }

  Findings findings() const;
  void keep_rows(KeepRow keep) {
    for (auto& chain : chains_) chain.keep_rows(keep);
    keep_row_ = std::move(keep);
  }
  // Times are those of the observations. A miss of a topic without a name waits for the name.
  std::vector<Miss> take_misses(std::int64_t now_ns) {
    auto misses = misses_.take(
        [&](const Miss& miss) { return miss.topic.empty() && now_ns - miss.at_ns < named_within_ns; });
    for (auto& miss : misses)
      for (auto* const one : {&miss.writer, &miss.reader})  // a process has its name soon after it began
        if (one->process != 0 && one->name.empty()) *one = party(one->process);
    return misses;
  }

 private:
  static constexpr std::size_t remembered =
      Sequence::window;  // messages of a publisher that a take may belong to

  using Endpoint = std::pair<std::uint32_t, std::uint64_t>;
  struct Publisher : Flow {  // the last of its messages is number messages - 1
    std::vector<std::int64_t> begun_ns = std::vector<std::int64_t>(remembered);  // by number modulo its size
    std::vector<std::uint32_t> threads = std::vector<std::uint32_t>(remembered);
    bool is_broken = true;    // no period begins with the last publish
    bool has_reader = false;  // a reader was recognized; its flow includes this publisher
    bool fits(std::int64_t stamp_ns) const;
    std::optional<std::uint64_t> last_before(std::int64_t stamp_ns) const;
    // The number of the oldest message that is known.
    std::uint64_t oldest() const { return messages > remembered ? messages - remembered : 0; }
    std::int64_t begun(std::uint64_t number) const { return begun_ns[number % remembered]; }
  };
  struct Link : Flow {  // with an age once the publisher is known
    Rows rows;
    bool is_broken = false;  // no period begins with the last take, and nothing before it counts as lost
    std::optional<Endpoint> publisher, candidate;
    std::int64_t candidate_since_ns = 0;
    std::optional<std::uint64_t> last_number;  // of the publisher's, taken last
    int fits = 0, misfits = 0;  // of the candidate's stamps; of the publisher's, misfits in a row
    std::int64_t misfits_since_ns = 0;
    Sequence sequence;                 // of the publisher's numbers
    std::bitset<remembered> unjudged;  // by number: missing, and not judged
    std::vector<std::int64_t> stamps;  // of those taken, by number; empty without a publisher
  };
  using Writer = std::tuple<std::uint32_t, std::uint64_t, std::array<std::uint8_t, 16>>;

  void begin_anew();
  void published(const Observation&);
  void taken(const Observation&);
  void identify(Link&, const Observation&);
  void doubt(Link&, const Observation&);
  using Verdict = Probing::Verdict;
  Verdict judge_gap(std::int64_t from_ns, std::int64_t to_ns) const;
  // False: it was taken before, or it is too old to tell.
  bool place(Link&, std::uint64_t number, const Observation&, Verdict of_age);
  void miss(Miss::Kind, std::int64_t value_ns, const Link&, const Observation&,
            std::optional<std::uint64_t> number);
  bool is_taken(const Publisher&) const;            // by a reader whose writer is not recognized yet
  void miss(const Publisher&, const Observation&);  // of a topic without a reader
  Course course_of(Miss::Kind, const Link&, const Observation&, std::optional<std::uint64_t> number) const;
  void retire(std::uint32_t process);
  void retire(std::map<Writer, Link>::iterator);
  void retire(std::map<Endpoint, Publisher>::iterator);
  void keep(Flow&&);
  template <class Key, class One>
  One* one_of(std::map<Key, One>&, const Key&, std::int64_t now_ns);
  Flow flow_of(const Writer&, const Link&) const;
  Flow flow_of(const Endpoint&, const Publisher&) const;
  Party party(std::uint32_t process) const;

  const Limits limits_;
  // Gaps and ages are both judged if neither has a limit; else only what has one.
  const bool judges_gaps_ = limits_.longest_gap() || !limits_.age;
  const bool judges_ages_ = limits_.age || !limits_.longest_gap();
  std::map<std::uint32_t, std::string> processes_;
  std::map<Endpoint, std::string> topics_;
  std::map<Endpoint, Publisher> publishers_;
  std::map<Writer, Link> links_;
  std::map<std::uint32_t, std::int64_t> ended_at_;  // by process
  std::deque<Flow> ended_;
  std::set<std::uint64_t> silent_;  // flows whose silence was counted, and that had no message since
  std::map<std::string, Findings::Forgotten> forgotten_;
  std::uint64_t left_out_ = 0, last_id_ = 0;
  // Messages published before are unknown; or only their publish may be missing.
  std::int64_t interrupted_until_ns_ = 0, lost_until_ns_ = 0;
  Probing probing_;
  Misses misses_;
  KeepRow keep_row_;
  std::vector<ChainFollower> chains_;
};

}  // namespace ontime::listen

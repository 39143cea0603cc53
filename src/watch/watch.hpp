// SPDX-License-Identifier: Apache-2.0
// Follows a running measurement by reading its results file, from another process that does not disturb it.
// Also makes the metrics for Prometheus, of a measurement and of a robot's own messages. Ordinary thread.
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <numeric>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "listen/listen.hpp"
#include "record/record.hpp"
#include "statistics/lost_wait.hpp"

namespace ontime::watch {

// A histogram with the limits 1, 2, 5, 10 … µs to 10 s, and above.
class Buckets {
 public:
  static constexpr std::size_t size = listen::round_times_ns.size() + 1;
  // The last bucket's limit is the greatest number.
  static std::int64_t upper_ns(std::size_t bucket);
  void add(std::int64_t ns, std::uint64_t count = 1);
  const std::array<std::uint64_t, size>& counts() const { return counts_; }
  std::uint64_t count() const { return count_; }
  std::int64_t min_ns() const { return min_ns_; }  // 0 without values, as the others
  std::int64_t max_ns() const { return max_ns_; }
  double sum_ns() const { return sum_ns_; }
  // Of values that were rounded: their exact maximum and mean. Makes the minimum at most this mean.
  void correct(std::int64_t max_ns, double mean_ns);

 private:
  std::array<std::uint64_t, size> counts_{};
  std::uint64_t count_ = 0;
  std::int64_t min_ns_ = 0, max_ns_ = 0;
  double sum_ns_ = 0;
};
using BucketCounts = std::array<std::uint64_t, Buckets::size>;

struct Worst {
  std::optional<std::uint64_t> message;  // whose answer ended the wait; nothing: none is known
  double at_s;                           // when the first cycle that waited was due, after the run's first
  std::int64_t round_trip_ns, response_ns;
};

// Outcomes of a run's messages.
struct Counted {
  std::uint64_t sent = 0, on_time = 0, late = 0, lost = 0, skipped_cycles = 0;
  Buckets round_trip;  // of messages that were answered
  // Of all cycles: of skipped ones until the answer that they waited for. A lost message has no response
  // time.
  std::optional<std::int64_t> response_max_ns;
  std::vector<Worst> worst;  // by response time, the longest first; at most 3; waits of lost messages, too
  // Skipped cycles that no answer has reached: when the first was due. None of them can have one before
  // `waited_until_ns`.
  std::optional<std::int64_t> waiting_since_ns;
  std::int64_t waited_until_ns = 0;
  statistics::LostWait lost_wait;
  std::uint64_t next_message = 0;  // the index of the next one, unless samples are missing
};

// The recorded part of a run. Once its outcome is known: all messages and cycles, as the report has them. Of
// a flight recorder's run: all messages until its latest outcome, of which it writes one a minute.
struct Progress : Counted {
  enum class State {
    waiting,  // ontime has the file open, but no run is sending messages
    measuring,
    ended,  // no process writes to the file
  } state = State::ended;
  record::Run run;                      // the newest run; number 0: none yet
  bool samples_wait = false;            // it is measuring, but its samples come at the end
  std::uint64_t lost_for_good = 0;      // lost messages that can no longer prove answered
  std::uint64_t unrecorded = 0;         // messages without a sample: their times are unknown
  std::optional<double> elapsed_s = 0;  // from the first message to the newest, where that is known
  double measured_s = 0;                // until its cycle, or its wait for an answer, was over
  std::optional<double> duration_s;     // as requested
};

// Reads new samples at each look. The file is open only during a look, so that the writer can close it as one
// file. A message recorded as lost that proves answered is counted as answered if that is known within two
// seconds; the report always counts it so.
class Follower {
 public:
  explicit Follower(std::string results) : results_(std::move(results)) {}
  // Throws record::Error. If the file has vanished, the measurement has ended, with the last counts. The
  // first look is at the newest run. A run is seen until its end, then the next one; of a recording always
  // the newest.
  const Progress& look();
  bool has_next() const { return has_next_; }  // the end of this run was seen, and a later one is there
  // The runs that were seen to end before this one, the oldest first; at most 16.
  const std::deque<Progress>& before() const { return before_; }

 private:
  void look_once();
  void begin(const record::Run&);
  const std::string results_;
  bool seen_ = false;
  Counted settled_;  // final counts, up to the first message that may change
  std::optional<std::int64_t> start_ns_;
  Progress progress_;
  bool is_over_ = false, has_next_ = false;
  std::deque<Progress> before_;
};

// Several lines for a terminal, each with its newline.
std::string text_of(const Progress&);
// One line of JSON: docs/reference/json.md.
std::string json_of(const Progress&);
// Prometheus's text format, version 0.0.4. It has the runs before, too: what they counted since it was last
// fetched would be missing for ever.
std::string metrics_of(const Progress&, const std::deque<Progress>& before = {});

// Prometheus metrics of a robot's own messages. Counters never fall: a series adds the increase of its flows
// since the last look, and keeps its count when a flow ends or changes its writer.
class TopicCounters {
 public:
  // Limit of series, and of flows remembered from the last look.
  static constexpr std::size_t most_kept = 4096;
  // A series without the name of its writer or reader ends so many looks after its flow: usually both are
  // known then, and the flow is in another series.
  static constexpr std::uint64_t partial_kept = 300;
  // `topics`: stated by the user, who expects messages of them: they have series from the start, and it
  // counts their silence. With a limit for gaps it counts that of every topic.
  explicit TopicCounters(const listen::Limits& = {}, const std::set<std::string>& topics = {});
  // As they are now, and how long it has listened; about once a second.
  void add(const listen::Findings&, std::chrono::nanoseconds listened);
  void add(const std::vector<listen::Miss>&);                          // each once
  std::string metrics(std::optional<bool> results_failed = {}) const;  // empty: no results file

 private:
  struct Spread {
    std::array<std::uint64_t, 27> counts{};  // as many as the histogram has buckets; enough for each
    double sum_ns = 0;
    std::uint64_t count() const { return std::accumulate(counts.begin(), counts.end(), std::uint64_t{0}); }
  };
  struct Counts {
    std::uint64_t messages = 0, late = 0, not_judged = 0;
    std::optional<std::uint64_t> lost{};  // empty: the sensor cannot tell
    std::uint64_t lost_not_judged = 0, duplicated = 0, reordered = 0;
    Spread age{}, period{};
    std::optional<std::int64_t> idle_ns{};  // the shortest of its flows; empty: none is left, or not judged
    std::int64_t silent_ns = 0;             // idle_ns if that is a silence
    std::optional<std::int64_t> silent_total_ns{};  // of all silences; empty: not judged
    bool is_partial = false;                        // only its writer or only its reader is known
    std::uint64_t look = 0;                         // number of the last look that saw it
  };
  static Spread spread_of(const listen::Distribution&, std::span<const std::int64_t> limits_ns);
  Counts counts_of(const listen::Flow&) const;
  static Counts counts_of(const listen::ChainPath&);
  struct Series {
    std::map<std::uint64_t, Counts> flows;  // by id, as they were last seen
    std::map<std::string, Counts> series;   // by labels
  };
  void add(Series&, std::uint64_t id, const std::string& labels, Counts now) const;
  void add(const listen::Chain&);
  void add_unseen(const listen::Findings&, std::chrono::nanoseconds listened);
  void add_silence(Counts& series) const;
  static void grow(Counts& series, const Counts& before, const Counts& now);

  listen::Limits limits_;
  // By stated topic: how long it had listened when its last message came; zero: none came yet.
  std::map<std::string, std::chrono::nanoseconds> stated_;
  Series topics_, chains_;
  std::map<std::string, std::uint64_t> ended_;   // of chains, by labels
  std::map<std::string, std::uint64_t> misses_;  // by cause
  std::uint64_t looks_ = 0, misses_left_out_ = 0, sensor_lost_ = 0, not_counted_ = 0;
};

// Serves the newest text at http://ADDRESS:PORT/metrics, for up to 64 connections, 8 of an address; a silent
// one ends after two seconds. Its own thread answers, so that the caller never waits.
class Metrics {
 public:
  // A text is served at once while it is fresh. Later a request waits for the next one, `patience` at most.
  // The last text then serves while it is valid: a caller that hangs must not look alive.
  struct Times {
    std::chrono::milliseconds fresh{500}, patience{5'000}, valid{10'000};  // patience: Prometheus has 10 s
  };
  // "127.0.0.1:9464", "[::1]:9464", or a port on loopback. Throws std::invalid_argument for an invalid
  // address, std::runtime_error if it cannot listen there.
  explicit Metrics(const std::string& address, const Times&);
  explicit Metrics(const std::string& address) : Metrics(address, Times{}) {}
  ~Metrics();
  std::string address() const;  // with the bound port
  void set(std::string text);
  void end();              // no text follows: the last one stays valid
  bool is_wanted() const;  // a request waits for the next text
  // Whether a client was sent a text, but none the newest.
  bool is_awaited() const;

 private:
  struct Server;
  std::unique_ptr<Server> server_;
};

}  // namespace ontime::watch

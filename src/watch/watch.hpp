// SPDX-License-Identifier: Apache-2.0
// Following a measurement while it runs, by reading its results file: another process does it, which never
// touches what measures. And what Prometheus reads of it, and of a robot's own messages. Ordinary thread.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <numeric>
#include <optional>
#include <string>
#include <vector>

#include "listen/listen.hpp"
#include "record/record.hpp"

namespace ontime::watch {

// How many values are at most so large: 1, 2, 5, 10 … µs to 10 s, and what is above.
class Buckets {
 public:
  static constexpr std::size_t size = 23;
  // The last one's is the greatest number there is.
  static std::int64_t upper_ns(std::size_t bucket);
  void add(std::int64_t ns);
  const std::array<std::uint64_t, size>& counts() const { return counts_; }
  std::uint64_t count() const { return count_; }
  std::int64_t min_ns() const { return min_ns_; }  // of none 0, as the others
  std::int64_t max_ns() const { return max_ns_; }
  double sum_ns() const { return sum_ns_; }

 private:
  std::array<std::uint64_t, size> counts_{};
  std::uint64_t count_ = 0;
  std::int64_t min_ns_ = 0, max_ns_ = 0;
  double sum_ns_ = 0;
};
using BucketCounts = std::array<std::uint64_t, Buckets::size>;

struct Worst {
  std::uint64_t message;
  double at_s;  // when it was due, after the run's first
  std::int64_t round_trip_ns, response_ns;
};

// What became of a run's messages.
struct Counted {
  std::uint64_t sent = 0, on_time = 0, late = 0, lost = 0, skipped_cycles = 0;
  Buckets round_trip;  // of messages that were answered
  std::int64_t response_max_ns = 0;
  std::vector<Worst> worst;  // by response, the longest first; at most 3
};

// A run as far as it is recorded.
struct Progress : Counted {
  enum class State {
    waiting,  // ontime has the file, and between two runs, or before the first message of one
    measuring,
    ended,  // no process writes into the file any more
  } state = State::ended;
  record::Run run;                  // the newest; number 0: there is none yet
  bool samples_wait = false;        // it is measuring, and nothing is seen of it before its end
  std::uint64_t lost_for_good = 0;  // of the lost ones those that cannot prove to have been answered any more
  double elapsed_s = 0;             // from the first message to the newest
  std::optional<double> duration_s;  // as asked
};

// Reads what is new each time. The file is open only while it is read, so that the writer can close it
// as one file. What was given up as lost, and proves to have been answered in time, is counted right if that
// is known within two seconds; the report counts all of it right.
class Follower {
 public:
  explicit Follower(std::string results) : results_(std::move(results)) {}
  // Throws record::Error. A file that was there and is gone has ended, as it was seen last.
  const Progress& look();

 private:
  void look_once();
  void begin(const record::Run&);
  const std::string results_;
  bool seen_ = false;
  Counted settled_;  // what does not change any more
  std::optional<std::int64_t> start_ns_;
  std::uint64_t next_ = 0;  // the first message that may change
  Progress progress_;
};

// Several lines for a terminal, each ended.
std::string text_of(const Progress&);
// One line of JSON: docs/reference/json.md.
std::string json_of(const Progress&);
// Prometheus's text format, version 0.0.4.
std::string metrics_of(const Progress&);

// What Prometheus reads of a robot's own messages. No counter falls: a series grows by what its flows have
// more than at the last look. So it keeps what it counted when a flow goes, or changes its writer.
class TopicCounters {
 public:
  // Series, and flows that are compared with the last look.
  static constexpr std::size_t most_kept = 4096;
  TopicCounters();
  void add(const listen::Findings&);           // as they are now; about once a second
  void add(const std::vector<listen::Miss>&);  // each once
  std::string metrics() const;

 private:
  struct Spread {
    BucketCounts counts{};
    double sum_ns = 0;
    std::uint64_t count() const { return std::accumulate(counts.begin(), counts.end(), std::uint64_t{0}); }
  };
  struct Counts {
    std::uint64_t messages = 0, late = 0, not_judged = 0;
    std::optional<std::uint64_t> lost{};  // empty: the sensor cannot tell
    std::uint64_t lost_not_judged = 0, duplicated = 0, reordered = 0;
    Spread age{}, period{};
    std::optional<std::int64_t> silent_ns{};  // of its liveliest flow; empty: it has none any more
    std::uint64_t look = 0;                   // the last one that saw it
  };
  static Spread spread_of(const listen::Distribution&);
  static Counts counts_of(const listen::Flow&);
  static Counts counts_of(const listen::ChainPath&);
  struct Series {
    std::map<std::uint64_t, Counts> flows;  // by id, as they were last seen
    std::map<std::string, Counts> series;   // by labels
  };
  void add(Series&, std::uint64_t id, const std::string& labels, Counts now) const;
  void add(const listen::Chain&);
  static void grow(Counts& series, const Counts& before, const Counts& now);

  Series topics_, chains_;
  std::map<std::string, std::uint64_t> ended_;   // of chains, by labels
  std::map<std::string, std::uint64_t> misses_;  // by cause
  std::uint64_t looks_ = 0, misses_left_out_ = 0, sensor_lost_ = 0;
};

// Offers the newest text for Prometheus at http://ADDRESS:PORT/metrics, to a few at a time, each within two
// seconds. A thread of its own answers, whatever the caller does meanwhile.
class Metrics {
 public:
  // "127.0.0.1:9464", "[::1]:9464", or a port on loopback. Throws std::invalid_argument if it is no address,
  // std::runtime_error if it cannot be had.
  explicit Metrics(const std::string& address);
  ~Metrics();
  std::string address() const;  // as it is bound
  void set(std::string text);

 private:
  struct Server;
  std::unique_ptr<Server> server_;
};

}  // namespace ontime::watch

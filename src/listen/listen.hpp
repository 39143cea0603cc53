// SPDX-License-Identifier: Apache-2.0
// The robot's own messages: which nodes publish and take them, how often, how old they are when they are
// taken, and which of them are missing. Three sensors see them: probes in the processes, packets on the wire,
// and a reader of ontime's own. Ordinary thread only.
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "journal/journal.hpp"
#include "trace/trace.hpp"
#include "transport/transport.hpp"

namespace ontime::listen {

// what() states the request, the finding and the fix.
struct Error : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// The kernel does not permit this user to set probes. The fix is missing from what(): it needs the command
// line.
struct Denied : Error {
  using Error::Error;
};

// The file or interface that the user named does not exist, or is not of a known kind.
struct WrongInput : Error {
  using Error::Error;
};

// Limits for messages; empty: no limit.
struct Limits {
  std::optional<std::chrono::nanoseconds> deadline;  // the longest time between two messages
  std::optional<std::chrono::nanoseconds> period;    // the expected one; late after 1.5 times this
  std::optional<std::chrono::nanoseconds> age;       // from the writer's stamp to the take
  bool any() const { return deadline || period || age; }
  std::optional<std::chrono::nanoseconds> longest_gap() const;  // of deadline and period, the stricter
  bool is_gap(std::int64_t ns) const;
  // So long without a message, a topic is silent: beyond the limit for gaps, or 5 s without one.
  bool is_silence(std::int64_t ns) const;
  bool is_too_old(std::int64_t ns) const;
};

// 1, 2 and 5 µs … 10 s: usual periods, and the limits of most buckets that watch exports.
inline constexpr auto round_times_ns = [] {
  std::array<std::int64_t, 22> times{1'000, 2'000, 5'000};
  for (std::size_t i = 3; i < times.size(); ++i) times[i] = 10 * times[i - 3];
  return times;
}();
static_assert(round_times_ns.back() == 10'000'000'000);

// A histogram in bounded memory: quantiles are within 1.6 %, count and maximum are exact.
class Distribution {
 public:
  void add(std::int64_t ns);  // below zero counts as zero
  void add(const Distribution&);
  std::uint64_t count() const { return count_; }
  std::uint64_t count_up_to(std::int64_t ns) const;  // exact for round times, else within 1.6 % of this value
  double sum_ns() const { return sum_; }
  std::int64_t max_ns() const { return max_; }
  // 0 … 1; within 1.6 %, and exact where the values near it are equal; without values 0
  std::int64_t quantile_ns(double portion) const;
  // Value and count, ascending. Values are within 1.6 %, and on the same side of each round time as those
  // that they stand for; the last is the exact maximum.
  std::vector<std::pair<std::int64_t, std::uint64_t>> values() const;

 private:
  struct Bucket {
    std::uint64_t count = 0;
    double sum = 0;
  };
  std::int64_t mean_ns(const Bucket&) const;
  std::vector<Bucket> buckets_;  // grows to what the largest value needs
  std::uint64_t count_ = 0;
  std::int64_t max_ = 0;
  double sum_ = 0;
};

// One end of a topic.
struct Party {
  std::uint32_t process = 0;  // 0: it is not on this machine, or no sensor saw it
  std::string name;           // of the process; on the wire an address or a GUID
  bool operator==(const Party&) const = default;
};

// Where an age begins. It ends when the message is taken; of a recorded message, when it was recorded.
enum class AgeFrom : std::uint8_t {
  writer,   // the time stamp that its writer's middleware gave it
  stamp,    // its header.stamp
  publish,  // its publish time in the recording
};

// Messages of one writer to one reader.
struct Flow {
  std::uint64_t id = 0;  // unique; the same in all findings of a sensor
  std::string topic;     // as ROS 2 names it; "" where no sensor learned it
  Party writer{}, reader{};
  std::vector<Party> between{};  // nodes of a chain
  std::uint64_t messages = 0;    // taken; on the wire, seen; of a flow without a reader, published
  std::int64_t first_ns = 0, last_ns = 0;
  Distribution period{};
  std::optional<Distribution> age{};  // empty: no writer's stamp by this machine's clock
  AgeFrom age_from = AgeFrom::writer;
  // Messages without a known age, of a bag or of one host's packets; of a bag, with a stamp later than their
  // recording, whose age counts as 0. Empty: of another source.
  std::optional<std::uint64_t> age_unknown{}, stamp_ahead{};
  std::optional<std::chrono::nanoseconds> chain_limit{};  // of the age, where it is of a chain
  std::optional<std::uint64_t> lost{};                    // empty: the sensor cannot tell
  std::uint64_t duplicated = 0, reordered = 0;
  std::uint64_t late = 0;  // by any of the limits
  // Messages under way while ontime set or removed probes. `not_judged`: taken, but neither counted as late
  // nor in `period` and `age`. `lost_not_judged`: not taken, but not in `lost`.
  std::uint64_t not_judged = 0, lost_not_judged = 0;
  // From its last message to the end of listening, or until a flow of the same names replaced it. 0: within
  // the limits.
  std::int64_t silent_ns = 0;
  std::int64_t idle_ns = 0;   // from its last message until now, whatever the limits
  bool was_replaced = false;  // by a flow of the same names, as when a node restarts
  bool has_ended = false;     // its writer's or reader's process ended
  double rate_hz() const;
};

// A requested chain of topics: a node takes a message of one topic and publishes one of the next.
struct ChainWish {
  static constexpr std::size_t most_topics = 8;
  struct Step {
    std::string topic;
    // True: a message is linked to the latest one of the previous topic that its process took, on any
    // thread. False: to the one that its thread took last, in the same callback.
    bool is_of_latest = false;
  };
  std::vector<Step> steps;                      // 2 … most_topics, each topic once
  std::optional<std::chrono::nanoseconds> age;  // the longest, from the first publish to the last take
  std::string name() const;                     // "/scan → /map → /cmd_vel"
};
inline constexpr std::size_t most_chains = 8;

// A chain's way through processes. Its parts follow one another: a topic (publish to take), the node between
// it and the next topic (take to publish), and so on to the last take. All times are of one clock.
struct ChainPath {
  std::uint64_t id = 0;                    // different from the ids of flows
  std::vector<Party> parties;              // the first publisher, the nodes between, the last reader
  Distribution age;                        // of what came out at the end, from the first publish
  std::vector<Distribution> parts;         // two for each topic but one
  std::uint64_t late = 0, not_judged = 0;  // as of a flow
  std::int64_t last_ns = 0;
};

struct Chain {
  ChainWish wish;
  std::vector<ChainPath> paths;  // by parties
  std::uint64_t begun = 0;       // messages of the first topic
  // By part: messages of the first topic that ended there, while earlier and later ones came further, or ten
  // seconds passed. Part of a topic: the next node did not take them. Part of a node: it took them and
  // published nothing, which may be intended.
  std::vector<std::uint64_t> ended;
  // By topic: published though the thread (or process) had taken none of the topic before in this callback.
  std::vector<std::uint64_t> without_take;
  // By topic: takes with an unknown publish: the writer is not recognized yet, or remote, two threads
  // published at once, or it was too long ago.
  std::vector<std::uint64_t> unknown_takes;
  std::int64_t silent_ns = 0;  // since something came out, where messages have gone in for ten seconds since
  // Judged messages of paths beyond ChainFollower::most_paths.
  std::uint64_t forgotten = 0, forgotten_late = 0;
};

// Times of a late message as the probes saw them, by CLOCK_MONOTONIC; 0: not seen.
struct Course {
  std::int64_t before_ns = 0;             // the message before it was published
  std::int64_t since_ns = 0;              // its publish, or the first before it that this reader missed
  std::int64_t published_ns = 0;          // it was published
  std::int64_t taken_before_ns = 0;       // the message before it was taken
  std::int64_t taken_ns = 0;              // without a reader: it was published
  std::int32_t publisher = 0, taker = 0;  // threads
  std::int64_t usual_ns = 0;              // the median of what was judged
  std::uint64_t missing = 0;              // published between the message before and this one, not taken
};

// Why a message was late.
struct Why {
  bool is_seen = false;    // false: no event of the kernel shows enough of it
  std::string cause{};     // explain's word for it
  std::string sentence{};  // for people: what held up which thread; without times
  std::string fix{};       // may be empty
  // The same without details that messages of one cause differ in, such as the number of another process.
  std::string alike{}, alike_fix{};
  Party victim{}, culprit{};  // processes; empty if unknown
  std::int32_t thread = 0;
  std::int64_t ns = 0;  // of the delay, by this cause; 0: not seen
  std::optional<int> cpu{};
};

// What the kernel did around a message, from before its delay until window_after_ns after it was taken.
struct Surroundings {
  trace::Window window;
  std::map<std::int32_t, Party> owners;  // the processes of those threads that the explanation is about
};
inline constexpr std::int64_t window_after_ns = 100'000'000;

// A message that missed a limit.
struct Miss {
  enum class Kind : std::uint8_t { age, gap };
  Kind kind = Kind::age;
  std::int64_t at_ns = 0;     // CLOCK_REALTIME, when it was taken or seen on the wire
  std::int64_t value_ns = 0;  // how old it was, or how long after the one before
  std::string topic;
  Party writer, reader;
  Course course{};
  std::uint64_t flow = 0;
  std::optional<Why> why{};  // empty: not looked for
  std::shared_ptr<const Surroundings> surroundings{};
};
// The JSON that a results file stores with the window of a miss.
nlohmann::json way_of(const Miss&);
// Rebuilds the miss and its cause from both. Empty: the window lacks a part of the miss's time, or the JSON
// is invalid.
std::optional<Miss> explained_again(const nlohmann::json& way, const trace::Window&);

// One quantity of one message, as a results file keeps it.
struct Row {
  enum class Quantity : std::uint8_t { age, period };
  std::uint64_t flow = 0;
  Quantity quantity = Quantity::age;
  std::uint64_t index = 0;   // of this quantity of this flow
  std::int64_t from_ns = 0;  // the writer's stamp; of a period, when the message before came
  std::int64_t to_ns = 0;    // arrival, by the same clock (of any epoch); 0: lost
  bool is_late = false;      // beyond the limit of this quantity
  bool was_lost = false;     // an earlier row counted it as lost, but it arrived
};

// All values of Why::cause.
std::vector<std::string> causes();

inline constexpr std::size_t most_misses = 1000;  // that wait for take_misses(); older ones are only counted

// What the probes cost the nodes: calls that hit a probe, and the added time of each for a thread that just
// woke, as measured on this machine when listening began.
struct Cost {
  std::uint64_t publishes = 0, takes = 0;
  // Waits, timers and services, for chains; of Cyclone DDS, what tells a topic's name. Each takes at most as
  // long as a publish.
  std::uint64_t turns = 0;
  std::uint64_t stepped = 0;  // of all: the kernel had to step over an instruction, which takes longer
  double publish_ns = 0, take_ns = 0, step_ns = 0;
  double total_ns() const {
    return static_cast<double>(publishes + turns) * publish_ns + static_cast<double>(takes) * take_ns +
           static_cast<double>(stepped) * step_ns;
  }
};

// What the sensors saw of all topics, until now.
struct Findings {
  std::vector<Flow> flows;                               // by topic, writer and reader
  std::vector<Chain> chains;                             // as requested
  std::set<std::string> silent;                          // topics that a bag has without messages
  std::uint64_t sensor_lost = 0;                         // events or packets that the sensor dropped
  std::uint64_t not_counted = 0;                         // messages: too many flows were active
  std::map<std::string, std::uint64_t> misses_left_out;  // by topic: beyond most_misses
  // Flows of ended processes beyond the bound of `flows`, by topic.
  struct Forgotten {
    std::uint64_t flows = 0, messages = 0, with_misses = 0;
  };
  std::map<std::string, Forgotten> forgotten;
  Forgotten all_forgotten() const;
  // Another user's process may make up topic names without end. Beyond most_topics names, the two maps above
  // count under this key, which no topic has.
  static constexpr std::size_t most_topics = 16384;
  static constexpr const char* any_topic = "\n";
  std::vector<std::string> remarks;  // what the sensors could not see, and why
  // Of `remarks`: parts of the source are missing, so each flow's results are told, too.
  std::vector<std::string> incomplete;
  void add_incomplete(const std::string& remark) {
    remarks.push_back(remark);
    incomplete.push_back(remark);
  }
  std::optional<Cost> cost;  // of probes; empty: not measured
};

// A dead writer sends no late message. Sets silent_ns and idle_ns of each flow: its silence until `until_ns`,
// counted from `since_ns` at the earliest.
void judge_silence(std::vector<Flow>&, const Limits&, std::int64_t until_ns, std::int64_t since_ns = 0);
// Messages of the last moment of a live source may not be read yet.
inline constexpr std::int64_t unread_ns = 300'000'000;

// "/cmd_vel" of the DDS topic "rt/cmd_vel"; any other name as it is.
std::string ros_name(const std::string& dds_topic);
// A topic (by ros_name()) of ROS 2 or a DDS itself: its messages come when a node starts, logs or changes a
// parameter, and have no period.
bool is_own_of_ros(const std::string& topic);

class Sensor {
 public:
  Sensor() = default;
  virtual ~Sensor() = default;
  Sensor(const Sensor&) = delete;
  Sensor& operator=(const Sensor&) = delete;
  // Waits until something was seen, this time at most, and judges it. False: there will be no more.
  virtual bool listen_for(std::chrono::milliseconds) = 0;
  virtual Findings findings() const = 0;
  virtual std::vector<Miss> take_misses() = 0;  // those since the last call
  // Calls `keep` for every message, and for what came out of a chain, from now on, within listen_for().
  virtual void keep_rows(std::function<void(const Row&)> keep) = 0;
  virtual std::optional<Cost> cost() const { return {}; }  // of probes, until now
  // Removes the probes until resume(). No period, age or loss is counted across that time; a silence before
  // it counts as one late period.
  virtual void pause() {}
  virtual void resume() {}
  // No listen_for() follows: what is missing now is lost, and has its row. Before the last findings().
  virtual void end() {}
};

// Probes in the processes of this machine that map a ROS 2 middleware (rmw), Cyclone DDS or Fast DDS: those
// that run, and those that start later. Nothing of theirs changes; the kernel removes the probes when this
// process ends. Throws Error.
std::unique_ptr<Sensor> in_processes(const Limits&, std::vector<ChainWish> = {});

// RTPS packets on an interface of this machine ("any": all of them), by a ring of the kernel. Throws Error;
// of an unknown interface WrongInput.
std::unique_ptr<Sensor> in_packets(const std::string& interface, const Limits&);
// RTPS packets in a file of libpcap or in pcapng. Throws Error; of another file, WrongInput.
std::unique_ptr<Sensor> in_pcap_file(const std::string& path, const Limits&);

// Adds a DDS reader of these topics, without privileges; each of their writers then also sends to it.
std::unique_ptr<Sensor> as_reader(std::unique_ptr<transport::Hearing>, const Limits&);

// Records the kernel's events in its own instance of tracefs, and explains late messages by them. While one
// exists, this process holds the machine (journal).
class Explainer {
 public:
  // Throws Error: another ontime holds the machine, or the kernel cannot record.
  explicit Explainer(bool keeps_surroundings = false);
  // Sets `why` of the first most_explained misses that probes saw. Call it soon after they were taken; if it
  // keeps surroundings, window_after_ns later.
  void explain(std::vector<Miss>&);

 private:
  trace::Span wanted(const Miss&) const;
  void explain(Miss&, trace::Window&, const trace::Span& asked);

  const bool keeps_surroundings_;
  journal::Journal journal_{trace::kinds()};
  std::optional<trace::Recorder> recorder_;
};
inline constexpr std::size_t most_explained = 5;

}  // namespace ontime::listen

// SPDX-License-Identifier: Apache-2.0
// The two ends of a round trip over any transport: the client, which sends on a schedule and judges every
// message, and the server, which answers.
//
// Ordinary threads build, start, drain and stop; the measuring path (the sending thread and whatever thread
// delivers arrivals) allocates nothing, locks nothing, prints nothing and throws nothing.
#pragma once

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "roundtrip/sample.hpp"
#include "transport/transport.hpp"

namespace ontime::roundtrip {

// With the first two, a cycle during which the sending thread did not run is skipped. Its message is not sent
// later in a burst.
enum class Schedule {
  next_free,  // closed-loop (the paper's): after a late answer the next message goes in the next free cycle
  fixed,      // open-loop, periodic: a message each period, whatever the answers do; several in flight
  back_to_back,  // the next message when the last is answered or lost
};
const char* word_of(Schedule);  // "next-free", "fixed", "back-to-back"

struct ClientOptions {
  Schedule schedule = Schedule::next_free;
  std::chrono::nanoseconds period{std::chrono::milliseconds(10)};
  // A longer round trip (T2 - T1, the paper's) is late. With `fixed` it counts from when the message was due,
  // so that a sender's own delay is not hidden.
  std::chrono::nanoseconds deadline{std::chrono::milliseconds(10)};
  std::chrono::nanoseconds timeout{std::chrono::milliseconds(500)};  // a longer round trip, or none, is lost
  std::chrono::nanoseconds duration{std::chrono::seconds(10)};       // of sending, warm-up not counted
  std::size_t payload_bytes = 500;
  std::uint64_t warm_up = 10;  // answers to wait for before the first counted message
};
// The least time from one message of the warm-up to the next.
inline std::chrono::nanoseconds warm_up_pause(const ClientOptions& options) {
  return std::min<std::chrono::nanoseconds>(options.period, std::chrono::milliseconds(10));
}

// At all times sent = on_time + late + lost + in flight; in flight is 0 when the client has finished.
struct Counters {
  std::uint64_t sent = 0, on_time = 0, late = 0, lost = 0;
  std::uint64_t duplicates = 0;  // further answers to a message already answered
  // Answers to another client's messages, to messages not sent yet, or after the time-out.
  std::uint64_t strays = 0;
  std::uint64_t reordered = 0;  // answers that came after the answer to a later message
  // Answers with another payload size than the message, also in the warm-up. They do not count as answers.
  std::uint64_t wrong_size = 0;
  // Answers with server times outside the round trip; their samples have no server times.
  std::uint64_t wrong_server_times = 0;
  // Cycles without a message. Together with `sent`: all cycles of the duration, or those due before stop().
  // While the run goes on: those known so far.
  std::uint64_t skipped_cycles = 0;
  std::uint64_t refused_sends = 0;    // messages that the transport refused; each also counts as lost
  std::uint64_t dropped_records = 0;  // samples that were not drained in time
  // Skipped cycles after the last message (no sample shows them), and when the first was due.
  std::uint64_t trailing_cycles = 0;
  std::int64_t trailing_due_ns = 0;
  // None of these cycles could send until then: the last answer, its timeout, or the sender's return. Set at
  // the end, also without such cycles: cycles skipped before a lost last message waited until then.
  std::int64_t trailing_until_ns = 0;
};

// The counters that are counts (not times), by their names in JSON and in results.
struct CounterName {
  const char* name;
  std::uint64_t Counters::*member;
};
inline constexpr std::array<CounterName, 13> counter_names{
    {{"sent", &Counters::sent},
     {"on_time", &Counters::on_time},
     {"late", &Counters::late},
     {"lost", &Counters::lost},
     {"duplicates", &Counters::duplicates},
     {"strays", &Counters::strays},
     {"reordered", &Counters::reordered},
     {"wrong_size", &Counters::wrong_size},
     {"wrong_server_times", &Counters::wrong_server_times},
     {"skipped_cycles", &Counters::skipped_cycles},
     {"refused_sends", &Counters::refused_sends},
     {"dropped_records", &Counters::dropped_records},
     {"trailing_cycles", &Counters::trailing_cycles}}};

// A thread of ontime or of the middleware. Role "send": the client's sending thread; "receive": the thread
// that delivers arrivals.
using transport::Thread;

class Client {
 public:
  // Opens the transport; throws transport::Error. When it returns, its threads exist and wait, so that
  // the caller can set their priorities and CPUs before the first message.
  Client(const transport::Plugin&, const transport::Config&, const ClientOptions&);
  ~Client();
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;

  transport::Endpoint& endpoint();
  std::vector<Thread> threads();

  // Once each. start() sends the warm-up and then waits without sending in State::ready: the caller reads
  // counters then, before the first counted message. go() measures for the duration, in the sending thread.
  void start();
  void go();
  // At any time, from any thread: stops sending. The client is finished once no message is in flight.
  void stop();
  enum class State { waiting, warming_up, ready, measuring, finished };
  State state() const;
  std::uint64_t warm_up_answers() const;

  Counters counters() const;  // any thread, while it runs
  // One ordinary thread: samples of settled messages in order of index. A message
  // counted as lost comes again later if an answer in time is reported after all; the last one is valid.
  std::size_t drain(std::span<Sample> samples);
  // In the draining thread: how many samples wait, and the capacity, which lasts at least 10 s. Drain rarely:
  // it may take CPU time from the measurement.
  std::size_t undrained() const;
  std::size_t capacity() const;

 private:
  class Measurement;
  std::unique_ptr<Measurement> measurement_;
};

// Background topics: ordinary topics beside the critical one. Each is a pair like ping and pong, with one
// message per period and direction; all have the same settings. One thread at each end sends for all; only
// `priority` applies to it.
using transport::Where;
const char* word_of(Where);  // "same-callback-group" …
struct BackgroundOptions {
  int topics = 0;  // 0: no background topics
  Where where = Where::same_participant;
  std::size_t payload_bytes = 1000;
  std::chrono::nanoseconds period{std::chrono::milliseconds(10)};  // of each topic and direction
  transport::Reliability reliability = transport::Reliability::best_effort;
  bool there = true, back = true;  // whether the client's end sends, and the server's
  int priority = 0;                // SCHED_FIFO, of threads used only by these topics; 0: SCHED_OTHER
  // CPU time that the callback of each message takes. It delays everything else on its thread.
  std::chrono::nanoseconds callback{0};
  // 24 bits, the same at both ends: they distinguish their messages from those of other programs.
  std::uint32_t session = 0;
};
// How many messages of all topics together are sent per direction in that time; at least one.
std::uint64_t messages_asked(const BackgroundOptions&, std::chrono::nanoseconds duration);
std::string background_topic(std::string critical, int number);  // "/background_1/ping" of "/ping"

// Counts of the client or of the server. A sent message is lost if the peer did not receive it.
struct BackgroundCounters {
  std::uint64_t sent = 0, refused = 0;
  std::uint64_t skipped_cycles = 0;  // in which nothing was sent: it overran its period
  std::uint64_t received = 0;
  std::uint64_t strays = 0;    // received from other programs
  std::uint64_t overruns = 0;  // of those received: callbacks that took longer than their turn, a period's
                               // share where one thread receives all topics
};

class BackgroundTopics {
 public:
  // `critical`: the endpoint in the same process; null in a separate process. Throws
  // transport::Error.
  BackgroundTopics(const transport::Plugin&, transport::Endpoint* critical, const transport::Config&,
                   const BackgroundOptions&, std::chrono::nanoseconds duration);
  ~BackgroundTopics();  // before the critical endpoint
  BackgroundTopics(const BackgroundTopics&) = delete;
  BackgroundTopics& operator=(const BackgroundTopics&) = delete;

  transport::Endpoint& endpoint();  // one of them
  std::vector<Thread> threads();    // also those shared with the critical endpoint
  bool matched();                   // all of them, both ways

  // Once each. start() sends messages that are not counted, go() counted ones, for the duration.
  void start();
  void go();
  void stop();  // at any time
  BackgroundCounters counters() const;

 private:
  class Group;
  std::unique_ptr<Group> group_;
};

class Server {
 public:
  Server(const transport::Plugin&, const transport::Config&);  // answers from now on; throws transport::Error
  ~Server();
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;

  transport::Endpoint& endpoint();
  std::vector<Thread> threads();
  std::uint64_t answered() const;  // any thread

  struct Answer {
    std::uint64_t sequence;  // see message/message.hpp
    std::int64_t received_ns, sent_ns;
  };
  // Notes each answer from now on; call it once, before drain(). One ordinary thread drains; only the latest
  // 65,536 answers are kept.
  void note_answers();
  std::size_t drain(std::span<Answer>);

 private:
  class Echo;
  std::unique_ptr<Echo> echo_;
};

}  // namespace ontime::roundtrip

// SPDX-License-Identifier: Apache-2.0
// What runs on each host: one process for one end of one run, which carries out the orders of a coordinator
// over its standard input and output and is the measuring process itself, so that two middlewares never meet
// in it. When the pipe breaks, or on SIGTERM, it ends its children, takes back what it changed, and leaves.
//
// Orders and events are frames: a 32-bit little-endian length, and that many bytes of CBOR.
//   order              answer
//   open  {task}       opened {machine, transport, refusals, notes}
//   load  {}           loaded
//   start {wait_ns}    server: started; client: matched, measuring, then progress {counters} and samples
//   {samples}
//                      until finished {counters}
//   stop  {}           none; a client's `finished` comes the sooner
//   close {}           closed {threads, conditions, refusals, facts, answered, load_running}
// and, instead of any answer: failed {exit, message}, after which the agent leaves.
#pragma once

#include <chrono>
#include <map>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "background/background.hpp"
#include "realtime/realtime.hpp"
#include "roundtrip/roundtrip.hpp"

namespace ontime::agent {

// What this host could not do; `exit` is what ontime exits with: 2 wrong input, 3 this machine or a peer
// cannot.
struct Error : std::runtime_error {
  Error(int code, const std::string& message) : std::runtime_error(message), exit(code) {}
  int exit;
};

// The settings of one process. Without them everything stays as it is born: SCHED_OTHER, pageable.
struct RealtimeSettings {
  bool on = false;
  bool lock_memory = false;
  std::optional<std::chrono::microseconds> cpu_latency;
  std::map<std::string, realtime::ThreadSettings> threads;  // by role
};

// One end of one run.
struct Task {
  std::string transport;
  transport::Config config;  // `address` is found by the agent; `fifo_priority` follows from `realtime`
  roundtrip::ClientOptions client;
  RealtimeSettings realtime;
  background::Workers load;
  bool count_instructions = false;  // of each thread; it makes switching between threads a little dearer
};
void to_json(nlohmann::json&, const Task&);
void from_json(const nlohmann::json&, Task&);
void to_json(nlohmann::json&, const RealtimeSettings&);
nlohmann::json to_json(const transport::Qos&);
nlohmann::json to_json(const background::Workers&);
roundtrip::Counters counters_of(const nlohmann::json&);
// Samples travel as their bytes; both ends are the same program.
std::vector<roundtrip::Sample> samples_of(const nlohmann::json&);

// The words of scenario files, flags, records and orders. Nothing for another word.
std::optional<transport::Receive> receive_of(const std::string&);
std::optional<transport::Reliability> reliability_of(const std::string&);
std::optional<transport::History> history_of(const std::string&);
std::optional<transport::Durability> durability_of(const std::string&);
const char* word_of(transport::Receive);

// Carries out orders from standard input until its end. Returns the exit code.
int serve();

// The coordinator's end: an agent started as `prefix… program agent`, in a process group of its own, so that
// a terminal's Ctrl-C reaches the coordinator alone.
// The coordinator ignores SIGPIPE: an agent that is gone shows as Error.
class Handle {
 public:
  explicit Handle(const std::vector<std::string>& prefix);  // throws Error
  ~Handle();  // breaks the pipe, and waits until the agent has left (at most 10 s; then kills it)
  Handle(Handle&&) noexcept;
  Handle& operator=(Handle&&) = delete;

  void order(const std::string& name, nlohmann::json body = nlohmann::json::object());
  // The next event, with its name in "event"; nothing if none came in time. Throws Error for `failed`, and
  // when the agent is gone.
  std::optional<nlohmann::json> event(std::chrono::milliseconds within);

 private:
  struct Process;
  std::unique_ptr<Process> process_;
};

}  // namespace ontime::agent

// SPDX-License-Identifier: Apache-2.0
// The measuring process: one for one end of one run, where that end lives (in its network namespace, say). It
// carries out a coordinator's orders (orders/orders.hpp) and measures, and that is all it does, so that two
// middlewares never meet in it; what belongs to the machine is its keeper's.
//
//   order              answer
//   identify {}        identified {pid}: as its machine has it
//   open  {task, ssh}  opened {transport, refusals, ssh_link}
//   start {wait_ns}    ready {}: a client has matched and warmed up, and sends nothing any more; its
//                      neighbours have matched, and send. With note_answers (else false) a server tells, from
//                      now on and now and then, answered {} with the bytes of its answers, and before `ended`
//                      all that are left
//   begin {}           begun {}: "during the run" is from here on; nothing of ours reads /proc until `end`
//   go    {}           a client: progress {counters}, peer {readers, writers, as_before, at_ns}, samples {}
//                      with bytes, until finished {counters, waited_bytes}; of neighbours nothing
//   stop  {}           none; a client's `finished` comes the sooner
//   end   {}           ended {threads, refusals, facts, losses, drops, link, shared_memory, answered,
//                      neighbours}
//
// `ssh` (else false) says whether events go out by ssh. Then ssh_link is {interface, shared}: over which
// interface here (null: cannot be told), and whether the messages take it as well, or may. Where they do,
// samples wait for the end (waited_bytes of them), lest they disturb what they tell of.
#pragma once

#include <chrono>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "realtime/realtime.hpp"
#include "roundtrip/roundtrip.hpp"
#include "transport/transport.hpp"

namespace ontime::agent {

// The settings of one process. Without them everything stays as it is born: SCHED_OTHER, pageable.
struct RealtimeSettings {
  bool on = false;
  bool lock_memory = false;
  std::optional<std::chrono::microseconds> cpu_latency;
  std::map<std::string, realtime::ThreadSettings> threads;  // by role
};

// One end of one run. With neighbours in another process it is that process: they alone are opened.
struct Task {
  std::string transport;
  transport::Config config;  // `address` is found by the agent; `fifo_priority` follows from `realtime`
  roundtrip::ClientOptions client;
  roundtrip::NeighbourOptions neighbours;
  RealtimeSettings realtime;
  bool count_instructions = false;  // of each thread; it makes switching between threads a little dearer
};
void to_json(nlohmann::json&, const Task&);
void from_json(const nlohmann::json&, Task&);
void to_json(nlohmann::json&, const RealtimeSettings&);
nlohmann::json to_json(const transport::Qos&);
nlohmann::json to_json(const roundtrip::Counters&);
nlohmann::json to_json(const roundtrip::NeighbourCounters&);
roundtrip::Counters counters_of(const nlohmann::json&);

// Samples travel as their bytes: both ends are the same program of the same build, which `hello` shows by
// this.
std::string sample_layout();
std::vector<roundtrip::Sample> samples_of(std::span<const std::uint8_t> bytes);
std::vector<roundtrip::Server::Answer> answers_of(std::span<const std::uint8_t> bytes);

// The words of scenario files, flags, records and orders. Nothing for another word.
std::optional<transport::Receive> receive_of(const std::string&);
std::optional<transport::Reliability> reliability_of(const std::string&);
std::optional<transport::History> history_of(const std::string&);
std::optional<transport::Durability> durability_of(const std::string&);
const char* word_of(transport::Receive);

// Carries out orders from standard input until its end. Returns the exit code.
int serve();

}  // namespace ontime::agent

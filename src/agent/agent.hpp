// SPDX-License-Identifier: Apache-2.0
// The measuring process: one for each end of a run, where that end lives (such as its network namespace). It
// carries out a coordinator's orders (orders/orders.hpp) and only measures, so that two middlewares never
// share a process. The keeper handles what belongs to the machine.
//
//   order              answer
//   identify {}        identified {pid}: as its machine has it
//   open  {task, ssh}  opened: a record::Host with transport, refusals and ssh_link
//   start {wait_ns}    ready {}: a client has matched and warmed up, and sends nothing any more; its
//                      background topics have matched, and send. With note_answers (else false) a server
//                      tells, from now on and now and then, answered {} with the bytes of its answers, and
//                      before `ended` all that are left
//   begin {}           begun {}: "during the run" is from here on; nothing of ours reads /proc until `end`
//   go    {}           a client: progress {counters}, peer {readers, writers, as_before, at_ns}, samples {}
//                      with bytes, until finished {counters, waited_bytes}; of background topics nothing
//   stop  {}           none; a client's `finished` comes sooner
//   end   {}           ended: a record::Host without ssh_link: what the end did since `begin`
//
// `ssh` (default false): whether events go out by ssh. If the messages use its interface too, or may, samples
// wait for the end of the run (waited_bytes of them), so that they do not disturb it.
#pragma once

#include <span>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "conditions/conditions.hpp"
#include "roundtrip/roundtrip.hpp"
#include "transport/transport.hpp"

namespace ontime::agent {

using conditions::Task;
// The form of a run in records (conditions::to_json), with fields that only the end itself needs.
nlohmann::json to_json(const Task&);
Task task_of(const nlohmann::json&);
nlohmann::json to_json(const roundtrip::Counters&);
roundtrip::Counters counters_of(const nlohmann::json&);

// Samples are sent as raw bytes, so both sides must be the same build: `hello` compares this layout.
std::string sample_layout();
std::vector<roundtrip::Sample> samples_of(std::span<const std::uint8_t> bytes);
std::vector<roundtrip::Server::Answer> answers_of(std::span<const std::uint8_t> bytes);

// Carries out orders from standard input until its end. Returns the exit code.
int serve();

}  // namespace ontime::agent

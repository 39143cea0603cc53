// SPDX-License-Identifier: Apache-2.0
#include "campaign/session.hpp"

#include <algorithm>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "campaign/background_topics.hpp"
#include "campaign/link.hpp"
#include "campaign/pollers.hpp"
#include "campaign/traffic.hpp"
#include "record/record.hpp"

namespace ontime::campaign {

using namespace std::chrono_literals;
using record::Outcome;

namespace {

std::string waiting_for(const Run& run, Hosts::Kind kind) {
  if (kind != Hosts::Kind::alone) return "connecting and warming up";
  const auto& peers = run.task.config.peers;
  return "waiting for pong" + (peers.empty() ? "" : fmt::format(" at {}", fmt::join(peers, ", ")));
}

}  // namespace

Session::Session(const Together& runs, const std::vector<std::int64_t>& numbers,
                 orders::Coordinator& coordinator, Machines& machines, record::Writer& writer,
                 Observer& observer, Interrupts& interrupts)
    : runs_(runs),
      run_(runs.front()),
      coordinator_(coordinator),
      machines_(machines),
      writer_(writer),
      observer_(observer),
      interrupts_(interrupts) {
  const auto told = [this](std::size_t number) {
    return Pair::Told{[this, number](const auto samples) {
                        if (!windows_.empty()) windows_[number].add(samples);
                      },
                      [this] {
                        observer_.progress(counters(),
                                           std::min<std::chrono::nanoseconds>(Clock::now() - started_,
                                                                              run_.task.client.duration));
                      }};
  };
  const auto is_secure = [](const Run& run) { return run.security != security::Level::off; };
  try {
    if (std::ranges::any_of(runs, is_secure)) authority_.emplace();
  } catch (const transport::Error& error) {
    throw Error(3, error.what());
  }
  for (std::size_t i = 0; i < runs.size(); ++i)
    pairs_.push_back(std::make_unique<Pair>(runs[i], numbers.at(i), machines, writer, observer, told(i),
                                            authority_ ? &*authority_ : nullptr));
}

Session::~Session() {
  pairs_.clear();  // first: the machines are restored however the agents end
  for (const auto give_back : {&Machines::unload, &Machines::restore}) try {
      (machines_.*give_back)();
    } catch (const std::exception&) {  // the keeper restores the machine when it leaves
    } catch (const orders::Interrupted&) {
    }
}

roundtrip::Counters Session::counters() const {
  roundtrip::Counters sum;
  for (const auto& pair : pairs_)
    for (const auto& [name, member] : roundtrip::counter_names) sum.*member += pair->counters().*member;
  return sum;
}

// The keepers answer each step in spite of an interruption. The next one does not begin then.
void Session::next(const std::string& step) {
  if (coordinator_.interrupted(0)) throw orders::Interrupted{};
  observer_.does(step);
}

std::vector<Outcome> Session::measure(std::chrono::nanoseconds wait) {
  check_pollers(runs_, machines_);
  if (machines_.lacks_namespaces())
    for (const auto& pair : pairs_)
      writer_.note(pair->number(), {"loopback",
                                    "both ends were on loopback: no permission to create network namespaces. "
                                    "Fix: " +
                                        as_root(false),
                                    {},
                                    {}});
  if (!run_.kernel.empty() || run_.isolation.any()) next("applying settings");
  for (const auto& text : machines_.tune(runs_))
    for (const auto& pair : pairs_) writer_.note(pair->number(), {"cpus-shared", text, {}, {}});
  std::vector<Claim> claims;
  for (auto& pair : pairs_) {
    pair->open();
    if (auto claim = pair->claim()) claims.push_back(std::move(*claim));
  }
  if (const auto why = at_another(claims)) throw Error(2, *why);
  if (run_.controller_load.any() || run_.component_load.any() || run_.traffic.any())
    next("starting load and traffic");
  for (const auto& text : machines_.load(runs_))
    for (const auto& pair : pairs_) writer_.note(pair->number(), {"load-scaled", text, {}, {}});
  if (run_.explain) {
    next("starting traces");
    machines_.trace([this](const auto& host, trace::Window window) {
      if (const auto number = Windows::number_of(window); number < windows_.size())
        windows_[number].take(host, std::move(window));
    });
    for (std::size_t i = 0; i < runs_.size(); ++i) windows_.emplace_back(machines_, runs_[i], i);
  }
  next(waiting_for(run_, machines_.hosts().kind));
  for (auto& pair : pairs_) pair->make_ready(wait);
  if (run_.listening.any()) {
    next("setting probes");
    observer_.begins_listening(run_);
    coordinator_.until([this] { return observer_.listens(); }, 1);
  }
  // All accounts are opened while nothing is sent: so opening them is part of no round trip.
  machines_.begin();
  for (auto& pair : pairs_) pair->begin();
  started_ = Clock::now();
  lasted_ = run_.task.client.duration;
  measuring_ = true;
  for (auto& pair : pairs_) pair->go();
  if (std::ranges::any_of(runs_, [](const Run& run) { return run.cut.has_value(); }))
    machines_.cut([this](const auto& component, std::int64_t at_ns) {
      for (auto& pair : pairs_)
        if (component.empty() || component == pair->run().component) pair->note_cut(at_ns);
    });
  finish(run_.task.client.duration + longest_timeout() + patience);
  if (run_.listening.any()) observer_.ends_listening(stopped_);
  return outcomes();
}

void Session::finish(std::chrono::nanoseconds longest) {
  const auto until = Clock::now() + longest;
  const auto over = [&] { return std::ranges::all_of(pairs_, &Pair::over); };
  const auto done = [&] {
    if (interrupts_ > 0 && !stopped_) {
      stopped_ = true;
      lasted_ = std::min<std::chrono::nanoseconds>(lasted_, Clock::now() - started_);
      for (auto& pair : pairs_) pair->stop();
    }
    for (auto& windows : windows_) windows.order();
    if (std::ranges::any_of(pairs_, [&](const auto& pair) { return pair->overdue(until); }))
      throw Error(3, "timed out waiting for the agent of the controller to finish");
    return over();
  };
  do {
    try {
      coordinator_.until(done, 1);
    } catch (const Error& error) {
      if (stopped_ || machines_.lost() || !component_is_gone(error.what())) throw;
      restart_components();
    }
  } while (!over());
}

bool Session::component_is_gone(const std::string& why) {
  return std::ranges::any_of(pairs_, [&](const auto& pair) { return pair->component_is_gone(why); });
}

// While one component restarts, another may be found dead: the loop then restarts that one too.
void Session::restart_components() {
  const auto lacking = [&] { return std::ranges::find_if(pairs_, &Pair::lacks_component); };
  for (auto pair = lacking(); pair != pairs_.end(); pair = lacking()) try {
      (*pair)->restart_component();
    } catch (const Error& error) {
      if (machines_.lost() || !component_is_gone(error.what())) throw;
    }
}

// Waits for the trace windows of the last messages, and writes all windows to the results.
void Session::await_windows() {
  if (windows_.empty()) return;
  const auto until = Clock::now() + patience;
  const auto all_came = [&] {
    for (auto& windows : windows_) windows.order();
    return std::ranges::all_of(windows_, &Windows::all_came);
  };
  coordinator_.until([&] { return all_came() || Clock::now() > until; }, 1);
  for (std::size_t i = 0; i < windows_.size(); ++i) windows_[i].write(writer_, pairs_[i]->number());
}

std::chrono::nanoseconds Session::longest_timeout() const {
  const auto timeout_of = [](const Run& run) { return run.task.client.timeout; };
  return timeout_of(*std::ranges::max_element(runs_, {}, timeout_of));
}

// Background messages on the way get the same timeout as measured ones; then they are lost.
void Session::await_background() {
  const auto has_background = [](const Run& run) { return run.task.background.topics > 0; };
  if (std::ranges::none_of(runs_, has_background)) return;
  const auto until = Clock::now() + longest_timeout();
  coordinator_.until([&] { return Clock::now() > until; }, 1);
}

// Of each run: ontimes do not keep apart what they do to a machine.
void Session::note_other(const std::string& host, const std::string& command) {
  const auto text = fmt::format(
      "another ontime ({}) changed the {}'s machine during the run: by load, link faults, settings "
      "or traces. Fix: measure again without it",
      command, host);
  observer_.note(text);
  for (const auto& pair : pairs_) writer_.note(pair->number(), {"another-ontime", text, {}, {}});
}

std::vector<Outcome> Session::outcomes() {
  observer_.does("ending");
  await_background();
  // Before the traces are read, which may take seconds: the traffic goes on meanwhile.
  for (auto& pair : pairs_) pair->end();
  auto account = machines_.end();
  if (run_.explain) observer_.does("reading traces");
  await_windows();
  machines_.unload();
  machines_.restore();
  for (const auto& [host, others] : account.others)
    for (const auto& other : others) note_other(host, other);
  std::vector<Outcome> outcomes;
  for (const auto& pair : pairs_) {
    const auto& run = pair->run();
    const auto whose = is_named(run) ? run.component + ": " : "";
    auto outcome = pair->outcome(account);
    outcome.interrupted = stopped_;  // an interruption after the end of the run does not count
    if (run.traffic.bits_per_s > 0) {
      outcome.traffic = achieved(run, lasted_, account.traffic.at(run.component));
      for (const auto& text : shortfalls(outcome.traffic)) observer_.note(whose + text);
    }
    if (run.task.background.topics > 0) {
      const auto& topics = run.task.background;
      constexpr std::size_t headers_bytes = 100;  // of RTPS
      const bool is_reliable = topics.reliability == transport::Reliability::reliable;
      outcome.background =
          achieved(topics, outcome, stopped_ ? std::nullopt : std::optional(run.task.client.duration),
                   share_that_arrives(run, lasted_, topics.payload_bytes + headers_bytes, is_reliable));
      for (const auto& text : shortfalls_of_background(outcome.background)) observer_.note(whose + text);
    }
    if (!windows_.empty()) outcome.trace = machines_.how_traced(run.component);
    outcome.link_unproved = unproved(outcome, account.with_traffic[run.component]);
    auto error = went_elsewhere(outcome, run.task.client.payload_bytes);
    if (!error && run.task.config.launch_ns > 0) error = went_past_etf(outcome);
    if (error) outcome.error = whose + *error;
    outcomes.push_back(std::move(outcome));
  }
  return outcomes;
}

std::vector<Outcome> Session::salvage() noexcept {
  try {
    coordinator_.drain();
    if (measuring_ && !std::ranges::all_of(pairs_, &Pair::over)) {
      for (auto& pair : pairs_) pair->abandon();
      stopped_ = true;
      finish(longest_timeout() + 5s);
    }
  } catch (const std::exception&) {       // the first error is the one to report
  } catch (const orders::Interrupted&) {  // a second interruption: leave at once
  }
  std::vector<Outcome> counted;
  for (const auto& pair : pairs_) counted.push_back(pair->outcome());
  return counted;
}

}  // namespace ontime::campaign

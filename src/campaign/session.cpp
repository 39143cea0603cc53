// SPDX-License-Identifier: Apache-2.0
#include "campaign/session.hpp"

#include <algorithm>

#include "campaign/link.hpp"
#include "campaign/neighbours.hpp"
#include "campaign/traffic.hpp"

namespace ontime::campaign {

using namespace std::chrono_literals;
using nlohmann::json;

Session::Session(const std::vector<Run>& runs, const std::vector<std::int64_t>& numbers,
                 orders::Coordinator& coordinator, Machines& machines, record::Writer& writer,
                 Observer& observer, Interrupts& interrupts)
    : run_(runs.front()),
      coordinator_(coordinator),
      machines_(machines),
      writer_(writer),
      observer_(observer),
      interrupts_(interrupts) {
  const Pair::Told told{[this](const auto samples) {
                          if (windows_) windows_->add(samples);
                        },
                        [this] {
                          observer_.progress(counters(),
                                             std::min<std::chrono::nanoseconds>(Clock::now() - started_,
                                                                                run_.task.client.duration));
                        }};
  try {
    if (run_.security != security::Level::off) authority_.emplace();
  } catch (const transport::Error& error) {
    throw Error(3, error.what());
  }
  for (std::size_t i = 0; i < runs.size(); ++i)
    pairs_.push_back(std::make_unique<Pair>(runs[i], numbers.at(i), coordinator, machines, writer, observer,
                                            told, authority_ ? &*authority_ : nullptr));
}

Session::~Session() {
  pairs_.clear();  // how its agents end is not to keep the machines from being given back
  for (const auto give_back : {&Machines::unload, &Machines::restore}) try {
      (machines_.*give_back)();
    } catch (const std::exception&) {  // whoever keeps the machine gives it back when he leaves
    } catch (const orders::Interrupted&) {
    }
}

roundtrip::Counters Session::counters() const {
  roundtrip::Counters sum;
  for (const auto& pair : pairs_)
    for (const auto& [name, member] : roundtrip::counter_names) sum.*member += pair->counters().*member;
  return sum;
}

std::vector<json> Session::measure(std::chrono::nanoseconds wait) {
  machines_.tune(run_);
  for (auto& pair : pairs_) pair->open();
  machines_.load(run_);
  if (run_.explain) {
    traced_ = machines_.trace([this](const auto& host, const auto& window) { windows_->take(host, window); });
    windows_.emplace(machines_, run_.task.client.deadline);
  }
  for (auto& pair : pairs_) pair->make_ready(wait);
  // All accounts are opened while nothing is sent: what opening them costs is nobody's round trip.
  machines_.begin();
  for (auto& pair : pairs_) pair->begin();
  started_ = Clock::now();
  measuring_ = true;
  for (auto& pair : pairs_) pair->go();
  if (run_.cut) machines_.cut(*run_.cut, [this](std::int64_t at_ns) { pairs_.front()->note_cut(at_ns); });
  finish(run_.task.client.duration + run_.task.client.timeout + patience);
  return outcomes();
}

void Session::finish(std::chrono::nanoseconds longest) {
  const auto until = Clock::now() + longest;
  const auto over = [&] {
    return std::all_of(pairs_.begin(), pairs_.end(), [](const auto& pair) { return pair->over(); });
  };
  const auto done = [&] {
    if (interrupts_ > 0 && !stopped_) {
      stopped_ = true;
      for (auto& pair : pairs_) pair->stop();
    }
    if (windows_) windows_->order();
    if (std::any_of(pairs_.begin(), pairs_.end(), [&](const auto& pair) { return pair->overdue(until); }))
      throw Error(3, "the agent of the controller did not finish, long after its time was over");
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
  return std::any_of(pairs_.begin(), pairs_.end(),
                     [&](const auto& pair) { return pair->component_is_gone(why); });
}

// That another died as well may come to light while one is started: then that one is begun anew.
void Session::restart_components() {
  const auto lacking = [&] {
    return std::find_if(pairs_.begin(), pairs_.end(),
                        [](const auto& pair) { return pair->lacks_component(); });
  };
  for (auto pair = lacking(); pair != pairs_.end(); pair = lacking()) try {
      (*pair)->restart_component();
    } catch (const Error& error) {
      if (machines_.lost() || !component_is_gone(error.what())) throw;
    }
}

// What the kernels still know of the last messages, and of all of them into the file.
void Session::await_windows() {
  if (!windows_) return;
  const auto until = Clock::now() + patience;
  windows_->order();
  coordinator_.until([&] { return windows_->all_came() || Clock::now() > until; }, 1);
  windows_->write(writer_, pairs_.front()->number());
}

// As long as a message of ours, theirs may be on its way; then it is lost.
void Session::await_neighbours() {
  if (run_.task.neighbours.topics == 0) return;
  const auto until = Clock::now() + run_.task.client.timeout;
  coordinator_.until([&] { return Clock::now() > until; }, 1);
}

std::vector<json> Session::outcomes() {
  await_windows();
  await_neighbours();
  for (auto& pair : pairs_) pair->end();
  const auto account = machines_.end();
  machines_.unload();
  machines_.restore();
  std::vector<json> outcomes;
  for (const auto& pair : pairs_) {
    auto outcome = pair->outcome(account);
    outcome["interrupted"] = stopped_;  // later, it was whole
    if (run_.traffic.bits_per_s > 0) {
      outcome["traffic"] = achieved(run_.traffic, account.traffic);
      for (const auto& text : shortfalls(outcome.at("traffic"))) observer_.note(text);
    }
    if (run_.task.neighbours.topics > 0) {
      outcome["neighbours"] = achieved(run_.task.neighbours, outcome,
                                       stopped_ ? std::nullopt : std::optional(run_.task.client.duration));
      for (const auto& text : shortfalls_of_neighbours(outcome.at("neighbours"))) observer_.note(text);
    }
    if (windows_) outcome["trace"] = traced_;
    if (const auto why = unproved(outcome)) outcome["link_unproved"] = *why;
    if (const auto elsewhere = went_elsewhere(outcome, run_.task.client.payload_bytes))
      outcome["error"] = (is_named(pair->run()) ? pair->run().component + ": " : "") + *elsewhere;
    outcomes.push_back(std::move(outcome));
  }
  return outcomes;
}

std::vector<json> Session::salvage() noexcept {
  try {
    coordinator_.drain();
    if (measuring_ &&
        std::any_of(pairs_.begin(), pairs_.end(), [](const auto& pair) { return !pair->over(); })) {
      for (auto& pair : pairs_) pair->abandon();
      stopped_ = true;
      finish(run_.task.client.timeout + 5s);
    }
  } catch (const std::exception&) {       // what went wrong first is what is told
  } catch (const orders::Interrupted&) {  // in a hurry
  }
  std::vector<json> counted;
  for (const auto& pair : pairs_) counted.push_back(pair->finished().value_or(json::object()));
  return counted;
}

}  // namespace ontime::campaign

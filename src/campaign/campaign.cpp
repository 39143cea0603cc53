// SPDX-License-Identifier: Apache-2.0
#include "campaign/campaign.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "campaign/search.hpp"
#include "campaign/session.hpp"
#include "gate/gate.hpp"
#include "record/record.hpp"

namespace ontime::campaign {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;

constexpr auto wait_for_own_server = 10s;

std::string text_of(const Run& run, const std::string& what) {
  const auto where = run.where.empty() ? "" : run.where + ": ";
  return fmt::format("{}{} over {}: {}", where, run.id, run.task.transport, what);
}

// Reports each failure once, however many runs fail with it.
class Failures {
 public:
  explicit Failures(Observer& observer) : observer_(observer) {}
  void note(const Run& run, const std::string& what) {
    auto& others = runs_[what];
    if (others.empty()) observer_.note(text_of(run, what));
    others.push_back(run.id);
  }
  void sum_up() const {
    for (const auto& [what, ids] : runs_)
      if (ids.size() > 1) observer_.note(fmt::format("{} runs failed with: {}", ids.size(), what));
  }

 private:
  Observer& observer_;
  std::map<std::string, std::vector<std::string>> runs_;
};

// Carries out runs one after the other, and records how each ended.
class Suite {
 public:
  Suite(record::Writer& writer, Observer& observer, Interrupts& interrupts)
      : writer_(writer),
        observer_(observer),
        interrupts_(interrupts),
        coordinator_(interrupts),
        machines_(coordinator_, observer),
        failures_(observer) {}

  void prepare(const Hosts& hosts, const Machines::Transports& transports = {}) {
    stated_ = hosts;
    machines_.prepare(hosts, transports);
  }
  // Reports what a machine lacks before the first run, not hours later.
  void check(const Scenario& scenario) {
    for (const auto& run : scenario.runs) {
      if (run.faults.any()) machines_.check(run);
      for (const auto& own : run.own)
        if (own.faults.any() && own.faults != run.faults) machines_.check(own);
    }
  }
  record::ByName<record::Machine> machines(const Run& run) const {
    return {{"controller", machines_.machine("controller")}, {"component", machines_.machine(run.component)}};
  }
  Hosts::Kind kind() const { return machines_.hosts().kind; }

  using Numbers = std::vector<std::int64_t>;

  // The result of runs that are measured at the same time.
  struct Result {
    int code = 0;  // to exit with: not 0 if they failed, but for those that end a search
    bool ends_search = false;
    Numbers never_begun{};  // those that ended before the first message was sent
  };
  Result carry_out(const Together& runs, std::chrono::nanoseconds wait, const std::vector<json>& records) {
    Numbers numbers;
    for (const auto& record : records) numbers.push_back(writer_.begin_run(record));
    int code = 0;
    bool ends = false, has_begun = false;
    {
      Session session(runs, numbers, coordinator_, machines_, writer_, observer_, interrupts_);
      try {
        const auto outcomes = session.measure(wait);
        for (std::size_t i = 0; i < runs.size(); ++i) {
          if (const auto& error = outcomes[i].error) {
            failures_.note(runs[i], *error);
            code = 3;
          }
          const auto outcome = record::to_json(outcomes[i]);
          ends = ends || gate::ends_search(records[i], outcome);
          writer_.end_run(numbers[i], outcome);
        }
        observer_.ends(session.counters());
      } catch (const orders::Interrupted&) {
        observer_.does("ending");
        coordinator_.drain();  // samples that are here, and not yet read
        record::Outcome interrupted;
        interrupted.interrupted = true;
        for (const auto number : numbers) writer_.end_run(number, record::to_json(interrupted));
      } catch (const orders::Unanswered& error) {
        code = failed(session, runs.front(), numbers, records.front(), {error.what(), true}, error.exit);
        ends = code == 0;
      } catch (const Refused& error) {
        code = failed(session, runs.front(), numbers, records.front(), {error.what(), false, error.setting},
                      error.exit);
      } catch (const Error& error) {
        code = failed(session, runs.front(), numbers, records.front(), {error.what()}, error.exit);
      } catch (const json::exception& error) {  // an answer without the expected fields
        const auto why =
            fmt::format("a worker sent an invalid answer ({}). Fix: install the same build on both machines",
                        error.what());
        code = failed(session, runs.front(), numbers, records.front(), {why}, 3);
      }
      has_begun = session.has_begun();
    }
    for (const auto number : numbers) observer_.recorded(number);
    const auto never_begun = has_begun ? Numbers() : numbers;
    if (interrupts_ > 0) return {130, true, never_begun};
    // A keeper that is gone: what it held is restored before the next run.
    if (machines_.lost()) machines_.prepare(stated_);
    return {code, ends, never_begun};
  }

  void close() {
    machines_.close();
    failures_.sum_up();
  }

 private:
  struct Why {
    std::string error;
    bool unanswered = false;
    std::string refused_setting{};
  };
  // A failure of one run ends all that run at the same time: the requested conditions no longer hold. Returns
  // the exit code: 0 if the failure is the end of a search.
  int failed(Session& session, const Run& run, const Numbers& numbers, const json& record, const Why& why,
             int exit) {
    observer_.does("ending");
    auto outcomes = session.salvage();
    bool ends = false;
    for (std::size_t i = 0; i < numbers.size(); ++i) {
      outcomes[i].error = why.error;
      outcomes[i].unanswered = why.unanswered;
      outcomes[i].refused_setting = why.refused_setting;
      outcomes[i].interrupted = interrupts_ > 0;
      const auto outcome = record::to_json(outcomes[i]);
      ends = ends || gate::ends_search(record, outcome);
      writer_.end_run(numbers[i], outcome);
    }
    if (ends)
      observer_.note(text_of(
          run, fmt::format("the search of {} ends at {}: {}", run.step.key, run.step.value, why.error)));
    else
      failures_.note(run, why.error);
    return ends ? 0 : exit;
  }

  record::Writer& writer_;
  Observer& observer_;
  Interrupts& interrupts_;
  orders::Coordinator coordinator_;
  Machines machines_;
  Failures failures_;
  Hosts stated_;
};

std::vector<json> records_of(const Scenario& scenario, const Together& runs, Hosts::Kind kind) {
  auto records = asked(runs, scenario.hosts);
  for (auto& record : records) {
    record["scenario"] = scenario.text;
    record["scenario_file"] = scenario.file;
    record["hosts"] = word_of(kind);
  }
  return records;
}

// Carries out a scenario's runs, those that are not done.
class Execution {
 public:
  Execution(const Scenario& scenario, Suite& suite, Observer& observer, const json& command_line,
            const Done& done)
      : scenario_(scenario), suite_(suite), observer_(observer), command_line_(command_line), done_(done) {}

  // Returns the exit code.
  int carry_out() {
    for (std::size_t i = 0; i < scenario_.size() && code_ != 130; ++i)
      if (const auto run = scenario_.at(i); run.step.of == 0) measure(run);
    for (std::size_t first = 0; first < scenario_.runs.size() && code_ != 130; ++first)
      if (const auto& step = scenario_.runs[first].step; step.of > 0 && step.number == 0) search(first);
    return code_;
  }

 private:
  Suite::Result measure(const Run& run) {
    const auto runs = together(run, scenario_.hosts);
    auto records = records_of(scenario_, runs, suite_.kind());
    for (auto& record : records) record["command_line"] = command_line_;
    std::size_t known = 0;
    bool ends = false;
    for (std::size_t at = 0; done_ && at < runs.size(); ++at)
      if (const auto* outcome = done_(records[at], suite_.machines(runs[at]))) {
        ++known;
        ends = ends || gate::ends_search(records[at], *outcome);
      }
    if (known == runs.size()) {
      observer_.passes_over(run);
      return {0, ends};
    }
    if (known > 0)
      observer_.note(
          fmt::format("{}: {} of {} components are already in the results; all are measured again, because "
                      "they run at the same time",
                      run.id, known, runs.size()));
    observer_.begins(run);
    auto result = suite_.carry_out(runs, wait_for_own_server, records);
    code_ = std::max(code_, result.code);
    return result;
  }

  // Searches the steps that begin with this run. Each is repeated like any run, until it misses. A failure
  // that does not depend on the value ends the search.
  void search(std::size_t first) {
    const auto number_of_steps = scenario_.runs[first].step.of;
    std::vector<int> times(static_cast<std::size_t>(number_of_steps), 0);
    const auto step = [&](int number) { return scenario_.runs[first + static_cast<std::size_t>(number)]; };
    Search search(number_of_steps);
    bool failed = false;
    for (auto number = search.next(); number && !failed; number = search.next()) {
      bool missed = false;
      auto& measured = times[static_cast<std::size_t>(*number)];
      while (!missed && !failed && measured < scenario_.repeat) {
        auto run = step(*number);
        run.repetition = ++measured;
        const auto came = measure(run);
        failed = came.code != 0;
        missed = came.ends_search;
        if (code_ == 130) return;
      }
      search.tell(missed);
    }
    for (int number = 0; number < number_of_steps; ++number)
      for (auto left = times[static_cast<std::size_t>(number)]; left < scenario_.repeat; ++left)
        observer_.leaves_out(step(number));
  }

  const Scenario& scenario_;
  Suite& suite_;
  Observer& observer_;
  const json& command_line_;
  const Done& done_;
  int code_ = 0;
};

json differences(const json& one, const json& other) {
  auto different = json::object();
  for (const auto& [key, value] : other.items())
    if (one.value(key, json()) != value) different[key] = value;
  for (const auto& [key, value] : one.items())
    if (!other.contains(key)) different[key] = "none";
  different.erase("beside");  // a text about the same conditions
  return different;
}

Machines::Transports transports_of(const Scenario& scenario) {
  Machines::Transports transports;
  for (const auto& asked : scenario.runs)
    for (const auto& run : together(asked, scenario.hosts)) {
      transports["controller"].insert(run.task.transport);
      transports[run.component].insert(run.component_transport.empty() ? run.task.transport
                                                                       : run.component_transport);
    }
  return transports;
}

}  // namespace

std::vector<json> asked(const Together& runs, const Hosts& hosts) {
  std::vector<json> all, conditions;
  for (const auto& run : runs)
    conditions.push_back(record::conditions_of(all.emplace_back(asked(run, hosts))));
  for (std::size_t i = 0; i < runs.size(); ++i)
    for (std::size_t other = 0; other < runs.size(); ++other)
      if (i != other) all[i]["others"][runs[other].component] = differences(conditions[i], conditions[other]);
  return all;
}

Plan plan_of(const Scenario& scenario, const Done& done) {
  Plan plan{scenario.size(), 0, time_of(scenario)};
  const auto kind = Machines::kind_here(scenario.hosts);
  for (std::size_t i = 0; done && i < scenario.size(); ++i) {
    const auto run = scenario.at(i);
    if (run.step.of > 0) continue;  // only its search knows whether it needs this step
    const auto records = records_of(scenario, together(run, scenario.hosts), kind);
    if (!std::ranges::all_of(records, [&](const auto& record) { return done(record, {}) != nullptr; }))
      continue;
    ++plan.known;
    plan.time -= time_of(run);
  }
  return plan;
}

void Observer::begins_listening(const Run&) {
  throw Error(2, "listen.topics: only `ontime run` listens during a run. Fix: remove the key");
}

int execute(const Scenario& scenario, record::Writer& writer, Observer& observer, Interrupts& interrupts,
            const json& command_line, const Done& done) {
  Suite suite(writer, observer, interrupts);
  try {
    suite.prepare(scenario.hosts, transports_of(scenario));
    suite.check(scenario);
    const int code = Execution(scenario, suite, observer, command_line, done).carry_out();
    suite.close();
    return code;
  } catch (const orders::Interrupted&) {
    return 130;
  }
}

int ping(const Run& run, std::chrono::nanoseconds wait, record::Writer& writer, Observer& observer,
         Interrupts& interrupts, const json& command_line) {
  Suite suite(writer, observer, interrupts);
  try {
    Hosts alone;
    alone.kind = Hosts::Kind::alone;
    suite.prepare(alone);
    observer.begins(run);
    auto record = asked(run, alone);
    record["command_line"] = command_line;
    const auto result = suite.carry_out({run}, wait, {record});
    for (const auto number : result.never_begun) writer.forget_run(number);
    suite.close();
    return result.code;
  } catch (const orders::Interrupted&) {
    return 130;
  }
}

}  // namespace ontime::campaign

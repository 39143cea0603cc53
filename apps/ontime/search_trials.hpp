// SPDX-License-Identifier: Apache-2.0
// The runs of a search for settings, carried out as those of `ontime run` are. The results file is the
// search's only memory: from the runs in it, in their order, the search decides the same again and goes on
// from there.
#pragma once

#include <chrono>
#include <deque>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "campaign/campaign.hpp"
#include "search/goal.hpp"
#include "search/knobs.hpp"
#include "terminal.hpp"

namespace ontime::app {

// The subject of a search. Its results store it, and only the same search can resume.
struct Subject {
  std::string scenario;  // the text of its file
  std::string goal, run, settings;
  std::string machine;                       // simulator of the controller's machine; "": a real machine
  record::ByName<record::Machine> machines;  // of "controller" and "component"; empty: not known here
};
// The subject's settings of the search in the results; "": they have none.
std::string settings_of(const record::Reader&);
// Whether such settings have that value among those to try.
bool is_among(const std::string& settings, const search::Setting&);
// The simulator of its controller's machine; "": a real machine, or no run.
std::string machine_of(const record::Reader&);

class Trials {
 public:
  using Clock = std::chrono::steady_clock;
  // The scenario with one run that has this set.
  using ScenarioWith = std::function<campaign::Scenario(const search::Set&)>;
  struct Places {
    record::Writer& writer;
    Terminal& terminal;
    campaign::Interrupts& interrupts;
    std::function<void(std::int64_t run)> counts = [](std::int64_t) {};  // its record is complete
  };

  Trials(Subject, ScenarioWith, const std::vector<search::Part>& goal, const search::Bounds&,
         Clock::time_point until, Places);

  // Reads the runs in the results as answers. Throws Error{2} if they are of another search.
  void recall(const std::string& results);
  // Stops the search after the recalled runs, for this reason.
  void end(const std::string& why, int code) { end_ = {why, code}; }

  // Nothing: it stopped. A run whose failure is not its set's is retried twice; then, or if no run was
  // measured before, the search stops.
  std::optional<search::Answer> measure(const search::Order&);
  const std::string& stopped() const { return stopped_; }  // why, for people; "": it did not
  int code() const { return code_; }                       // to exit with then

 private:
  struct Known {
    std::string text;
    record::Run run;
  };

  std::nullopt_t stop(const std::string& why, int code);
  std::optional<record::Run> recalled(const search::Order&, const campaign::Scenario&);
  std::optional<search::Answer> attempts(const search::Order&, const campaign::Scenario&);
  bool wait_after(const std::string& failure);
  std::optional<search::Answer> measured(const search::Order&, const campaign::Scenario&);
  void note_run(std::int64_t number, const search::Order&);
  search::Answer answer_of(const record::Run&);
  std::string denied(const record::Run&);

  const Subject subject_;
  const ScenarioWith scenario_with_;
  const std::vector<search::Part>& goal_;
  const search::Bounds& bounds_;
  const Clock::time_point until_;
  Places places_;
  std::deque<Known> known_;
  std::optional<std::vector<std::string>> denied_at_first_;  // settings that the scenario itself was denied
  std::optional<std::pair<std::string, int>> end_;
  std::string stopped_;
  std::string results_;  // recalled, for people
  int code_ = 0;
  bool is_subject_noted_ = false;
};

}  // namespace ontime::app

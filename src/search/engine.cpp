// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <random>
#include <set>

#include <fmt/format.h>

#include "search/measured.hpp"
#include "search/search.hpp"

namespace ontime::search {
namespace {

constexpr double steering_alpha = 0.2;  // of decisions that a later trial can correct
constexpr double likely_share = 0.15;   // of all messages: a cause of so many is rarely wrong
constexpr int most_runs_alone = 24, most_pairs = 10, most_pairs_to_confirm = 40;
constexpr int least_pairs = 2;               // before a trial is given up as without effect
constexpr std::size_t least_references = 3;  // more are made only while the set itself breaks the goal
constexpr int most_confirmations = 3;
constexpr int most_attempts = 3;  // to measure a set

struct NoTime {};
struct CannotMeasure {
  std::string why;
};

double spent(double alpha, std::size_t statement) {
  return alpha / static_cast<double>(statement * (statement + 1));
}

class Search {
 public:
  Search(const Problem& problem, const Measure& measure)
      : problem_(problem), measure_(measure), measured_(problem), chance_(problem.seed) {}

  Outcome find() {
    try {
      outcome_.end = search();
    } catch (const NoTime&) {
      outcome_.end = End::no_time;
    } catch (const CannotMeasure& error) {
      outcome_.end = End::cannot_measure;
      outcome_.why = error.why;
    }
    outcome_.set = set_;
    if (outcome_.end != End::goal_holds) {
      outcome_.remaining = findings_of(set_);
      outcome_.proofs.clear();
    }
    for (const auto& [key, value] : set_) outcome_.contributions.push_back(contribution_of({key, value}));
    return std::move(outcome_);
  }

 private:
  using Purpose = Trial::Purpose;

  End search() {
    if (measure_alone(set_) == Decision::holds) return End::goal_holds;
    for (int attempt = 0; attempt < most_confirmations; ++attempt) {
      if (!grow()) return not_met();
      shrink();
      const auto decision = confirm();
      if (decision == Decision::holds) return End::goal_holds;
      if (decision == Decision::no_effect) return End::not_proven;
      disproved_.insert(set_);
    }
    return not_met();
  }

  // nothing_left only where failure is proven.
  End not_met() {
    if (!keeps_to_goal(set_)) remove_ineffective();
    return measured_.fails(measured_.of(set_), level_of(set_)) ? End::nothing_left : End::not_proven;
  }

  // ── Trials

  // One run; null if the set is refused. Failures that may pass are retried. For a vital set a recalled
  // refusal is retried, too, because the search cannot go on without it.
  const Answer* measure(const Set& set, Trial& trial, bool is_vital) {
    for (int attempt = 1;; ++attempt) {
      auto run = measure_({static_cast<int>(outcome_.trials.size()) + 1, outcome_.runs + 1, set});
      if (!run) throw NoTime{};
      ++outcome_.runs;
      ++trial.runs;
      if (run->refused.empty()) return measured_.add(set, std::move(*run));
      refused_setting_ = run->refused_setting;
      if (run->may_pass && attempt < most_attempts) continue;
      if (!is_vital || !run->is_recalled) {
        trial.why = run->refused;  // only now: where a later attempt succeeds, the cause stays the reason
        return nullptr;
      }
      attempt = 0;
    }
  }

  Decision ended(Trial trial, const Runs& mine, const Runs& theirs, Decision decision) {
    trial.decision = decision;
    if (!mine.empty()) trial.shares = measured_.shares(mine, problem_.alpha);
    if (!theirs.empty()) trial.reference_shares = measured_.shares(theirs, problem_.alpha);
    outcome_.trials.push_back(std::move(trial));
    return decision;
  }

  // Measures the set until it is known whether the goal holds.
  Decision measure_alone(const Set& set) {
    measured_alone_.insert(set);
    Trial trial{Purpose::measure, set};
    Runs runs;
    while (trial.runs < most_runs_alone) {
      const auto* run = measure(set, trial, true);
      if (run == nullptr) throw CannotMeasure{trial.why};
      runs.push_back(run);
      const auto all = measured_.of(set);
      const auto alpha = set.empty() ? level_of_start() : problem_.alpha;
      if (measured_.kept_to(all) && measured_.holds(all, alpha)) {
        outcome_.proofs = measured_.proofs(all, alpha);
        return ended(trial, runs, {}, Decision::holds);
      }
      if (measured_.fails(all, level_of(set))) return ended(trial, runs, {}, Decision::fails);
    }
    return ended(trial, runs, {}, Decision::no_effect);
  }

  // Runs of the set and its reference alternate in random order, until `decide` gives a decision.
  template <class Decide>
  Decision compare(Purpose purpose, const Set& set, const Set& reference, const std::string& why, int pairs,
                   Decide decide) {
    Trial trial{purpose, set, reference};
    trial.why = why;
    Runs mine, theirs;
    std::optional<Decision> decision;
    for (int pair = 1; pair <= pairs && !decision; ++pair) {
      const bool mine_first = chance_() % 2 == 0;
      for (const bool is_mine : {mine_first, !mine_first}) {
        if (!is_mine && theirs.size() >= least_references && measured_.kept_to(mine)) continue;
        const auto* run = measure(is_mine ? set : reference, trial, !is_mine);
        if (run == nullptr && !is_mine) throw CannotMeasure{trial.why};
        if (run == nullptr) return ended(trial, mine, theirs, Decision::refused);
        (is_mine ? mine : theirs).push_back(run);
      }
      decision = decide(mine, theirs);
    }
    return ended(trial, mine, theirs, decision.value_or(Decision::no_effect));
  }

  Decision try_to_add(const Set& set, const std::string& why) {
    bool improves = false, seems_to = false;
    const auto decision =
        compare(Purpose::add, set, set_, why, most_pairs,
                [&](const Runs& mine, const Runs& theirs) -> std::optional<Decision> {
                  if (holds(set)) return Decision::holds;
                  improves = improves || measured_.fewer(mine, theirs, problem_.alpha);
                  if (improves && measured_.fails(measured_.of(set), problem_.alpha))
                    return Decision::improves;
                  if (measured_.fewer(theirs, mine, problem_.alpha)) return Decision::harms;
                  seems_to = measured_.fewer(mine, theirs, steering_alpha);
                  if (!improves && mine.size() >= least_pairs && measured_.looks_no_less(mine, theirs))
                    return Decision::no_effect;
                  return {};
                });
    if (decision != Decision::no_effect || !(improves || seems_to)) return decision;
    return outcome_.trials.back().decision = Decision::improves;
  }

  // By the measured shares, without proof; `without` may be better.
  bool is_no_worse(const Set& without) {
    bool looks_no_worse = false;
    const auto decision =
        compare(Purpose::remove, without, set_, "", most_pairs,
                [&](const Runs& mine, const Runs& theirs) -> std::optional<Decision> {
                  if (holds(without)) return Decision::holds;
                  if (measured_.fewer(mine, theirs, problem_.alpha)) return Decision::improves;
                  if (measured_.fewer(theirs, mine, problem_.alpha)) return Decision::harms;
                  looks_no_worse = measured_.looks_no_less(theirs, mine);
                  if (mine.size() >= least_pairs && looks_no_worse && !measured_.kept_to(mine))
                    return Decision::no_effect;
                  return {};
                });
    return decision == Decision::holds || decision == Decision::improves ||
           (decision == Decision::no_effect && looks_no_worse);
  }

  bool was_compared(const Set& set, const Set& reference) const {
    return std::any_of(outcome_.trials.begin(), outcome_.trials.end(), [&](const Trial& trial) {
      return trial.set == set && trial.reference == reference && trial.purpose != Purpose::confirm;
    });
  }

  // Whether the goal is proven to hold by `without`.
  bool can_go(const Set& without, bool single) {
    const auto decision = compare(
        Purpose::remove, without, set_, "", most_pairs,
        [&](const Runs& mine, const Runs& theirs) -> std::optional<Decision> {
          if (holds(without)) return Decision::holds;
          const auto alpha = single ? level_of(without) : problem_.alpha;
          if (measured_.fails(measured_.of(without), alpha) && measured_.fewer(theirs, mine, problem_.alpha))
            return Decision::fails;
          return {};
        });
    if (decision != Decision::no_effect || !measured_.kept_to(measured_.of(without)))
      return decision == Decision::holds;
    return measure_alone(without) == Decision::holds;
  }

  // By new runs only. Also `fails` if one message breaks a limit that permits none.
  Decision confirm() {
    const auto alpha = spent(problem_.alpha - level_of_start(), ++confirmations_);
    return compare(Purpose::confirm, set_, {}, "", most_pairs_to_confirm,
                   [&](const Runs& mine, const Runs&) -> std::optional<Decision> {
                     if (measured_.fails(mine, problem_.alpha)) return Decision::fails;
                     if (!measured_.holds(mine, alpha)) return {};
                     outcome_.proofs = measured_.proofs(mine, alpha);
                     return measured_.kept_to(mine) ? Decision::holds : Decision::fails;
                   });
  }

  // By the measured shares, without proof.
  bool keeps_to_goal(const Set& set) const {
    return !disproved_.contains(set) && measured_.kept_to(measured_.of(set));
  }

  bool holds(const Set& set) const {
    return !disproved_.contains(set) && measured_.holds(measured_.of(set), steering_alpha);
  }

  // Alpha of the statement that the goal holds without any setting. Confirmations share the rest.
  double level_of_start() const { return problem_.alpha / 4; }

  // Alpha of the statement that the goal fails by this set.
  double level_of(const Set& set) {
    return spent(problem_.alpha, statements_.try_emplace(set, statements_.size() + 1).first->second);
  }

  // ── What to add

  // False: nothing is left to try, or more settings would not help the proof.
  bool grow() {
    while (!holds(set_)) {
      if (keeps_to_goal(set_)) {
        if (!measured_alone_.contains(set_)) measure_alone(set_);
        if (keeps_to_goal(set_) && !holds(set_)) return false;
      } else if (!add_likely_remedies() && !add_a_remedy() && !add_all_remedies() && !add_remaining() &&
                 !retry_harmful()) {
        return false;
      }
    }
    return true;
  }

  const Knob* knob_named(const std::string& key) const {
    const auto found = std::ranges::find(problem_.knobs, key, &Knob::key);
    return found == problem_.knobs.end() ? nullptr : &*found;
  }

  bool may_be_set(const Setting& setting) const {
    const auto present = set_.find(setting.key);
    return knob_named(setting.key) != nullptr &&
           (present == set_.end() || present->second != setting.value) &&
           !refused_.contains({setting.key, setting.value}) &&
           !harmful_.contains({setting.key, setting.value});
  }

  // Whether any of the settings was kept.
  bool add(const std::vector<Setting>& settings, const std::string& why) {
    auto set = set_;
    for (const auto& [key, value] : settings) set[key] = value;
    for (const auto& knob : problem_.knobs)
      if (const auto* whole = knob_named(knob.part_of); whole != nullptr && set.contains(knob.key))
        set.try_emplace(whole->key, whole->values.front());
    if (settings.empty() || was_compared(set, set_)) return false;
    refused_setting_.clear();
    const auto decision = try_to_add(set, why);
    if (decision == Decision::refused && set.contains(refused_setting_) && !set_.contains(refused_setting_)) {
      auto others = settings;
      std::erase_if(others, [&](const Setting& one) { return one.key == refused_setting_; });
      refused_.insert({refused_setting_, set.at(refused_setting_)});
      return add(others, why);
    }
    if (decision == Decision::holds || decision == Decision::improves) {
      set_ = set;
      return true;
    }
    if (decision == Decision::no_effect) return false;
    if (settings.size() == 1) {
      const auto& [key, value] = settings.front();
      (decision == Decision::harms ? harmful_ : refused_).insert({key, value});
      return false;
    }
    const auto half = settings.begin() + static_cast<std::ptrdiff_t>(settings.size() / 2);
    return add({settings.begin(), half}, why) || add({half, settings.end()}, why);
  }

  // Tries the first remedy of each frequent cause together, if there are several: a strict goal needs all of
  // them removed. Rare causes may be wrong.
  bool add_likely_remedies() {
    const auto findings = findings_of(set_);
    double messages = 0;
    for (const auto& finding : findings) messages += finding.messages;
    std::vector<Setting> all;
    for (const auto& finding : findings) {
      const auto remedy =
          std::ranges::find_if(finding.remedies, [&](const Setting& one) { return may_be_set(one); });
      if (finding.messages >= likely_share * messages && remedy != finding.remedies.end())
        append_if_new(all, *remedy);
    }
    return all.size() > 1 && add(all, "the most frequent causes together");
  }

  static void append_if_new(std::vector<Setting>& all, const Setting& one) {
    if (std::ranges::find(all, one.key, &Setting::key) == all.end()) all.push_back(one);
  }

  bool add_a_remedy() {
    for (const auto& finding : findings_of(set_))
      for (const auto& remedy : finding.remedies)
        if (may_be_set(remedy) && add({remedy}, finding.cause)) return true;
    return false;
  }

  // If two causes hide each other, no single remedy has an effect; a cause may also appear only after another
  // is removed.
  bool add_all_remedies() {
    std::vector<Setting> all;
    const auto collect = [&](const Set& set) {
      for (const auto& finding : findings_of(set))
        for (const auto& remedy : finding.remedies)
          if (may_be_set(remedy)) append_if_new(all, remedy);
    };
    collect(set_);
    for (const auto& trial : outcome_.trials)
      if (trial.purpose == Purpose::add && trial.reference == set_) collect(trial.set);
    return all.size() > 1 && add(all, "all causes together");
  }

  // Settings that no cause proposes, together, because most have no effect: the first value of each, then the
  // next.
  bool add_remaining() {
    std::size_t most = 0;
    for (const auto& knob : problem_.knobs) most = std::max(most, knob.values.size());
    for (std::size_t value = 0; value < most; ++value) {
      std::vector<Setting> all;
      for (const auto& knob : problem_.knobs)
        if (value < knob.values.size() && !set_.contains(knob.key) &&
            may_be_set({knob.key, knob.values[value]}))
          all.push_back({knob.key, knob.values[value]});
      if (!add(all, "settings without a named cause")) continue;
      if (!holds(set_)) remove_ineffective();
      return true;
    }
    return false;
  }

  // A setting that harmed another set may help this one.
  bool retry_harmful() { return !std::exchange(harmful_, {}).empty(); }

  std::vector<Finding> findings_of(const Set& set) const {
    std::vector<Finding> findings;
    for (const auto* run : measured_.of(set))
      for (const auto& finding : run->findings) {
        const auto known = std::ranges::find(findings, finding.cause, &Finding::cause);
        if (known == findings.end())
          findings.push_back(finding);
        else
          known->messages += finding.messages;
      }
    std::ranges::stable_sort(findings, std::greater(), &Finding::messages);
    return findings;
  }

  // ── What to leave out

  // Parts of half the size each time, down to single members (delta debugging: Zeller & Hildebrandt 2002).
  void shrink() {
    for (auto size = std::max<std::size_t>(set_.size() / 2, 1);; size = std::max<std::size_t>(size / 2, 1)) {
      const bool removed = leave_out_parts(size);
      if (size == 1 && !removed) return;
    }
  }

  // Some members that were added together may harm and hide the effect of others.
  void remove_ineffective() {
    for (auto size = set_.size() / 2; size > 0; size /= 2)
      for (const auto& part : parts(size))
        if (const auto without = set_without(part);
            without != set_ && !was_compared(set_, without) && is_no_worse(without))
          set_ = without;
  }

  // The members in parts of this size.
  std::vector<std::vector<Setting>> parts(std::size_t size) const {
    std::vector<std::vector<Setting>> parts;
    for (const auto& [key, value] : set_) {
      if (parts.empty() || parts.back().size() == size) parts.emplace_back();
      parts.back().push_back({key, value});
    }
    return parts;
  }

  Set set_without(const std::vector<Setting>& part) const {
    auto set = set_;
    for (const auto& one : part) set.erase(one.key);
    for (const auto& knob : problem_.knobs)
      if (knob_named(knob.part_of) != nullptr && !set.contains(knob.part_of)) set.erase(knob.key);
    return set;
  }

  bool leave_out_parts(std::size_t size) {
    bool removed = false;
    for (const auto& part : parts(size)) {
      const auto without = set_without(part);
      if (without.empty() || without == set_ || is_known(without)) continue;
      if (can_go(without, size == 1)) {
        set_ = without;
        removed = true;
      } else {
        kept_.insert({without, set_});
      }
    }
    return removed;
  }

  bool is_known(const Set& without) {
    if (kept_.contains({without, set_})) return true;
    return (was_compared(without, set_) || was_compared(set_, without)) &&
           measured_.fails(measured_.of(without), level_of(without));
  }

  Contribution contribution_of(const Setting& member) {
    const auto without = set_without({member});
    Contribution contribution{member, {}, measured_.fails(measured_.of(without), level_of(without))};
    const auto with_it = measured_.shares(measured_.of(set_), problem_.alpha / 2);
    const auto without_it = measured_.shares(measured_.of(without), problem_.alpha / 2);
    for (std::size_t limit = 0; limit < measured_.limits(); ++limit)
      contribution.less.push_back({without_it[limit].range.low - with_it[limit].range.high,
                                   without_it[limit].range.high - with_it[limit].range.low});
    return contribution;
  }

  const Problem& problem_;
  const Measure& measure_;
  Measured measured_;
  std::mt19937_64 chance_;
  Outcome outcome_;
  Set set_;  // the present one
  std::set<Set> measured_alone_, disproved_;
  std::set<std::pair<Set, Set>> kept_;  // members that stayed: the set without them, and with them
  std::set<std::pair<std::string, std::string>> refused_, harmful_;
  std::map<Set, std::size_t> statements_;
  std::size_t confirmations_ = 0;
  std::string refused_setting_;  // of the last refused run
};

template <class Word, std::size_t size>
const char* word(const char* const (&words)[size], Word value) {
  return words[static_cast<std::size_t>(value)];
}

}  // namespace

std::string text_of(const Finding& finding) {
  return fmt::format("{:.0f} of the analyzed messages: {}", finding.messages, finding.cause);
}

const char* word_of(Decision decision) {
  return word({"holds", "fails", "improves", "harms", "no effect", "refused"}, decision);
}
const char* word_of(Trial::Purpose purpose) { return word({"measure", "add", "remove", "confirm"}, purpose); }
const char* word_of(End end) {
  return word({"goal-holds", "not-proven", "nothing-left", "no-time", "cannot-measure"}, end);
}

Outcome find(const Problem& problem, const Measure& measure) { return Search(problem, measure).find(); }

}  // namespace ontime::search

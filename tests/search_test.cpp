// SPDX-License-Identifier: Apache-2.0
#include "search/search.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "search/goal.hpp"
#include "search/measured.hpp"
#include "search_machine.hpp"

namespace ontime::search {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;
using testing::Pair;
using testing::SizeIs;

Outcome found_by(Machine& machine, std::uint64_t seed = 1, int most_runs = 1'000'000) {
  return find(Machine::problem(seed), [&](const Order& order) -> std::optional<Answer> {
    if (order.number > most_runs) return {};
    return machine.run(order.set);
  });
}

const Fault& fault(const std::string& name) {
  return *std::find_if(ten_faults().begin(), ten_faults().end(),
                       [&](const Fault& one) { return one.name == name; });
}

TEST(Evidence, EValuesOfTheirNullHypothesisAreOneOnAverage) {
  std::mt19937_64 chance(1);
  double at_least = 0, at_most = 0;
  constexpr int times = 20'000;
  for (int i = 0; i < times; ++i) {
    const Count count{static_cast<double>(std::binomial_distribution<int>(20, 0.05)(chance)), 20};
    at_least += against_at_least(count, 0.05) / times;
    at_most += against_at_most(count, 0.05) / times;
  }
  EXPECT_NEAR(at_least, 1, 0.15);
  EXPECT_LT(at_most, 1.2);
}

// Forty messages in one burst of a run are one event, however many calm runs there are of other sets.
TEST(Measured, CalmRunsOfOtherSetsDoNotShortenTheBurstsOfOne) {
  Problem problem;
  problem.goal = {{"p99.9 < 1 ms", 0.001}};
  Measured measured(problem);
  const Set set = {{"realtime", "on"}};
  const auto add = [&](const Set& of, const Tally& tally) { measured.add(of, {{tally}, {}, {}}); };
  add(set, {40, 2000, 40});
  add(set, {0, 2000, 1.6});
  const auto before = measured.shares(measured.of(set), 0.05).front().range;
  for (int i = 0; i < 20; ++i) add({}, {0, 2000, 1.6});
  const auto after = measured.shares(measured.of(set), 0.05).front().range;
  EXPECT_DOUBLE_EQ(after.low, before.low);
  EXPECT_DOUBLE_EQ(after.high, before.high);
  EXPECT_FALSE(measured.fails(measured.of(set), 0.05));
  EXPECT_DOUBLE_EQ(measured.proofs({measured.of({}).front()}, 0.05).front().burst, (40 + 21 * 1.6) / 22)
      << "nor do they hold for bursts that others have";
}

// Beyond 40 each run has fewer than five bursts; how runs of other sets differ is known.
TEST(Measured, BurstsOfOneSetDoNotHideHowRunsOfOthersDiffer) {
  Problem problem;
  problem.goal = {{"p99 < 1 ms", 0.01}};
  double before = 0;
  for (const double effect : {39.0, 41.0}) {
    Measured measured(problem);
    for (const double events : {10, 150, 5, 155, 10, 150}) measured.add({}, {{{events, 24'000, 30}}, {}, {}});
    const Set set = {{"realtime", "on"}};
    for (int i = 0; i < 5; ++i) measured.add(set, {{{100, 24'000, effect}}, {}, {}});
    const auto high = measured.shares(measured.of(set), 0.025).front().range.high;
    EXPECT_GE(high, before * 0.98) << effect;
    before = high;
  }
}

TEST(Evidence, LookingAfterEachRunRarelyProvesWhatIsNotSo) {
  std::mt19937_64 chance(2);
  int wrong = 0;
  constexpr int times = 2'000;
  for (int i = 0; i < times; ++i) {
    Count one, other;
    bool proven = false;
    for (int look = 0; look < 20; ++look) {
      for (auto* count : {&one, &other}) {
        count->events += std::binomial_distribution<int>(500, 0.02)(chance);
        count->messages += 500;
      }
      proven = proven || less_than(one, other) >= 20;
    }
    wrong += proven ? 1 : 0;
  }
  EXPECT_LE(wrong, times / 20);
}

TEST(Evidence, NoEventInEnoughMessagesProvesARareShare) {
  EXPECT_LT(against_at_least({0, 1'000}, 0.001), 20);
  EXPECT_GE(against_at_least({0, 5'000}, 0.001), 20);
}

TEST(Evidence, ARangeHoldsWhatWasSeenAndNarrowsWithMessages) {
  const auto few = range_of({5, 100}, 0.05), many = range_of({500, 10'000}, 0.05);
  for (const auto& range : {few, many}) {
    EXPECT_LT(range.low, 0.05);
    EXPECT_GT(range.high, 0.05);
  }
  EXPECT_LT(many.high - many.low, few.high - few.low);
  EXPECT_EQ(range_of({0, 100}, 0.05).low, 0);
  EXPECT_EQ(range_of({}, 0.05).high, 1);
}

TEST(Evidence, TheUpperLimitIsWhereItIsProven) {
  const Counts runs = {{1, 5'000}, {2, 5'000}};
  const auto limit = upper_limit(runs, 0.5, 0.05);
  EXPECT_GT(limit, 0.0003);
  EXPECT_NEAR(against_at_least(runs, limit, 0.5), 20, 0.01);
  EXPECT_LT(limit, upper_limit(runs, 0.5, 0.025));
  EXPECT_EQ(upper_limit({}, 0.5, 0.05), 1);
  // Of these the evidence against a share of 10 % is greater than that against 11 %.
  const Counts uneven = {{99, 2'000}, {103, 2'000}, {75, 2'000}, {75, 2'000}, {78, 2'000}, {85, 2'000}};
  ASSERT_GT(against_at_least(uneven, 0.1, 0.5), 80);
  ASSERT_LT(against_at_least(uneven, 0.11, 0.5), 80);
  EXPECT_LT(upper_limit(uneven, 0.5, 1.0 / 80, 0.1), 0.1);
}

// One run with few events may be a lucky one, however many messages it has; some that agree are not.
TEST(Evidence, RunsProveMoreThanTheirMessagesInOne) {
  EXPECT_LT(against_at_least(Counts{{50, 20'000}}, 0.01, 0.5), 20);
  EXPECT_GE(against_at_least(Counts(5, {10, 4'000}), 0.01, 0.5), 20);
  EXPECT_LT(against_at_most(Counts{{400, 20'000}}, 0.01, 0.5), 20);
  EXPECT_GE(against_at_most(Counts(5, {80, 4'000}), 0.01, 0.5), 20);
}

TEST(Search, TheProofIsBelowWhatTheGoalPermits) {
  for (const int seed : {1, 2, 3}) {
    Machine machine({fault("NAPI thread behind a load")}, static_cast<std::uint64_t>(seed));
    const auto outcome = found_by(machine, static_cast<std::uint64_t>(seed));
    ASSERT_EQ(outcome.end, End::goal_holds);
    ASSERT_THAT(outcome.proofs, SizeIs(2));
    for (const auto& proof : outcome.proofs) {
      EXPECT_LE(proof.below, proof.permitted * 1.000001);
      EXPECT_GT(proof.permitted, 0);
    }
  }
}

TEST(Search, OnAHealthyMachineNothingIsChanged) {
  Machine machine({}, 2);
  const auto outcome = found_by(machine, 2);
  EXPECT_EQ(outcome.end, End::goal_holds);
  EXPECT_THAT(outcome.set, IsEmpty());
  EXPECT_THAT(outcome.trials, SizeIs(1));
}

TEST(Search, OneFaultIsCuredByItsSettingAlone) {
  Machine machine({fault("NAPI thread behind a load")}, 1);
  const auto outcome = found_by(machine);
  EXPECT_EQ(outcome.end, End::goal_holds);
  EXPECT_THAT(outcome.set, ElementsAre(Pair("kernel.napi-threads", "60")));
  ASSERT_THAT(outcome.contributions, SizeIs(1));
  EXPECT_TRUE(outcome.contributions.front().is_needed);
  EXPECT_GT(outcome.contributions.front().less.front().low, 0);
}

TEST(Search, ThreeFaultsAtOnceAreAllCured) {
  Machine machine({fault("NAPI thread behind a load"), fault("CPU shared with a real-time load"),
                   fault("small receive buffer")},
                  3);
  const auto outcome = found_by(machine);
  EXPECT_EQ(outcome.end, End::goal_holds);
  EXPECT_THAT(outcome.set, ElementsAre(Pair("kernel.napi-threads", "60"), Pair("kernel.rmem-max", "4194304"),
                                       Pair("realtime.receive.cpus", "0")));
}

// Each is as bad as both: packets wait for an interrupt's thread first, and then for NAPI's.
TEST(Search, ACauseThatShowsOnlyOnceAnotherIsGoneIsRemediedBesideIt) {
  const Setting irq{"kernel.irq-threads", "60"}, napi{"kernel.napi-threads", "60"};
  const auto outcome = find(Machine::problem(1), [&](const Order& order) -> std::optional<Answer> {
    const bool irq_waits = !order.set.contains(irq.key), napi_waits = !order.set.contains(napi.key);
    EXPECT_LE(order.set.size() + irq_waits + napi_waits, 2) << "nothing else is tried";
    const double slow = irq_waits || napi_waits ? 500 : 0;
    Answer run{{{slow, 2000, 1}, {slow, 2000, 1}}, {}, ""};
    if (napi_waits) run.findings = {{"napi waited", slow, {napi}}};
    if (irq_waits && !napi_waits) run.findings = {{"irq waited", slow, {irq}}};
    return run;
  });
  EXPECT_EQ(outcome.end, End::goal_holds);
  EXPECT_THAT(outcome.set, ElementsAre(Pair(irq.key, irq.value), Pair(napi.key, napi.value)));
}

// No run has the second without the first.
TEST(Search, ASettingIsTriedAndLeftOutTogetherWithTheOneItSwitchesOn) {
  Problem problem{{{"p99 < 1 ms", 0.01}}, {{"realtime", {"on"}}, {"realtime.cpus", {"0"}, "realtime"}}};
  for (const std::string cure : {"realtime", "realtime.cpus"}) {
    const auto outcome = find(problem, [&](const Order& order) -> std::optional<Answer> {
      EXPECT_TRUE(order.set.contains("realtime") || !order.set.contains("realtime.cpus"));
      const double slow = order.set.contains(cure) ? 0 : 500;
      return Answer{{{slow, 2000, 1}}, {{"pong waited", slow, {{"realtime.cpus", "0"}}}}, ""};
    });
    EXPECT_EQ(outcome.end, End::goal_holds);
    EXPECT_THAT(outcome.set, SizeIs(cure == "realtime" ? 1 : 2));
    ASSERT_THAT(outcome.contributions, SizeIs(outcome.set.size()));
    for (const auto& one : outcome.contributions) EXPECT_TRUE(one.is_needed) << one.member.key;
  }
}

TEST(Search, ACauseWithoutANameIsFoundAmongAllSettings) {
  Machine machine({fault("interrupts that are coalesced")}, 1);
  const auto outcome = found_by(machine);
  EXPECT_EQ(outcome.end, End::goal_holds);
  EXPECT_THAT(outcome.set, ElementsAre(Pair("kernel.coalescing", "rx-usecs=0")));
}

TEST(Search, IncurableCauseRemains) {
  Machine machine({{"hypervisor", "the CPU was paused", {}, {}}}, 1);
  const auto outcome = found_by(machine);
  EXPECT_EQ(outcome.end, End::nothing_left);
  ASSERT_FALSE(outcome.remaining.empty());
  EXPECT_EQ(outcome.remaining.front().cause, "the CPU was paused");
}

TEST(Search, RemediesOfFrequentCausesAreTriedTogetherAndEachIsThenNeeded) {
  const std::vector<Setting> cures = {
      {"kernel.napi-threads", "60"}, {"kernel.rmem-max", "4194304"}, {"realtime", "on"}};
  const auto outcome = find(Machine::problem(1), [&](const Order& order) -> std::optional<Answer> {
    Answer run;
    double slow = 0;
    for (const auto& cure : cures)
      if (!order.set.contains(cure.key)) {
        slow += 100;
        run.findings.push_back({"no " + cure.key, 100, {cure}});
      }
    run.tallies = {{slow, 2000, 1}, {slow, 2000, 1}};
    return run;
  });
  EXPECT_EQ(outcome.end, End::goal_holds);
  EXPECT_EQ(outcome.trials.at(1).set.size(), cures.size());
  EXPECT_THAT(outcome.trials, SizeIs(1 + 1 + cures.size() + 1));
  ASSERT_THAT(outcome.contributions, SizeIs(cures.size()));
  for (const auto& one : outcome.contributions) EXPECT_TRUE(one.is_needed);
}

TEST(Search, AHarmfulSettingAmongAllThatAreTriedTogetherIsLeftOut) {
  const auto outcome = find(Machine::problem(1), [](const Order& order) -> std::optional<Answer> {
    double slow = order.set.contains("kernel.coalescing") ? 0 : 100;
    if (const auto irq = order.set.find("kernel.irq-threads"); irq != order.set.end()) slow += 20;
    return Answer{{{slow, 2000, 1}, {slow, 2000, 1}}, {}, ""};
  });
  EXPECT_EQ(outcome.end, End::goal_holds);
  EXPECT_THAT(outcome.set, ElementsAre(Pair("kernel.coalescing", "rx-usecs=0")));
}

TEST(Search, AGoalThatMayHoldAlreadyEndsAsNotProvenAndNothingIsTried) {
  const auto outcome = find(Machine::problem(1), [](const Order&) {
    return Answer{{{1, 2000, 20}, {0, 2000, 1}}, {}, ""};
  });
  EXPECT_EQ(outcome.end, End::not_proven);
  EXPECT_THAT(outcome.set, IsEmpty());
  EXPECT_THAT(outcome.trials, SizeIs(1));
}

// As many messages break the limit as it permits, whatever is set.
TEST(Search, AGoalWithoutAMarginIsNotReportedAsFailed) {
  int run = 0;
  const auto outcome = find(Machine::problem(1), [&](const Order&) {
    return Answer{{{++run % 2 == 0 ? 1.0 : 4.0, 2000, 3}, {0, 2000, 1}}, {}, ""};
  });
  EXPECT_EQ(outcome.end, End::not_proven);
  EXPECT_THAT(outcome.set, IsEmpty());
}

// Of an improved set no more runs of what it is compared with are needed, as long as it keeps to the goal.
TEST(Search, TheReferenceIsMeasuredThreeTimesAndThenTheSetAlone) {
  int with = 0, without = 0;
  const auto outcome = find(Machine::problem(1), [&](const Order& order) -> std::optional<Answer> {
    if (order.trial == 2) ++(order.set.empty() ? without : with);
    const double slow = order.set.empty() ? 80 : 0;
    return Answer{{{slow, 2000, 4}, {slow, 2000, 4}},
                  {{"napi waited for a CPU", slow, {{"kernel.napi-threads", "60"}}}},
                  ""};
  });
  EXPECT_EQ(outcome.end, End::goal_holds);
  EXPECT_EQ(without, 3);
  EXPECT_GT(with, without);
}

TEST(Search, ASettingThatIsNotAmongTheKnobsIsNeverTried) {
  Machine machine({fault("NAPI thread behind a load")}, 1);
  auto problem = Machine::problem(1);
  std::erase_if(problem.knobs, [](const Knob& knob) { return knob.key == "kernel.napi-threads"; });
  const auto outcome = find(problem, [&](const Order& order) -> std::optional<Answer> {
    EXPECT_FALSE(order.set.contains("kernel.napi-threads"));
    return machine.run(order.set);
  });
  EXPECT_EQ(outcome.end, End::nothing_left);
}

TEST(Search, ASetThatIsRefusedIsLeftAndNotTriedAgain) {
  Machine machine({fault("CPU shared with a real-time load")}, 1);
  int refused = 0;
  const auto outcome = find(Machine::problem(1), [&](const Order& order) -> std::optional<Answer> {
    if (order.set.contains("realtime.receive.priority")) {
      ++refused;
      return Answer{{}, {}, "no such priority here"};
    }
    return machine.run(order.set);
  });
  EXPECT_EQ(outcome.end, End::goal_holds);
  EXPECT_LE(refused, 2);
  EXPECT_THAT(outcome.set, ElementsAre(Pair("realtime.receive.cpus", "0")));
}

TEST(Search, OthersAreTriedWithoutTheOneSettingThatIsRefused) {
  Machine machine({fault("interrupts that are coalesced")}, 1);  // no cause names it: all are tried at once
  int refused = 0;
  const auto outcome = find(Machine::problem(1), [&](const Order& order) -> std::optional<Answer> {
    if (order.set.contains("kernel.irq-threads")) {
      ++refused;
      return Answer{{}, {}, "no such threads", false, "kernel.irq-threads"};
    }
    return machine.run(order.set);
  });
  EXPECT_EQ(refused, 1);
  EXPECT_EQ(outcome.end, End::goal_holds);
  EXPECT_THAT(outcome.set, ElementsAre(Pair("kernel.coalescing", "rx-usecs=0")));
}

TEST(Search, ASetWhoseRunsFailedForAReasonThatPassesIsStillKept) {
  Machine machine({fault("NAPI thread behind a load")}, 1);
  int failed = 0;
  const auto outcome = find(Machine::problem(1), [&](const Order& order) -> std::optional<Answer> {
    if (order.set.contains("kernel.napi-threads") && failed < 2)
      return ++failed, Answer{{}, {}, "no answer", true};
    return machine.run(order.set);
  });
  EXPECT_EQ(failed, 2);
  EXPECT_EQ(outcome.end, End::goal_holds);
  EXPECT_THAT(outcome.set, ElementsAre(Pair("kernel.napi-threads", "60")));
  for (const auto& trial : outcome.trials) EXPECT_NE(trial.why, "no answer") << "it was not refused";
}

TEST(Search, ATrialWithoutAMeasuredRunHasNoShares) {
  const Setting napi{"kernel.napi-threads", "60"};
  const auto outcome = find(Machine::problem(1), [&](const Order& order) -> std::optional<Answer> {
    constexpr int confirmation = 3;  // after the start, and the set
    if (order.trial >= confirmation && !order.set.empty()) return Answer{{}, {}, "no answer"};
    const double slow = order.set.empty() ? 500 : 0;
    return Answer{{{slow, 2000, 1}, {slow, 2000, 1}}, {{"napi waited", slow, {napi}}}, ""};
  });
  EXPECT_THAT(outcome.set, ElementsAre(Pair(napi.key, napi.value)));
  ASSERT_GE(outcome.trials.size(), 3U);
  EXPECT_EQ(outcome.trials[2].purpose, Trial::Purpose::confirm);
  EXPECT_EQ(outcome.trials[2].decision, Decision::refused);
  EXPECT_EQ(outcome.trials[2].why, "no answer");
  EXPECT_THAT(outcome.trials[2].shares, IsEmpty());
  EXPECT_THAT(outcome.trials[1].shares, SizeIs(2));
}

TEST(Search, ACauseSaysThatItCountsTheMessagesLookedAt) {
  EXPECT_THAT(text_of(Finding{"napi waited", 31, {}}),
              testing::AllOf(testing::StartsWith("31 of"), testing::EndsWith("messages: napi waited")));
}

TEST(Search, AStartThatCannotBeMeasuredEndsItWithTheReason) {
  const auto outcome = find(Machine::problem(1), [](const Order&) { return Answer{{}, {}, "no route"}; });
  EXPECT_EQ(outcome.end, End::cannot_measure);
  EXPECT_EQ(outcome.why, "no route");
}

// As a file of results holds them.
Outcome resumed(std::vector<Answer>& answers, const std::function<Answer(const Order&)>& fresh) {
  for (auto& answer : answers) answer.is_recalled = true;
  return find(Machine::problem(1), [&](const Order& order) -> std::optional<Answer> {
    const auto index = static_cast<std::size_t>(order.number) - 1;
    if (index == answers.size()) answers.push_back(fresh(order));
    return answers[index];
  });
}

TEST(Search, AFailedRunOfAMeasuredSetIsMadeAgain) {
  Machine machine({fault("NAPI thread behind a load")}, 1);
  int failed = 0;
  const auto outcome = find(Machine::problem(1), [&](const Order& order) -> std::optional<Answer> {
    if (order.number % 5 == 0) return ++failed, Answer{{}, {}, "no answer", true};
    return machine.run(order.set);
  });
  EXPECT_GT(failed, 2);
  EXPECT_EQ(outcome.end, End::goal_holds);
  EXPECT_THAT(outcome.set, ElementsAre(Pair("kernel.napi-threads", "60")));
}

TEST(Search, ThreeFailedRunsOfTheReferenceEndItUntilItIsResumed) {
  Machine machine({fault("NAPI thread behind a load")}, 1);
  std::vector<Answer> answers;
  const auto broken = [](const Order&) { return Answer{{}, {}, "no answer", true}; };
  const auto ended = resumed(answers, [&](const Order& order) {
    return order.number > 1 && order.set.empty() ? broken(order) : machine.run(order.set);
  });
  EXPECT_EQ(ended.end, End::cannot_measure);
  EXPECT_EQ(ended.why, "no answer");
  const auto runs = answers.size();
  EXPECT_EQ(resumed(answers, broken).end, End::cannot_measure);
  EXPECT_EQ(answers.size(), runs + 3);
  const auto outcome = resumed(answers, [&](const Order& order) { return machine.run(order.set); });
  EXPECT_EQ(outcome.end, End::goal_holds);
  EXPECT_THAT(outcome.set, ElementsAre(Pair("kernel.napi-threads", "60")));
  EXPECT_EQ(resumed(answers, broken).runs, outcome.runs) << "the same again, without another run";
}

// With pacing next-free a run whose answers are late sends fewer messages. The goal permits less than one
// burst in a run of the set that it is proven for, not in a run of the start.
TEST(Search, AShorterStartDoesNotPermitABurstInEachRunOfTheSet) {
  int proven = 0;
  constexpr int times = 400;
  for (std::uint64_t seed = 1; seed <= times; ++seed) {
    std::mt19937_64 chance(seed);
    const Problem problem{{{"late = 0", 0}}, {{"realtime", {"on"}}}, 0.05, seed};
    const auto outcome = find(problem, [&](const Order& order) -> std::optional<Answer> {
      const double sent = order.set.empty() ? 500 : 2000, bursts = order.set.empty() ? 150 : 1;
      const double late = std::poisson_distribution<int>(bursts)(chance);
      return Answer{{{late, sent, 1}}, {{"pong waited", late, {{"realtime", "on"}}}}, ""};
    });
    proven += outcome.end == End::goal_holds ? 1 : 0;
  }
  EXPECT_LE(proven, times / 20);
}

TEST(Search, TheStartHoldsByAQuarterOfAlphaAlone) {
  const auto alpha = Machine::problem(1).alpha;
  int runs = 0;
  Problem problem{{{"p99 < 1 ms", 0.01}}, {}};
  const auto most = most_variation(problem.goal.front());
  const auto outcome = find(problem, [&](const Order&) { return ++runs, Answer{{{0, 100, 1}}, {}, ""}; });
  ASSERT_EQ(outcome.end, End::goal_holds);
  const auto seen = [](int count) { return Counts(static_cast<std::size_t>(count), {0, 100}); };
  EXPECT_GE(against_at_least(seen(runs), 0.01, most), 4 / alpha);
  EXPECT_LT(against_at_least(seen(runs - 1), 0.01, most), 4 / alpha);
  ASSERT_THAT(outcome.proofs, SizeIs(1));
  EXPECT_EQ(outcome.proofs.front().permitted, 0.01);
  EXPECT_LE(outcome.proofs.front().below, 0.01);
  EXPECT_GE(outcome.proofs.front().below, upper_limit(seen(runs), most, alpha / 4));
}

TEST(Search, TheAnnouncedMessagesAreThoseOfAProof) {
  for (const double share : {0.0, 0.001, 0.01, 0.1})
    for (const double of_run : {500.0, 5'000.0}) {
      const Problem problem{{{"", share}}, {}};
      const auto outcome = find(problem, [&](const Order&) { return Answer{{{0, of_run, 1}}, {}, ""}; });
      const auto announced = std::ceil(messages_to_prove(problem.goal.front(), of_run) / of_run);
      EXPECT_EQ(outcome.end, End::goal_holds);
      EXPECT_GE(announced, outcome.runs);
      EXPECT_LE(announced, outcome.runs + 1) << share << ' ' << of_run;
    }
}

TEST(Search, WithoutTimeItEndsWithTheBestSetSoFar) {
  Machine machine({fault("NAPI thread behind a load"), fault("small receive buffer")}, 1);
  const auto outcome = found_by(machine, 1, 8);
  EXPECT_EQ(outcome.end, End::no_time);
  EXPECT_FALSE(outcome.remaining.empty());
}

TEST(Search, TheSameAnswersLeadToTheSameSearch) {
  std::vector<Answer> answers;
  Machine machine({fault("ksoftirqd behind a load"), fault("small receive buffer")}, 4);
  const auto whole = find(Machine::problem(4), [&](const Order& order) -> std::optional<Answer> {
    answers.push_back(machine.run(order.set));
    return answers.back();
  });
  const auto again = find(Machine::problem(4), [&](const Order& order) -> std::optional<Answer> {
    return answers.at(static_cast<std::size_t>(order.number) - 1);
  });
  EXPECT_EQ(again.set, whole.set);
  EXPECT_EQ(again.runs, whole.runs);
  EXPECT_EQ(again.trials.size(), whole.trials.size());
}

}  // namespace
}  // namespace ontime::search

// SPDX-License-Identifier: Apache-2.0
// A machine that is simulated, for the search: twelve settings, planted faults, and runs whose numbers of
// slow and late messages vary as those of real ones do: in bursts, from run to run, and with causes that are
// sometimes named wrongly. The shares are made up; they show how the search behaves, and no machine.
#pragma once

#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "search/search.hpp"

namespace ontime::search {

struct Fault {
  std::string name;
  std::string cause;               // as explain names it; "": it names none
  std::vector<Setting> remedies;   // as explain proposes them; the first need not be the one that helps
  std::vector<Setting> cures;      // any one of them
  double slow = 0.02, late = 0.2;  // of all messages; of the slow ones
};

inline const std::vector<Knob>& twelve_knobs() {
  static const std::vector<Knob> knobs = {{"realtime", {"on"}},
                                          {"realtime.receive.priority", {"85"}},
                                          {"realtime.receive.cpus", {"0", "1"}},
                                          {"realtime.lock-memory", {"on"}},
                                          {"realtime.cpu-latency", {"0 us"}},
                                          {"kernel.rt-throttling", {"off"}},
                                          {"kernel.irq-cpus", {"0", "1"}},
                                          {"kernel.irq-threads", {"90", "60"}},
                                          {"kernel.ksoftirqd", {"60", "90"}},
                                          {"kernel.napi-threads", {"60", "90"}},
                                          {"kernel.rmem-max", {"4194304"}},
                                          {"kernel.coalescing", {"rx-usecs=0"}}};
  return knobs;
}

inline const std::vector<Fault>& ten_faults() {
  static const std::vector<Fault> faults = {
      {"NAPI thread behind a load",
       "napi waited for a CPU",
       {{"kernel.napi-threads", "60"}},
       {{"kernel.napi-threads", "60"}, {"kernel.napi-threads", "90"}},
       0.04},
      {"application behind a load",
       "pong waited for a CPU",
       {{"realtime", "on"}},
       {{"realtime", "on"}},
       0.08},
      {"CPU shared with a real-time load",
       "pong waited for a CPU while a more urgent thread ran",
       {{"realtime.receive.priority", "85"}, {"realtime.receive.cpus", "0"}},
       {{"realtime.receive.cpus", "0"}},
       0.03},
      {"small receive buffer",
       "the packet was dropped (SOCKET_RCVBUFF)",
       {{"kernel.rmem-max", "4194304"}},
       {{"kernel.rmem-max", "4194304"}},
       0.01,
       1},
      {"interrupts on the receiver's CPU",
       "interrupts took the CPU",
       {{"kernel.irq-cpus", "1"}, {"kernel.irq-cpus", "0"}},
       {{"kernel.irq-cpus", "0"}},
       0.02,
       0.05},
      {"memory that is not locked",
       "pong waited for pages of its memory",
       {{"realtime.lock-memory", "on"}},
       {{"realtime.lock-memory", "on"}},
       0.006,
       0.5},
      {"real-time throttling",
       "the scheduler did not let pong run",
       {{"kernel.rt-throttling", "off"}},
       {{"kernel.rt-throttling", "off"}},
       0.05,
       0.9},
      {"deep idle states",
       "no event shows that the CPU ran",
       {{"realtime.cpu-latency", "0 us"}},
       {{"realtime.cpu-latency", "0 us"}},
       0.01,
       0.02},
      {"ksoftirqd behind a load",
       "ksoftirqd waited for a CPU",
       {{"kernel.ksoftirqd", "60"}},
       {{"kernel.ksoftirqd", "60"}, {"kernel.ksoftirqd", "90"}},
       0.03},
      {"interrupts that are coalesced", "", {}, {{"kernel.coalescing", "rx-usecs=0"}}, 0.03, 0.1}};
  return faults;
}

class Machine {
 public:
  static constexpr double messages = 2000, healthy_slow = 0.0001, burst = 2;

  // `least_slow`: of all messages, whatever is set.
  Machine(std::vector<Fault> faults, std::uint64_t seed, double least_slow = healthy_slow)
      : faults_(std::move(faults)), least_slow_(least_slow), chance_(seed) {
    // No two machines have a fault to the same degree.
    for (auto& fault : faults_) fault.slow *= std::exp(0.4 * normal_(chance_));
  }

  static Problem problem(std::uint64_t seed) {
    return {{{"p99.9 < 1 ms", 0.001}, {"late = 0", 0}}, twelve_knobs(), 0.05, seed};
  }

  // Of all messages: slow, and late, which are slow as well.
  struct Shares {
    double slow = 0, late = 0;
    bool meets_goal() const { return slow <= 0.001 && late * messages < 0.05; }
  };
  Shares shares(const Set& set) const {
    Shares all{least_slow_, 0};
    for (const auto& fault : faults_) {
      if (is_cured(fault, set)) continue;
      // Who is real-time already suffers a little less of whatever load there is.
      const double slow = fault.slow * (set.contains("realtime") ? 0.9 : 1);
      all.slow += slow;
      all.late += slow * fault.late;
    }
    // Priorities above the application's let other packets delay it.
    for (const auto* key : {"kernel.irq-threads", "kernel.ksoftirqd"})
      if (const auto found = set.find(key); found != set.end() && found->second == "90") {
        all.slow += 0.004;
        all.late += 0.0004;
      }
    return all;
  }

  Answer run(const Set& set) {
    ++runs;
    Answer run;
    const auto of = shares(set);
    const double degree = std::exp(0.4 * normal_(chance_));  // of this run
    const auto late = events(of.late * degree), slow = late + events((of.slow - of.late) * degree);
    const double effect = (2 * burst - 1) * std::exp(0.2 * normal_(chance_));
    run.tallies = {{slow, messages, effect}, {late, messages, effect}};
    const auto add = [&](const Fault& fault, double count) {
      if (count > 0 && !fault.cause.empty()) run.findings.push_back({fault.cause, count, fault.remedies});
    };
    for (const auto& fault : faults_)
      if (!is_cured(fault, set)) add(fault, std::round(0.85 * slow * fault.slow / of.slow));
    add(ten_faults()[chance_() % ten_faults().size()], std::round(0.1 * slow));  // accused wrongly
    return run;
  }

  int runs = 0;

 private:
  static bool is_cured(const Fault& fault, const Set& set) {
    return std::any_of(fault.cures.begin(), fault.cures.end(), [&](const Setting& cure) {
      const auto found = set.find(cure.key);
      return found != set.end() && found->second == cure.value;
    });
  }

  double events(double share) {
    const auto bursts = std::poisson_distribution<int>(std::max(share, 0.0) * messages / burst)(chance_);
    double sum = 0;
    for (int i = 0; i < bursts; ++i) sum += 1 + std::geometric_distribution<int>(1 / burst)(chance_);
    return std::min(sum, messages);
  }

  std::vector<Fault> faults_;
  double least_slow_;
  std::mt19937_64 chance_;
  std::normal_distribution<double> normal_;
};

}  // namespace ontime::search

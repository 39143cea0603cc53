// SPDX-License-Identifier: Apache-2.0
// All runs of a search, set by set, and what they prove. Ordinary thread.
#pragma once

#include <map>
#include <memory>
#include <vector>

#include "search/evidence.hpp"
#include "search/search.hpp"

namespace ontime::search {

using Runs = std::vector<const Answer*>;

// The relative variance of the share between runs that "holds" and "fails" allow for. Its proofs take a gamma
// distribution, and are right for a log-normal one of twice this variance, too: scripts/search-proof. A limit
// that permits nothing is about one burst per run, where the spread makes less difference.
double most_variation(const Limit&);

// Runs are of one set each, which was measured: each has a tally for every limit of the goal.
class Measured {
 public:
  explicit Measured(const Problem& problem) : problem_(problem) {}

  const Answer* add(const Set&, Answer run);
  Runs of(const Set&) const;
  std::size_t limits() const { return problem_.goal.size(); }

  // Each statement is wrong with probability `alpha` at most. The goal holds; it fails; fewer messages of one
  // break a limit than of the other. A limit that permits nothing holds with fewer than one burst in the
  // longest run.
  bool holds(const Runs&, double alpha) const;
  bool fails(const Runs&, double alpha) const;
  bool fewer(const Runs& one, const Runs& other, double alpha) const;
  std::vector<Share> shares(const Runs&, double alpha) const;
  std::vector<Proof> proofs(const Runs&, double alpha) const;  // of runs by which the goal holds

  // By measured shares, without proof.
  bool kept_to(const Runs&) const;  // no more messages broke a limit than the goal permits
  bool looks_no_less(const Runs& one, const Runs& other) const;

 private:
  template <class Holds>
  bool all_limits(Holds) const;
  template <class Of>
  double mean(Of) const;

  // Variation of the messages that break a limit: within runs, as a multiple of independent messages; between
  // runs of one set, the relative variance of the share. Estimated from all sets; within runs it is at least
  // that of these runs alone.
  struct Spread {
    double within = 1, between = 0;
  };
  Spread spread(std::size_t limit, const Runs&) const;
  double permitted(const Runs&, std::size_t limit) const;
  Counts independent(const Runs&, std::size_t limit) const;
  static Count effective(const Count&, const Spread&, double of_a_run);

  const Problem& problem_;
  std::map<Set, std::vector<std::unique_ptr<Answer>>> runs_;
  double per_run_ = 0;  // most messages of a run: with pacing next-free, late answers make it send fewer
};

}  // namespace ontime::search

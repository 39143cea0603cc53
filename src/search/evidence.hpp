// SPDX-License-Identifier: Apache-2.0
// Evidence on a share of messages that stays valid however often it is looked at: e-values. Under its null
// hypothesis an e-value exceeds 1/α at any time with probability α at most (Ville 1939), so a search may stop
// as soon as one does. Each is a mixture of likelihood ratios against a fixed grid of alternatives (Robbins
// 1970; Ramdas, Grünwald, Vovk & Shafer 2023, "Game-theoretic statistics and safe anytime-valid inference").
//
// Messages of one burst are not independent: counts are divided by their design effect before they come here,
// which makes the guarantee approximate, as the negative binomial distribution of runs does:
// scripts/search-proof shows the error rate that remains.
#pragma once

#include <vector>

namespace ontime::search {

// Effective numbers of messages, and of those that are late, lost or slow; not always whole.
struct Count {
  double events = 0, messages = 0;
};

// Evidence against "the share is `share` or more" and against "the share is `share` or less"; 0 < share < 1.
double against_at_least(const Count&, double share);
double against_at_most(const Count&, double share);

// The same where the share differs from run to run, so that many messages of one run prove little: the runs
// are independent and of one set, and the relative variance of their shares is `most_variation` at most.
using Counts = std::vector<Count>;
double against_at_least(const Counts& runs, double share, double most_variation);
double against_at_most(const Counts& runs, double share, double most_variation);

// Evidence against "the first has as great a share as the second, or a greater one". Of all events that
// either has, it asks how few are the first's (Przyborowski & Wilenski 1940): exact for rare events, cautious
// for others.
double less_than(const Count& first, const Count& second);

// Contains the true share with probability 1 − alpha, at all times at once.
struct Range {
  double low = 0, high = 1;
};
Range range_of(const Count&, double alpha);

// One-sided: the least share that against_at_least() of runs excludes with so much evidence; 1: none. Where
// `asked` is excluded, it is below that.
double upper_limit(const Counts& runs, double most_variation, double alpha, double asked = 1);

}  // namespace ontime::search

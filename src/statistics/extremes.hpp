// SPDX-License-Identifier: Apache-2.0
// Extrapolated worst case: the level that 1 in N answers exceeds, by two methods of extreme-value theory,
// each with tests of its assumptions. Ordinary thread.
//
// How far: a run of n answers whose slowest come singly reaches the level that 4 in n exceed, and never
// beyond 1 in a million. A cause that strikes more seldom may not have struck in the run, and no theory sees
// it. The interval also holds what the order of the answers alone tells (Clopper & Pearson), whatever their
// tail is.
//
// Block maxima: the run in 100 stretches, and the greatest of each; a generalised extreme-value distribution.
// Peaks over a threshold: what is above the threshold that 500 values pass, or a tenth of fewer, declustered;
// a generalised Pareto distribution. Their parameters by L-moments (Hosking 1985; Hosking & Wallis 1987), the
// intervals by a parametric bootstrap of 400, seeded alike each time, of which the middle 98 % are taken: the
// middle 95 % hold the truth too seldom. The same bootstrap gives the p-value of the fit: Anderson &
// Darling's statistic, of samples fitted anew. How extremes cluster: the extremal index by the intervals
// between them, which also declusters (Ferro & Segers 2003).
//
// Tests: the stretches' maxima have no trend (Mann 1945, Kendall) and do not cluster (runs about the median:
// Wald & Wolfowitz 1940); both halves have as many peaks (binomial); each at 1 %. The fit: at 5 %. A failed
// test refuses the bound.
//
// Not valid for causes that were not at work in the run, such as a nightly backup.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "statistics/confidence.hpp"

namespace ontime::statistics {

// 1 + shape × (x − location) / scale is what counts: shape below 0 has an upper end, above 0 a heavy tail.
struct Tail {
  enum class Family { maxima, peaks } family;  // generalised extreme-value, generalised Pareto
  double location = 0, scale = 1, shape = 0;   // of peaks the location is the threshold
  double below(double x) const;                // how probable
  double quantile(double probability) const;
};
// By L-moments; of peaks those above `threshold`. Nothing: they are too few, or all alike.
std::optional<Tail> fit_maxima(std::vector<double> maxima);
std::optional<Tail> fit_peaks(std::vector<double> peaks, double threshold);

// The level that Extremes::exceedance of the answers exceed.
struct Bound {
  Tail tail;
  Interval shape_lies;  // with 95 %, as level_lies
  double level = 0;
  Interval level_lies;
  double fit_p = 0;       // of the fit; small: they do not follow it
  std::size_t count = 0;  // maxima, or peaks
  std::string refused;    // why these data do not allow a bound, for users; the values above are then
                          // invalid. Empty: the bound is valid
};

struct Extremes {
  std::optional<Bound> maxima, peaks;  // nothing: too few values, see `refused`
  double exceedance = 1;               // of the level
  double answers_for_a_million = 0;    // so many it takes for the level that 1 in a million exceeds
  double index = 1;                    // extremal: 1 / how many follow upon one another
  double trend_p = 1, runs_p = 1;      // of the stretches' maxima: the tests below
  double halves_p = 1;                 // of how many peaks lie in either half
  std::string refused;                 // why there is neither
};
// Of values in the order in which they came, and the threshold that `most_peaks` of them, or a tenth of
// fewer, pass.
inline constexpr std::size_t most_peaks = 500;
Extremes extremes(std::span<const float> values, float threshold);

// p-values.
double trend_p(std::span<const double>);  // two-sided, ties counted (Mann & Kendall)
double runs_p(std::span<const double>);   // too few runs: one-sided (Wald & Wolfowitz)
// Of the places of the values above a threshold.
double extremal_index(std::span<const std::size_t> places);

}  // namespace ontime::statistics

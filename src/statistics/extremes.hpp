// SPDX-License-Identifier: Apache-2.0
// Extrapolated worst case: the level that 1 in N answers exceeds, by two methods of extreme-value theory,
// each with tests of its assumptions. Ordinary thread.
//
// How far: a run of n answers with unclustered slow ones reaches the level that 4 in n exceed, and never
// beyond the 10⁻⁶ exceedance level. A rarer cause may not have occurred in the run, and no theory can find
// it. The interval also contains the one from ranks alone (Clopper & Pearson), which assumes no tail.
//
// Block maxima: the run in 100 stretches, and the greatest of each; a generalised extreme-value distribution.
// Peaks over a threshold: what is above the threshold that 500 values pass, or a tenth of fewer, declustered;
// a generalised Pareto distribution. Their parameters by L-moments (Hosking 1985; Hosking & Wallis 1987), the
// intervals by a parametric bootstrap of 400 with a fixed seed. The middle 98 % are taken, because the middle
// 95 % contain the truth too rarely. The same bootstrap gives the p-value of the fit: Anderson &
// Darling's statistic, of samples fitted anew. How extremes cluster: the extremal index by the intervals
// between them, which also declusters (Ferro & Segers 2003).
//
// Tests: the stretches' maxima have no trend (Mann 1945, Kendall) and do not cluster (runs about the median:
// Wald & Wolfowitz 1940); both halves have as many peaks (binomial); each at 1 %. The fit: at 5 %. A failed
// test refuses the bound. So do fewer than ten effective values (confidence.hpp) above the threshold, or
// above the level that a fifth of them pass: rarer levels may cluster more than the extremal index says.
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
  double below(double x) const;                // probability of a value below x
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
  double answers_for_a_million = 0;    // answers needed for the 10⁻⁶ exceedance level
  double index = 1;                    // extremal: 1 / mean size of a cluster
  double trend_p = 1, runs_p = 1;      // of the stretches' maxima: the tests below
  double halves_p = 1;                 // of the number of peaks in each half
  std::string refused;                 // why there is neither
};
// Of values in the order in which they came, and the threshold that `most_peaks` of them, or a tenth of
// fewer, pass.
inline constexpr std::size_t most_peaks = 500;
Extremes extremes(std::span<const float> values, float threshold);

// Rounded down: 0.0499 is refused as below 0.05, and must not read as 0.05.
std::string p_text(double p);
// p-values.
double trend_p(std::span<const double>);  // two-sided, ties counted (Mann & Kendall)
double runs_p(std::span<const double>);   // too few runs: one-sided (Wald & Wolfowitz)
// Of the places of the values above a threshold.
double extremal_index(std::span<const std::size_t> places);

}  // namespace ontime::statistics

// SPDX-License-Identifier: Apache-2.0
#include "statistics/course.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

namespace ontime::statistics {

void Course::add(std::int64_t value) { values_.push_back(static_cast<float>(value)); }

void Course::add_series(std::int64_t least, std::int64_t step, std::uint64_t count) {
  const auto series = Values::Series::of(least, step, count);
  if (count >= Values::short_series) {
    series_.push_back({values_.size(), series});
    return;
  }
  for (std::uint64_t i = 0; i < count; ++i) add(series.least + static_cast<std::int64_t>(i) * series.step);
}

std::size_t Course::batches() const { return std::clamp<std::size_t>(values_.size(), 1, most_batches); }

template <class Use, class UseSeries>
void Course::each(Use use, UseSeries use_series) const {
  const auto first_of = [&](std::size_t batch) { return batch * values_.size() / batches(); };
  for (std::size_t batch = 0; batch < batches(); ++batch)
    use(batch, values().subspan(first_of(batch), first_of(batch + 1) - first_of(batch)));
  std::size_t batch = 0;
  for (const auto& series : series_) {
    while (batch + 1 < batches() && first_of(batch + 1) <= series.place) ++batch;
    use_series(batch, series.values);
  }
}

std::vector<std::vector<Batch>> Course::above(std::span<const std::int64_t> thresholds) const {
  std::vector<std::vector<Batch>> all(thresholds.size(), std::vector<Batch>(batches()));
  each(
      [&](std::size_t batch, std::span<const float> values) {
        for (std::size_t i = 0; i < thresholds.size(); ++i) {
          const auto threshold = static_cast<float>(thresholds[i]);
          const auto events =
              std::count_if(values.begin(), values.end(), [&](float value) { return value > threshold; });
          all[i][batch].values += static_cast<double>(values.size());
          all[i][batch].events += static_cast<double>(events);
        }
      },
      [&](std::size_t batch, const Values::Series& series) {
        for (std::size_t i = 0; i < thresholds.size(); ++i) {
          all[i][batch].values += static_cast<double>(series.count);
          all[i][batch].events += static_cast<double>(series.count - series.at_most(thresholds[i]));
        }
      });
  return all;
}

std::vector<Batch> Course::sums() const {
  std::vector<Batch> all(batches());
  each(
      [&](std::size_t batch, std::span<const float> values) {
        all[batch].values += static_cast<double>(values.size());
        all[batch].events += std::accumulate(values.begin(), values.end(), 0.0);
      },
      [&](std::size_t batch, const Values::Series& series) {
        all[batch].values += static_cast<double>(series.count);
        all[batch].events += series.sum();
      });
  return all;
}

Certainty certainty(const Course& course, Ranks& ranks, const Distribution& of) {
  struct Quantile {
    double share;
    std::int64_t value;
    Measured Certainty::*place;
  };
  const std::array quantiles = {
      Quantile{0.5, of.p50, &Certainty::p50}, Quantile{0.9, of.p90, &Certainty::p90},
      Quantile{0.99, of.p99, &Certainty::p99}, Quantile{0.999, of.p99_9, &Certainty::p99_9},
      Quantile{0.9999, of.p99_99, &Certainty::p99_99}};
  std::array<std::int64_t, quantiles.size()> thresholds{};
  for (std::size_t i = 0; i < quantiles.size(); ++i) thresholds[i] = quantiles[i].value;
  const auto above = course.above(thresholds);

  Certainty result;
  result.mean = mean(course.sums(), of.mean);
  const auto n = static_cast<double>(of.count);
  const auto value_at = [&](std::optional<double> share, bool upper) -> std::optional<double> {
    if (!share) return {};
    const auto rank = upper ? std::ceil(*share * n) : std::floor(*share * n);
    return static_cast<double>(ranks.at_rank(static_cast<std::uint64_t>(std::clamp(rank, 1.0, n))));
  };
  double before = 1;
  for (std::size_t i = 0; i < quantiles.size(); ++i) {
    const auto& [share, value, place] = quantiles[i];
    auto& measured = result.*place;
    measured.value = static_cast<double>(value);
    measured.effect = before = tail_effect(above[i], before);
    for (const auto& [confidence, interval] : {std::pair{0.95, &measured.sure}, {0.98, &measured.surer}}) {
      const auto shares = quantile_shares(share, n / measured.effect, confidence);
      *interval = {value_at(shares.low, false), value_at(shares.high, true)};
    }
  }
  result.slowest_effect = slowest_effect(std::array{above[3], above[2], above[1]});  // p99.9, p99, p90
  return result;
}

}  // namespace ontime::statistics

// SPDX-License-Identifier: Apache-2.0
#include "statistics/values.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

namespace ontime::statistics {
namespace {

constexpr std::size_t page_size = std::size_t{1} << 16;
constexpr std::size_t list_max = 2 * page_size;  // as many bytes as the counts take

// Bins of a histogram: 16 to every doubling, all of the same ratio, so that on a logarithmic axis none is
// wider than another and counts do not jump where the width would. Where they are narrower than 1 ns some are
// empty.
constexpr std::size_t bins_a_doubling = 16;
std::uint64_t first_of_bin(std::size_t bin) {
  if (bin == 0) return 0;
  const auto doublings = static_cast<long double>(bin) / bins_a_doubling;
  return static_cast<std::uint64_t>(std::ceil(std::exp2(doublings)));
}
std::size_t bin_of(std::uint64_t value) {
  if (value < 2) return 0;
  auto bin = static_cast<std::size_t>(std::log2(static_cast<long double>(value)) * bins_a_doubling);
  while (first_of_bin(bin) > value) --bin;
  while (first_of_bin(bin + 1) <= value) ++bin;
  return bin;
}

}  // namespace

void Values::add(std::int64_t value) {
  min_ = count_ == 0 ? value : std::min(min_, value);
  max_ = count_ == 0 ? value : std::max(max_, value);
  ++count_;
  if (__builtin_add_overflow(sum_, value, &sum_)) {
    // It wrapped round: the other way lies what it was before.
    large_sum_ += static_cast<long double>(between(value, sum_)) + static_cast<long double>(value);
    sum_ = 0;
  }
  place(value);
}

void Values::place(std::int64_t value) {
  if (value < 0 || value > std::numeric_limits<std::uint32_t>::max()) return wide_.push_back(value);
  const auto high = static_cast<std::size_t>(value >> 16);
  auto& block = blocks_[high / pages_a_block];
  if (!block) block = std::make_unique<Block>();
  auto& page = (*block)[high % pages_a_block];
  const auto low = static_cast<std::uint16_t>(value);
  if (page.counts) {
    ++page.counts[low];
    return;
  }
  page.low.push_back(low);
  if (page.low.size() < list_max) return;
  page.counts = std::make_unique<std::uint32_t[]>(page_size);
  for (const auto each : page.low) ++page.counts[each];
  page.low = {};
}

Series Series::of(std::int64_t least, std::int64_t step, std::uint64_t count) {
  std::int64_t reach = 0, greatest = 0;
  const bool beyond = step < 0 || __builtin_mul_overflow(step, count - 1, &reach) ||
                      __builtin_add_overflow(least, reach, &greatest);
  return {least, beyond ? 0 : step, count};
}

std::int64_t Series::greatest() const { return least + static_cast<std::int64_t>(count - 1) * step; }

double Series::sum() const {
  return static_cast<double>(count) * (static_cast<double>(least) + static_cast<double>(greatest())) / 2;
}

void Values::add_series(const Series& series) {
  if (series.count < short_series) {
    for (std::uint64_t i = 0; i < series.count; ++i)
      add(series.least + static_cast<std::int64_t>(i) * series.step);
    return;
  }
  min_ = count_ == 0 ? series.least : std::min(min_, series.least);
  max_ = count_ == 0 ? series.greatest() : std::max(max_, series.greatest());
  count_ += series.count;
  large_sum_ += static_cast<long double>(series.sum());
  series_.push_back(series);
}

std::uint64_t Series::at_most(std::int64_t value) const {
  if (value < least) return 0;
  if (step == 0) return count;
  const auto distance = static_cast<std::uint64_t>(value) - static_cast<std::uint64_t>(least);
  return std::min(count, distance / static_cast<std::uint64_t>(step) + 1);
}

Ranks::Ranks(Values values) : values_(std::move(values)) {
  std::sort(values_.wide_.begin(), values_.wide_.end());
  std::uint64_t before = 0;
  for (std::size_t block = 0; block < values_.blocks_.size(); ++block) {
    if (!values_.blocks_[block]) continue;
    for (std::size_t i = 0; i < Values::pages_a_block; ++i) {
      auto& page = (*values_.blocks_[block])[i];
      const auto size =
          page.counts ? std::accumulate(page.counts.get(), page.counts.get() + page_size, std::uint64_t{0})
                      : page.low.size();
      if (size == 0) continue;
      pages_.push_back({static_cast<std::uint32_t>(block * Values::pages_a_block + i), &page, before, size});
      before += size;
    }
  }
}

std::uint64_t Ranks::narrow_at_most(std::int64_t value) {
  if (value < 0 || pages_.empty()) return 0;
  const auto narrow =
      std::min<std::uint64_t>(static_cast<std::uint64_t>(value), std::numeric_limits<std::uint32_t>::max());
  const auto high = static_cast<std::uint32_t>(narrow >> 16);
  const auto next = std::upper_bound(pages_.begin(), pages_.end(), high,
                                     [](std::uint32_t h, const Filled& page) { return h < page.high; });
  if (next == pages_.begin()) return 0;
  auto& found = *std::prev(next);
  if (found.high != high) return found.before + found.size;
  auto& [low, counts] = *found.page;
  if (!found.in_order) {
    found.in_order = true;
    // Counts become of how many are no greater.
    for (std::size_t i = 1; counts && i < page_size; ++i) counts[i] += counts[i - 1];
    std::sort(low.begin(), low.end());
  }
  const auto most = static_cast<std::uint16_t>(narrow);
  const auto within = counts ? counts[most] : std::upper_bound(low.begin(), low.end(), most) - low.begin();
  return found.before + static_cast<std::uint64_t>(within);
}

std::uint64_t Ranks::at_most(std::int64_t value) {
  const auto& wide = values_.wide_;
  auto count = narrow_at_most(value) +
               static_cast<std::uint64_t>(std::upper_bound(wide.begin(), wide.end(), value) - wide.begin());
  for (const auto& series : values_.series_) count += series.at_most(value);
  return count;
}

std::int64_t Ranks::at_rank(std::uint64_t rank) {
  auto low = values_.min_, high = values_.max_;  // low <= the value <= high
  while (low < high) {
    const auto half = (static_cast<std::uint64_t>(high) - static_cast<std::uint64_t>(low)) / 2;
    const auto middle = low + static_cast<std::int64_t>(half);
    if (at_most(middle) >= rank)
      high = middle;
    else
      low = middle + 1;
  }
  return low;
}

Distribution Ranks::distribution() {
  Distribution result;
  const auto n = count();
  if (n == 0) return result;
  result.count = n;
  result.min = values_.min_;
  for (const auto& row : percentiles) result[row.figure] = at_rank(row.rank_of(n));
  result.max = values_.max_;
  const auto sum = static_cast<long double>(values_.sum_) + values_.large_sum_;
  result.mean = static_cast<double>(sum / static_cast<long double>(n));
  return result;
}

Histogram Ranks::histogram() {
  Histogram bins;
  if (count() == 0) return bins;
  auto below = at_most(-1);
  if (below > 0) bins.push_back({values_.min_, 0, below});
  if (values_.max_ < 0) return bins;
  const auto greatest = static_cast<std::uint64_t>(values_.max_);
  for (auto bin = bin_of(static_cast<std::uint64_t>(std::max<std::int64_t>(values_.min_, 0)));
       bin <= bin_of(greatest); ++bin) {
    const auto last = first_of_bin(bin + 1) - 1;
    const auto up_to = at_most(static_cast<std::int64_t>(last));
    if (up_to > below)
      bins.push_back({static_cast<std::int64_t>(first_of_bin(bin)),
                      static_cast<std::int64_t>(std::min<std::uint64_t>(last, INT64_MAX - 1)) + 1,
                      up_to - below});
    below = up_to;
  }
  return bins;
}

std::vector<Ranked> Ranks::some() {
  constexpr double most_exact = 128, a_doubling = 32;
  std::vector<Ranked> some;
  // By how many are higher.
  for (double higher = 0; higher < static_cast<double>(count());
       higher = higher < most_exact ? higher + 1 : std::ceil(higher * std::exp2(1 / a_doubling))) {
    const auto rank = count() - static_cast<std::uint64_t>(higher);
    some.push_back({rank, at_rank(rank)});
  }
  if (!some.empty() && some.back().rank > 1) some.push_back({1, values_.min_});
  std::reverse(some.begin(), some.end());
  return some;
}

Distribution distribution(const std::vector<std::int64_t>& values) {
  Values all;
  for (const auto value : values) all.add(value);
  return Ranks(std::move(all)).distribution();
}

}  // namespace ontime::statistics

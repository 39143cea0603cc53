// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <limits>

#include "watch/watch.hpp"

namespace ontime::watch {
namespace {

constexpr auto upper = [] {
  std::array<std::int64_t, Buckets::size> result{};
  std::ranges::copy(listen::round_times_ns, result.begin());
  result.back() = std::numeric_limits<std::int64_t>::max();
  return result;
}();

}  // namespace

std::int64_t Buckets::upper_ns(std::size_t bucket) { return upper[bucket]; }

void Buckets::add(std::int64_t ns, std::uint64_t count) {
  counts_[static_cast<std::size_t>(std::lower_bound(upper.begin(), upper.end(), ns) - upper.begin())] +=
      count;
  min_ns_ = count_ == 0 ? ns : std::min(min_ns_, ns);
  max_ns_ = count_ == 0 ? ns : std::max(max_ns_, ns);
  sum_ns_ += static_cast<double>(ns) * static_cast<double>(count);
  count_ += count;
}

void Buckets::correct(std::int64_t max_ns, double mean_ns) {
  max_ns_ = max_ns;
  min_ns_ = std::min(min_ns_, static_cast<std::int64_t>(mean_ns));
  sum_ns_ = mean_ns * static_cast<double>(count_);
}

}  // namespace ontime::watch

// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <limits>

#include "watch/watch.hpp"

namespace ontime::watch {
namespace {

constexpr std::array<std::int64_t, Buckets::size> upper = [] {
  std::array<std::int64_t, Buckets::size> result{};
  std::int64_t decade = 1000;
  for (std::size_t i = 0; i + 1 < result.size(); ++i) {
    constexpr std::int64_t steps[] = {1, 2, 5};
    result[i] = decade * steps[i % 3];
    if (i % 3 == 2) decade *= 10;
  }
  result.back() = std::numeric_limits<std::int64_t>::max();
  return result;
}();
static_assert(upper[Buckets::size - 2] == 10'000'000'000);

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

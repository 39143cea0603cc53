// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "statistics/statistics.hpp"

namespace ontime::statistics {

std::optional<Estimate> estimate(std::vector<double> values) {
  if (values.empty()) return {};
  std::sort(values.begin(), values.end());
  const auto n = values.size();
  Estimate result;
  result.count = n;
  result.median = n % 2 == 1 ? values[n / 2] : (values[n / 2 - 1] + values[n / 2]) / 2;
  // Between the k-th smallest and the k-th largest lies the median unless fewer than k values fell on one
  // side of it: confidence = 1 - 2 P(X < k), X ~ binomial(n, 1/2).
  double term = std::pow(0.5, static_cast<double>(n)), tail = term;
  std::size_t k = 1;
  for (; k < n / 2; ++k) {
    term *= static_cast<double>(n - k + 1) / static_cast<double>(k);
    if (1 - 2 * (tail + term) < 0.95) break;
    tail += term;
  }
  result.low = values[k - 1];
  result.high = values[n - k];
  result.confidence = std::max(0.0, 1 - 2 * tail);
  return result;
}

}  // namespace ontime::statistics

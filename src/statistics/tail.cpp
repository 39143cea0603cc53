// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include <boost/math/constants/constants.hpp>
#include <boost/math/special_functions/gamma.hpp>

#include "statistics/extremes.hpp"

namespace ontime::statistics {
namespace {

constexpr std::size_t fewest = 10;
constexpr double nearly_none = 1e-6;  // a shape so small is taken for the limit at 0

struct Moments {
  double first = 0, second = 0, third = 0;
};

// Sample L-moments, unbiased (Hosking 1990). Sorts.
Moments l_moments(std::vector<double>& values) {
  std::sort(values.begin(), values.end());
  const auto n = static_cast<double>(values.size());
  double b0 = 0, b1 = 0, b2 = 0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const auto below = static_cast<double>(i);
    b0 += values[i] / n;
    b1 += values[i] / n * below / (n - 1);
    b2 += values[i] / n * below * (below - 1) / ((n - 1) * (n - 2));
  }
  return {b0, 2 * b1 - b0, 6 * b2 - 6 * b1 + b0};
}

bool are_alike(const std::vector<double>& values) {
  return std::all_of(values.begin(), values.end(), [&](double value) { return value == values.front(); });
}

}  // namespace

double Tail::below(double x) const {
  const double at = (x - location) / scale;
  const double stretched = 1 + shape * at;
  if (stretched <= 0) return shape < 0 ? 1 : 0;
  const double beyond =
      std::abs(shape) < nearly_none ? std::exp(-at) : std::exp(-std::log(stretched) / shape);
  if (family == Family::maxima) return std::exp(-beyond);
  return at <= 0 ? 0 : 1 - beyond;
}

double Tail::quantile(double probability) const {
  const double beyond = family == Family::maxima ? -std::log(probability) : 1 - probability;
  if (std::abs(shape) < nearly_none) return location - scale * std::log(beyond);
  return location + scale * std::expm1(-shape * std::log(beyond)) / shape;
}

std::optional<Tail> fit_maxima(std::vector<double> maxima) {
  if (maxima.size() < fewest || are_alike(maxima)) return {};
  const auto [first, second, third] = l_moments(maxima);
  if (!(second > 0)) return {};
  // Hosking's k is − shape.
  const double c = 2 / (3 + third / second) - std::log(2.0) / std::log(3.0);
  const double k = 7.8590 * c + 2.9554 * c * c;
  if (!(k > -1)) return {};
  if (std::abs(k) < nearly_none) {
    const double scale = second / std::log(2.0);
    return Tail{Tail::Family::maxima, first - boost::math::constants::euler<double>() * scale, scale, 0};
  }
  const double gamma = boost::math::tgamma(1 + k);
  const double scale = second * k / ((1 - std::pow(2.0, -k)) * gamma);
  return Tail{Tail::Family::maxima, first - scale * (1 - gamma) / k, scale, -k};
}

std::optional<Tail> fit_peaks(std::vector<double> peaks, double threshold) {
  if (peaks.size() < fewest || are_alike(peaks)) return {};
  const auto [first, second, third] = l_moments(peaks);
  if (!(second > 0) || !(first > threshold)) return {};
  const double k = (first - threshold) / second - 2;
  if (!(k > -1)) return {};
  return Tail{Tail::Family::peaks, threshold, (1 + k) * (first - threshold), -k};
}

}  // namespace ontime::statistics

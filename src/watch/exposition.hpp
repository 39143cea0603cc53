// SPDX-License-Identifier: Apache-2.0
// Prometheus's text format, version 0.0.4.
#pragma once

#include <cstdint>
#include <initializer_list>
#include <span>
#include <string>
#include <string_view>
#include <utility>

#include <fmt/format.h>

#include "watch/watch.hpp"

namespace ontime::watch {

// a="1",b="2": values are made printable and escaped.
std::string labels(std::initializer_list<std::pair<std::string_view, std::string_view>>);

// Metrics, each with its HELP and TYPE, then its series.
class Exposition {
 public:
  // What is added next belongs to this metric: ontime_NAME. Types: counter, gauge, histogram.
  void begin(std::string_view name, std::string_view type, std::string_view help);
  template <class Number>
  void add(const std::string& labels, Number value) {
    line("", labels, fmt::to_string(value));
  }
  // A histogram in seconds: the upper limits of its buckets, and a count more than limits.
  void add(const std::string& labels, std::span<const std::int64_t> limits_ns,
           std::span<const std::uint64_t> counts, double sum_ns);
  std::string text() && { return std::move(text_); }

 private:
  void line(std::string_view suffix, const std::string& labels, const std::string& value);
  std::string name_, text_;
};

}  // namespace ontime::watch

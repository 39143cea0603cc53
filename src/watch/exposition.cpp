// SPDX-License-Identifier: Apache-2.0
#include "watch/exposition.hpp"

#include <algorithm>
#include <limits>

#include "table/table.hpp"

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

std::string labels(std::initializer_list<std::pair<std::string_view, std::string_view>> values) {
  std::string text;
  for (const auto& [name, value] : values) {
    text += fmt::format("{}{}=\"", text.empty() ? "" : ",", name);
    for (const char c : table::printable(std::string(value))) {
      if (c == '\\' || c == '"') text += '\\';
      text += c;
    }
    text += '"';
  }
  return text;
}

void Exposition::begin(std::string_view name, std::string_view type, std::string_view help) {
  name_ = fmt::format("ontime_{}", name);
  text_ += fmt::format("# HELP {0} {2}\n# TYPE {0} {1}\n", name_, type, help);
}

void Exposition::add(const std::string& labels, std::span<const std::int64_t> limits_ns,
                     std::span<const std::uint64_t> counts, double sum_ns) {
  std::uint64_t below = 0;
  for (std::size_t i = 0; i <= limits_ns.size(); ++i) {
    below += counts[i];
    const auto edge =
        i == limits_ns.size() ? "+Inf" : fmt::format("{:g}", static_cast<double>(limits_ns[i]) / 1e9);
    line("_bucket", fmt::format("{}{}le=\"{}\"", labels, labels.empty() ? "" : ",", edge),
         fmt::to_string(below));
  }
  line("_sum", labels, fmt::to_string(sum_ns / 1e9));
  line("_count", labels, fmt::to_string(below));
}

void Exposition::line(std::string_view suffix, const std::string& labels, const std::string& value) {
  text_ += fmt::format("{}{}", name_, suffix);
  if (!labels.empty()) text_ += fmt::format("{{{}}}", labels);
  text_ += fmt::format(" {}\n", value);
}

}  // namespace ontime::watch

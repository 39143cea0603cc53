// SPDX-License-Identifier: Apache-2.0
#include "listen_budget.hpp"

#include <charconv>
#include <chrono>

#include <fmt/format.h>

#include "flags.hpp"
#include "listen_cost.hpp"
#include "listen_words.hpp"
#include "terminal.hpp"

namespace ontime::app {
namespace {

std::chrono::nanoseconds now() { return std::chrono::steady_clock::now().time_since_epoch(); }

std::chrono::nanoseconds taken_by(const listen::Sensor& sensor) {
  const auto probes = sensor.cost();
  return own_cpu_time() +
         std::chrono::nanoseconds(probes ? static_cast<std::int64_t>(probes->total_ns()) : 0);
}

double share_of(const std::string& text) {
  double percent = 0;
  const auto* const end = text.data() + text.size();
  const auto [rest, error] = std::from_chars(text.data(), end, percent);
  const std::string unit(rest, end);
  if (error != std::errc() || (unit != "%" && unit != " %") || !(percent > 0 && percent <= 100))
    throw wrong("--budget: '{}' is not a share of one CPU above 0 % and up to 100 %, such as 1%", text);
  return percent / 100;
}

}  // namespace

ListenBudget::ListenBudget(const std::string& text) : share_(share_of(text)) {}

void ListenBudget::begin(const listen::Sensor& sensor, bool records_kernel_events) {
  measures_probes_ = sensor.cost().has_value();
  budget_.emplace(share_, records_kernel_events, now(), taken_by(sensor));
}

void ListenBudget::keep(listen::Sensor& sensor, std::unique_ptr<listen::Explainer>& explainer) {
  switch (budget_->look(now(), taken_by(sensor))) {
    case listen::Budget::Step::none:
      return;
    case listen::Budget::Step::drop_kernel_events:
      dropped_kernel_events_ = true;
      explainer.reset();
      return print_error(
          fmt::format("--budget: probes and ontime used more than {:g} % of one CPU. ontime stops recording "
                      "kernel events: late messages are not explained from now on",
                      100 * share_));
    case listen::Budget::Step::pause:
      sensor.pause();
      if (budget_->pauses() > 1) return;
      return print_error(
          fmt::format("--budget: probes and ontime used more than {:g} % of one CPU. ontime now pauses at "
                      "times: it sees no messages during pauses, and counts no losses across them",
                      100 * share_));
    case listen::Budget::Step::resume:
      return sensor.resume();
  }
}

std::string ListenBudget::text() const {
  if (!budget_) return "";
  auto text = fmt::format(
      "{:g} % of one CPU for ontime {}; what it allows for {} s may be used at once: a short time may use "
      "more",
      100 * share_,
      measures_probes_ ? "and probes together" : "without probes (this machine cannot measure their cost)",
      std::chrono::floor<std::chrono::seconds>(listen::Budget::balanced_within).count());
  if (!dropped_kernel_events_ && budget_->pauses() == 0)
    return labelled("budget", text + "; nothing was left out");
  if (dropped_kernel_events_) text += "; recording of kernel events stopped";
  if (const auto pauses = of_pauses(); !pauses.empty()) text += "; " + pauses;
  return labelled("budget", text);
}

std::string ListenBudget::of_pauses() const {
  if (!budget_ || budget_->pauses() == 0) return "";
  return pauses_of(budget_->listened_share(now()), budget_->pauses());
}

nlohmann::ordered_json ListenBudget::json() const {
  if (!budget_) return nullptr;
  return {{"cpu_share", share_},
          {"kernel_events_left_out", dropped_kernel_events_},
          {"pauses", budget_->pauses()},
          {"listened_share", budget_->listened_share(now())}};
}

}  // namespace ontime::app

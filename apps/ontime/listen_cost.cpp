// SPDX-License-Identifier: Apache-2.0
#include "listen_cost.hpp"

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <sys/resource.h>

#include "listen_words.hpp"

namespace ontime::app {

using namespace std::chrono_literals;
using nlohmann::ordered_json;

std::chrono::nanoseconds own_cpu_time() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto time_of = [](const timeval& time) {
    return std::chrono::seconds(time.tv_sec) + std::chrono::microseconds(time.tv_usec);
  };
  return time_of(usage.ru_utime) + time_of(usage.ru_stime);
}

void ListenCost::begin() {
  since_ = std::chrono::steady_clock::now();
  own_before_ = own_cpu_time();
  from_ = std::chrono::system_clock::now();
}

std::int64_t ListenCost::from_ns() const {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(from_.time_since_epoch()).count();
}

std::chrono::nanoseconds ListenCost::listened() const { return std::chrono::steady_clock::now() - since_; }
bool ListenCost::is_known() const { return listened() >= 1s; }

double ListenCost::own_share() const {
  return share_of_cpu(static_cast<double>((own_cpu_time() - own_before_).count()));
}

ordered_json ListenCost::json(const std::optional<listen::Cost>& probes) const {
  const auto share = [this](double of_cpu) { return is_known() ? ordered_json(of_cpu) : ordered_json(); };
  ordered_json json{{"ontime_cpu_share", share(own_share())}, {"probes", nullptr}};
  if (probes)
    json["probes"] = {
        {"publishes", probes->publishes}, {"publish_ns", probes->publish_ns},
        {"takes", probes->takes},         {"take_ns", probes->take_ns},
        {"turns", probes->turns},         {"stepped", probes->stepped},
        {"step_ns", probes->step_ns},     {"cpu_share", share(share_of_cpu(probes->total_ns()))}};
  return json;
}

std::string ListenCost::text(const std::optional<listen::Cost>& probes) const {
  const std::chrono::duration<double> time = listened();  // steady, even if the clock is set meanwhile
  auto counted = labelled(
      "counted",
      fmt::format("from {:%T}, for {:.1f} s{}", fmt::localtime(std::chrono::system_clock::to_time_t(from_)),
                  time.count(), probes ? "; nodes that start later are found within 1 s" : ""));
  if (!is_known()) return counted;
  auto text = fmt::format("ontime {:.1f} % of one CPU", 100 * own_share());
  if (probes)
    text += fmt::format("; probes in the nodes {:.1f} %: {} publishes of {:.1f} µs, {} takes of {:.1f} µs",
                        100 * share_of_cpu(probes->total_ns()), probes->publishes, probes->publish_ns / 1e3,
                        probes->takes, probes->take_ns / 1e3);
  if (probes && probes->turns > 0)
    text += fmt::format(", {} other calls of at most {:.1f} µs", probes->turns, probes->publish_ns / 1e3);
  if (probes && probes->stepped > 0)
    text += fmt::format("; {} of these calls {:.1f} µs more", probes->stepped, probes->step_ns / 1e3);
  return counted + labelled("cost", text);
}

}  // namespace ontime::app

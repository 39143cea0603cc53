// SPDX-License-Identifier: Apache-2.0
#include "metrics.hpp"

#include <stdexcept>

#include <fmt/format.h>

#include "campaign/campaign.hpp"
#include "flags.hpp"
#include "table/table.hpp"
#include "terminal.hpp"

namespace ontime::app {
namespace {

class Text {
 public:
  void begin(const std::string& name, const char* type, const char* help) {
    name_ = "ontime_" + name;
    text_ += fmt::format("# HELP {0} {2}\n# TYPE {0} {1}\n", name_, type, help);
  }
  void add(const std::string& labels, std::uint64_t value) {
    text_ += fmt::format("{}{{{}}} {}\n", name_, labels, value);
  }
  void add(const std::string& labels, const listen::Distribution& values) {
    constexpr auto buckets = watch::Buckets::size;
    for (std::size_t i = 0; i + 1 < buckets; ++i) {
      const auto upper_ns = watch::Buckets::upper_ns(i);
      bucket(labels, fmt::format("{:g}", static_cast<double>(upper_ns) / 1e9), values.count_up_to(upper_ns));
    }
    bucket(labels, "+Inf", values.count());
    text_ += fmt::format("{0}_sum{{{1}}} {2}\n{0}_count{{{1}}} {3}\n", name_, labels, values.sum_ns() / 1e9,
                         values.count());
  }
  std::string text() && { return std::move(text_); }

 private:
  void bucket(const std::string& labels, const std::string& upper, std::uint64_t count) {
    text_ += fmt::format("{}_bucket{{{},le=\"{}\"}} {}\n", name_, labels, upper, count);
  }
  std::string name_, text_;
};

std::string labels_of(const listen::Flow& flow) {
  const auto end = [](const char* role, const listen::Party& party) {
    const auto pid = party.process == 0 ? "" : std::to_string(party.process);
    return "," + watch::label(role, table::printable(party.name)) + "," +
           watch::label(fmt::format("{}_pid", role), pid);
  };
  return watch::label("topic", table::printable(flow.topic)) + end("writer", flow.writer) +
         end("reader", flow.reader);
}

}  // namespace

void add_metrics(Command& command, std::string& address) {
  command
      .add_option("--metrics", address, "offer Prometheus the same over HTTP; of a PORT alone on loopback")
      ->type_name("[ADDR:]PORT")
      ->check(given);
}

std::unique_ptr<watch::Metrics> metrics_at(const std::string& address) {
  if (address.empty()) return nullptr;
  try {
    auto metrics = std::make_unique<watch::Metrics>(address);
    print_error(fmt::format("metrics are at http://{}/metrics", metrics->address()));
    return metrics;
  } catch (const std::invalid_argument& error) {
    throw campaign::Error(2, fmt::format("--metrics: {}", error.what()));
  } catch (const std::runtime_error& error) {
    throw campaign::Error(3, fmt::format("--metrics: {}", error.what()));
  }
}

std::string metrics_of(const listen::Findings& findings,
                       const std::map<std::string, std::uint64_t>& late_by_cause) {
  // Two endpoints of a process on one topic are one series.
  std::map<std::string, std::vector<const listen::Flow*>> series;
  for (const auto& flow : findings.flows) series[labels_of(flow)].push_back(&flow);
  Text text;
  const auto count = [&](const char* name, const char* help, auto value_of) {
    text.begin(name, "counter", help);
    for (const auto& [labels, flows] : series) {
      std::optional<std::uint64_t> sum;
      for (const auto* flow : flows)
        if (const std::optional<std::uint64_t> value = value_of(*flow)) sum = sum.value_or(0) + *value;
      if (sum) text.add(labels, *sum);
    }
  };
  count("topic_messages_total",
        "Messages of a topic that a reader took; without a reader, that were published.",
        [](const auto& flow) { return flow.messages; });
  count("topic_late_total", "Messages that missed a limit.", [](const auto& flow) { return flow.late; });
  count("topic_lost_total", "Messages that were published and never taken.",
        [](const auto& flow) { return flow.lost; });
  count("topic_duplicated_total", "Messages that were taken again.",
        [](const auto& flow) { return flow.duplicated; });
  count("topic_out_of_order_total", "Messages that a later one overtook.",
        [](const auto& flow) { return flow.reordered; });
  const auto spread = [&](const char* name, const char* help, auto values_of) {
    text.begin(name, "histogram", help);
    for (const auto& [labels, flows] : series) {
      listen::Distribution sum;
      for (const auto* flow : flows)
        if (const listen::Distribution* values = values_of(*flow)) sum.add(*values);
      if (sum.count() > 0) text.add(labels, sum);
    }
  };
  spread("topic_age_seconds", "From the writer's time stamp to the take.",
         [](const auto& flow) { return flow.age ? &*flow.age : nullptr; });
  spread("topic_period_seconds", "From one message to the next.",
         [](const auto& flow) { return &flow.period; });
  text.begin("late_by_cause_total", "counter", "Late messages, by what the kernel's events say of them.");
  for (const auto& [cause, messages] : late_by_cause) text.add(watch::label("cause", cause), messages);
  text.begin("sensor_lost_total", "counter", "Events that the sensor had no room for.");
  text.add("", findings.sensor_lost);
  return std::move(text).text();
}

}  // namespace ontime::app

// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <functional>
#include <span>

#include "watch/exposition.hpp"
#include "watch/watch.hpp"

namespace ontime::watch {
namespace {

constexpr const char* not_looked_for = "not looked for";

constexpr std::span<const std::int64_t> age_limits_ns = listen::round_times_ns;

// 0.12 ms … 12 s. A steady topic's periods are in one bucket, and Prometheus takes its upper limit for p99.
// So limits are 8 to 20 % above the periods of the most usual rates, 1, 2, 5, 10, 20, 30 Hz …, and not at
// them: half of the periods would be in the next bucket. They are at most 44 % above those of 15, 25, 40 and
// 60 Hz, and 83 % above any.
constexpr auto period_limits_ns = [] {
  std::array<std::int64_t, 26> limits{120'000, 220'000, 360'000, 550'000, 900'000};
  for (std::size_t i = 5; i < limits.size(); ++i) limits[i] = 10 * limits[i - 5];
  return limits;
}();
static_assert(period_limits_ns.back() == 12'000'000'000);

// Labels hold no process number, so that a restarted node continues its series.
std::string labels_of(const listen::Flow& flow) {
  return labels({{"topic", flow.topic}, {"writer", flow.writer.name}, {"reader", flow.reader.name}});
}

std::string labels_of_unseen(const std::string& topic) {
  return labels({{"topic", topic}, {"writer", ""}, {"reader", ""}});
}

// Removes the entries that were updated longest ago.
template <class Key, class Counts>
void make_room(std::map<Key, Counts>& all) {
  while (all.size() > TopicCounters::most_kept)
    all.erase(std::ranges::min_element(all, {}, [](const auto& one) { return one.second.look; }));
}

}  // namespace

TopicCounters::TopicCounters(const listen::Limits& limits, const std::set<std::string>& topics)
    : limits_(limits) {
  for (const auto& topic : topics) stated_[topic];
  // Prometheus sees no increase to the first value of a counter: each cause begins at 0.
  for (const auto& cause : listen::causes()) misses_[cause];
  misses_[not_looked_for];
}

TopicCounters::Spread TopicCounters::spread_of(const listen::Distribution& values,
                                               std::span<const std::int64_t> limits_ns) {
  Spread spread;
  std::uint64_t below = 0;
  for (std::size_t i = 0; i <= limits_ns.size(); ++i) {
    const auto count = i == limits_ns.size() ? values.count() : values.count_up_to(limits_ns[i]);
    spread.counts[i] = count - below;
    below = count;
  }
  spread.sum_ns = values.sum_ns();
  return spread;
}

TopicCounters::Counts TopicCounters::counts_of(const listen::Flow& flow) const {
  const bool is_awaited = limits_.longest_gap() || stated_.contains(flow.topic);
  return {.messages = flow.messages,
          .late = flow.late,
          .not_judged = flow.not_judged,
          .lost = flow.lost,
          .lost_not_judged = flow.lost_not_judged,
          .duplicated = flow.duplicated,
          .reordered = flow.reordered,
          .age = flow.age ? spread_of(*flow.age, age_limits_ns) : Spread{},
          .period = spread_of(flow.period, period_limits_ns),
          .idle_ns = is_awaited ? std::optional(flow.idle_ns) : std::nullopt,
          .is_partial = flow.writer.name.empty() != flow.reader.name.empty()};
}

TopicCounters::Counts TopicCounters::counts_of(const listen::ChainPath& path) {
  return {.messages = path.age.count() + path.not_judged,
          .late = path.late,
          .not_judged = path.not_judged,
          .age = spread_of(path.age, age_limits_ns)};
}

// Adds the increase from `before` to `now`.
void TopicCounters::grow(Counts& series, const Counts& before, const Counts& now) {
  const auto more = [](std::uint64_t from, std::uint64_t to) { return to - std::min(from, to); };
  for (const auto member :
       {&Counts::messages, &Counts::late, &Counts::not_judged, &Counts::duplicated, &Counts::reordered})
    series.*member += more(before.*member, now.*member);
  if (now.lost) {
    series.lost = series.lost.value_or(0) + more(before.lost.value_or(0), *now.lost);
    series.lost_not_judged += more(before.lost_not_judged, now.lost_not_judged);
  }
  for (const auto member : {&Counts::age, &Counts::period}) {
    for (std::size_t i = 0; i < (now.*member).counts.size(); ++i)
      (series.*member).counts[i] += more((before.*member).counts[i], (now.*member).counts[i]);
    (series.*member).sum_ns += std::max((now.*member).sum_ns - (before.*member).sum_ns, 0.0);
  }
  if (now.idle_ns) series.idle_ns = std::min(series.idle_ns.value_or(*now.idle_ns), *now.idle_ns);
  series.is_partial = now.is_partial;
  series.look = now.look;
}

void TopicCounters::add(Series& all, std::uint64_t id, const std::string& labels, Counts now) const {
  auto& before = all.flows[id];
  // Another writer, or the same one recognized again: its ages and losses start at 0.
  if (now.age.count() < before.age.count()) {
    before.age = {};
    before.lost.reset();
    before.lost_not_judged = 0;
  }
  // A lost message can still arrive, late. The counter keeps its value until a further loss.
  if (now.lost) {
    now.lost = std::max(*now.lost, before.lost.value_or(0));
    now.lost_not_judged = std::max(now.lost_not_judged, before.lost_not_judged);
  }
  now.look = looks_;
  grow(all.series[labels], before, now);
  before = now;
}

void TopicCounters::add(const listen::Chain& chain) {
  for (const auto& path : chain.paths) {
    std::string nodes;
    for (const auto& party : path.parties) nodes += (nodes.empty() ? "" : " → ") + party.name;
    add(chains_, path.id, labels({{"chain", chain.wish.name()}, {"nodes", nodes}}), counts_of(path));
  }
  for (std::size_t part = 0; part < chain.ended.size(); ++part) {
    auto& ended = ended_[labels({{"chain", chain.wish.name()},
                                 {"topic", chain.wish.steps[part / 2].topic},
                                 {"end", part % 2 == 0 ? "not taken" : "not published on"}})];
    // A slow message can still reach the chain's end, so the count can fall.
    ended = std::max(ended, chain.ended[part]);
  }
}

// A stated topic without a flow: it never came, or its flows ended long ago. An alert must not end for that.
void TopicCounters::add_unseen(const listen::Findings& findings, std::chrono::nanoseconds listened) {
  std::map<std::string, std::int64_t> idle_ns;
  for (const auto& flow : findings.flows) {
    const auto [known, is_new] = idle_ns.try_emplace(flow.topic, flow.idle_ns);
    if (!is_new) known->second = std::min(known->second, flow.idle_ns);
  }
  for (auto& [topic, heard_at] : stated_) {
    if (const auto seen = idle_ns.find(topic); seen != idle_ns.end()) {
      heard_at = listened - std::chrono::nanoseconds(seen->second);
    } else {
      auto& series = topics_.series[labels_of_unseen(topic)];
      series.idle_ns = (listened - heard_at).count();
      series.look = looks_;
    }
  }
}

// A scrape sees only the silence of its moment: the total tells of those between scrapes.
void TopicCounters::add_silence(Counts& series) const {
  const auto before_ns = series.silent_ns;
  series.silent_ns = series.idle_ns && limits_.is_silence(*series.idle_ns) ? *series.idle_ns : 0;
  if (!series.idle_ns) return;
  const bool goes_on = series.silent_ns >= before_ns;
  series.silent_total_ns = series.silent_total_ns.value_or(0) + series.silent_ns - (goes_on ? before_ns : 0);
}

void TopicCounters::add(const listen::Findings& findings, std::chrono::nanoseconds listened) {
  ++looks_;
  for (auto& [labels, counts] : topics_.series) counts.idle_ns.reset();
  for (const auto& flow : findings.flows) add(topics_, flow.id, labels_of(flow), counts_of(flow));
  add_unseen(findings, listened);
  for (auto& [labels, counts] : topics_.series) add_silence(counts);
  for (const auto& chain : findings.chains) add(chain);
  misses_left_out_ = 0;
  for (const auto& [topic, count] : findings.misses_left_out) misses_left_out_ += count;
  sensor_lost_ = findings.sensor_lost;
  not_counted_ = findings.not_counted;
  std::erase_if(topics_.series, [&](const auto& one) {
    return one.second.is_partial && looks_ - one.second.look > partial_kept;
  });
  for (auto* const all : {&topics_, &chains_}) {
    make_room(all->flows);
    make_room(all->series);
  }
}

void TopicCounters::add(const std::vector<listen::Miss>& misses) {
  for (const auto& miss : misses) ++misses_[miss.why ? miss.why->cause : not_looked_for];
}

std::string TopicCounters::metrics(std::optional<bool> results_failed) const {
  Exposition text;
  const auto count_of = [&](const Series& all, const char* name, const char* help, auto value_of) {
    text.begin(name, "counter", help);
    for (const auto& [labels, counts] : all.series)
      if (const std::optional<std::uint64_t> value = std::invoke(value_of, counts)) text.add(labels, *value);
  };
  const auto count = [&](const char* name, const char* help, auto value_of) {
    count_of(topics_, name, help, value_of);
  };
  count("topic_messages_total", "Messages that a reader took; without a reader, messages published.",
        &Counts::messages);
  count("topic_late_total", "Messages that missed a limit.", &Counts::late);
  count("topic_not_judged_total", "Messages that ontime may have made late, by setting or removing probes.",
        &Counts::not_judged);
  count("topic_lost_total", "Messages published and never taken.", &Counts::lost);
  count("topic_lost_not_judged_total",
        "Messages that ontime may have made lost, by setting or removing probes.", [](const auto& counts) {
          return counts.lost ? std::optional(counts.lost_not_judged) : std::nullopt;
        });
  count("topic_duplicated_total", "Repeated takes of a message.", &Counts::duplicated);
  count("topic_out_of_order_total", "Messages that a later one overtook.", &Counts::reordered);
  const auto spread = [&](const Series& all, const char* name, const char* help, Spread Counts::*member,
                          std::span<const std::int64_t> limits_ns) {
    text.begin(name, "histogram", help);
    for (const auto& [labels, counts] : all.series)
      if (const auto& values = counts.*member; values.count() > 0)
        text.add(labels, limits_ns, values.counts, values.sum_ns);
  };
  spread(topics_, "topic_age_seconds", "From the writer's time stamp to the take.", &Counts::age,
         age_limits_ns);
  spread(topics_, "topic_period_seconds", "From one message to the next.", &Counts::period, period_limits_ns);
  text.begin("topic_silent_seconds", "gauge",
             "Time since the last message if beyond the stated deadline or period (without: 5 s), else 0.");
  for (const auto& [labels, counts] : topics_.series)
    if (counts.idle_ns) text.add(labels, static_cast<double>(counts.silent_ns) / 1e9);
  text.begin("topic_silent_seconds_total", "counter", "Sum of such times, as looked at once a second.");
  for (const auto& [labels, counts] : topics_.series)
    if (counts.silent_total_ns) text.add(labels, static_cast<double>(*counts.silent_total_ns) / 1e9);
  if (!ended_.empty()) {
    spread(chains_, "chain_age_seconds",
           "From the publish of a chain's first message to the take of its last.", &Counts::age,
           age_limits_ns);
    count_of(chains_, "chain_late_total", "Messages that took longer through a chain than its limit.",
             &Counts::late);
    count_of(chains_, "chain_not_judged_total",
             "Messages that ontime may have made late, by setting or removing probes.", &Counts::not_judged);
    text.begin("chain_ended_total", "counter", "Messages of a chain's first topic that ended at this step.");
    for (const auto& [labels, ended] : ended_) text.add(labels, ended);
  }
  text.begin("late_by_cause_total", "counter", "Missed limits, by cause.");
  for (const auto& [cause, misses] : misses_)
    text.add(labels({{"cause", cause}}), misses + (cause == not_looked_for ? misses_left_out_ : 0));
  text.begin("sensor_lost_total", "counter", "Events dropped because the sensor's buffer was full.");
  text.add("", sensor_lost_);
  text.begin("not_counted_total", "counter", "Messages left out: too many flows were active.");
  text.add("", not_counted_);
  if (results_failed) {
    text.begin("results_failed", "gauge", "1 while the results file cannot be written.");
    text.add("", *results_failed ? 1 : 0);
  }
  return std::move(text).text();
}

}  // namespace ontime::watch

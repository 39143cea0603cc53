// SPDX-License-Identifier: Apache-2.0
#include "listen_words.hpp"

#include <algorithm>
#include <map>
#include <numeric>
#include <set>
#include <tuple>
#include <type_traits>
#include <utility>

#include <fmt/chrono.h>
#include <fmt/format.h>

#include "report/runs.hpp"
#include "table/table.hpp"

namespace ontime::app {
namespace {

using app::json_of;
using nlohmann::ordered_json;
using table::grouped;

std::string spread_of(const listen::Distribution& values) {
  if (values.count() == 0) return "unknown";
  auto max = in_ms(values.max_ns());
  if (max.ends_with(".0")) max.resize(max.size() - 2);  // "100", as the others
  return fmt::format("p50 {} ms  p99 {} ms  max {} ms", in_rounded_ms(values.quantile_ns(0.5)),
                     in_rounded_ms(values.quantile_ns(0.99)), max);
}

const char* start_of_age(listen::AgeFrom from) {
  return from == listen::AgeFrom::writer  ? "writer"
         : from == listen::AgeFrom::stamp ? "header.stamp"
                                          : "publish time";
}

// For recorded messages, states where the age starts and ends.
std::string age_of(const listen::Flow& flow) {
  if (!flow.age) return "age unknown";
  return (flow.age_from == listen::AgeFrom::writer
              ? "age "
              : fmt::format("age from {} to recording ", start_of_age(flow.age_from))) +
         spread_of(*flow.age);
}

std::string sentence_of(const listen::Why& why) {
  return why.sentence + (why.ns > 0 ? fmt::format(": {} ms", in_rounded_ms(why.ns)) : "") +
         (why.cpu ? fmt::format(", CPU {}", *why.cpu) : "");
}

ordered_json json_of(const listen::Why& why) {
  return {{"seen", why.is_seen},
          {"cause", why.cause},
          {"sentence", sentence_of(why)},
          {"fix", why.fix},
          {"victim", json_of(why.victim)},
          {"thread", why.thread},
          {"culprit", json_of(why.culprit)},
          {"ns", why.ns}};
}

template <class Value>
ordered_json json_of(const std::optional<Value>& value) {
  if constexpr (std::is_arithmetic_v<Value>)
    return value ? ordered_json(*value) : ordered_json();
  else
    return value ? json_of(*value) : ordered_json();
}

}  // namespace

std::string topic_of(const std::string& topic) {
  return topic.empty() ? "(unknown topic)" : table::printable(topic);
}

std::string labelled(const std::string& label, const std::string& text) {
  return table::labelled(label, text, 9, 80);
}

std::string in_ms(std::int64_t ns) {
  const auto ms = static_cast<double>(ns) / 1e6;
  return fmt::format("{:.{}f}", ms, ms < 10 ? 3 : ms < 100 ? 2 : 1);
}

std::string in_rounded_ms(std::int64_t ns) {
  const auto ms = static_cast<double>(ns) / 1e6;
  return fmt::format("{:.{}f}", ms, ms < 0.9995 ? 3 : ms < 9.995 ? 2 : ms < 99.95 ? 1 : 0);
}

std::string clock_of(std::int64_t at_ns) {
  using namespace std::chrono;
  const system_clock::time_point at{nanoseconds(at_ns)};
  const auto second = floor<seconds>(at);  // before 1970, too
  return fmt::format("{:%T}.{:03}", fmt::localtime(system_clock::to_time_t(second)),
                     floor<milliseconds>(at - second).count());
}

std::string day_of(std::int64_t at_ns) {
  using namespace std::chrono;
  const system_clock::time_point at{nanoseconds(at_ns)};
  return fmt::format("{:%F}", fmt::localtime(system_clock::to_time_t(floor<seconds>(at))));
}

std::string change_of_day(std::int64_t at_ns, std::string& day) {
  const auto before = std::exchange(day, day_of(at_ns));
  return before.empty() || before == day ? "" : fmt::format("until here {}, from here on {}\n", before, day);
}

std::string words_of(const listen::Party& party, const char* unknown) {
  if (party.process != 0) return fmt::format("{} [{}]", table::printable(party.name), party.process);
  return party.name.empty() ? unknown : table::printable(party.name);
}

namespace {

// A burst, as when a node starts, tells no rate.
bool is_rate_known(const listen::Flow& flow) {
  constexpr std::uint64_t few = 10;
  constexpr double short_ns = 1e9;
  return flow.messages < 2 ||
         (flow.period.count() > 0 && (flow.messages >= few || flow.period.sum_ns() >= short_ns));
}

std::string ends_of(const listen::Flow& flow) {
  return fmt::format("{}  {} → {}", topic_of(flow.topic), words_of(flow.writer, "(writer not seen)"),
                     words_of(flow.reader, "(no reader seen)"));
}

// "" of a burst.
std::string rate_of(const listen::Flow& flow) {
  const auto hz = flow.rate_hz();
  if (!is_rate_known(flow)) return flow.period.count() > 0 ? "" : "rate unknown";
  return hz >= 0.95 || hz == 0 ? fmt::format("{:.1f} Hz", hz)
         : hz >= 1e-4          ? fmt::format("{:.2g} Hz", hz)
                               : fmt::format("{:.6f} Hz", hz);  // no exponent
}

std::string count_of(const listen::Flow& flow) { return table::many(flow.messages, "message", "messages"); }

}  // namespace

std::string way_of(const listen::Flow& flow) {
  const auto rate = rate_of(flow);
  return fmt::format("{}  {}", ends_of(flow), rate.empty() ? count_of(flow) : rate);
}

bool is_age_known(const listen::Flow& flow) { return flow.age && flow.age->count() > 0; }

std::string open_age_of(const listen::Flow& flow) {
  // A topic that no process takes has no age, and needs none.
  if (flow.reader == listen::Party{}) return "";
  if (!is_age_known(flow)) return fmt::format("the age of {} is unknown", topic_of(flow.topic));
  std::string text;
  if (const auto unknown = flow.age_unknown.value_or(0); unknown > 0)
    text = fmt::format("the age of {} of {} messages of {} is unknown", grouped(unknown),
                       grouped(flow.messages), topic_of(flow.topic));
  if (const auto ahead = flow.stamp_ahead.value_or(0); ahead > 0)
    text += fmt::format(
        "{}{} of {} stamps of {} are later than the {}, and these ages count as 0: the writer's clock is "
        "ahead. Fix: synchronize the clocks (PTP, chrony)",
        text.empty() ? "" : "; ", grouped(ahead), grouped(flow.messages), topic_of(flow.topic),
        flow.age_from == listen::AgeFrom::writer ? "capture" : "recording");
  return text;
}

std::string pauses_of(double listened_share, std::uint64_t pauses) {
  return fmt::format("listened {} % of the time, with {}; losses during pauses are unknown",
                     table::percent(listened_share, 2), table::many(pauses, "pause", "pauses"));
}

std::string unseen_of(std::uint64_t sensor_lost) {
  return fmt::format(
      "{} not seen: ontime's buffer was full, or, without --packets, a node took more than 64 messages at "
      "once. Losses and periods across these gaps are not counted. Fix for a full buffer: start ontime with "
      "nice -n -10",
      table::many(sensor_lost, "publish, take or packet was", "publishes, takes or packets were"));
}

std::string time_of_silence(std::int64_t ns) {
  return ns < 999'500'000 ? in_rounded_ms(ns) + " ms"
                          : fmt::format("{:.1f} s", static_cast<double>(ns) / 1e9);
}

std::string silence_of(const listen::Flow& flow) {
  return fmt::format("for {}{}{}", flow.was_replaced ? "" : "the last ", time_of_silence(flow.silent_ns),
                     flow.was_replaced ? " until it started again" : "");
}

std::string text_of(const listen::Flow& flow, const listen::Limits& limits) {
  const auto rate = rate_of(flow);
  auto text = fmt::format("{}{}{}  {}\n    period {}\n    {}\n   ", ends_of(flow), rate.empty() ? "" : "  ",
                          rate, count_of(flow), spread_of(flow.period), age_of(flow));
  const auto unknown = is_age_known(flow) ? flow.age_unknown.value_or(0) : 0;
  const auto ahead = flow.stamp_ahead.value_or(0);
  const bool lacks_age = limits.age && (!is_age_known(flow) || flow.age->count() == ahead);
  const bool by_age = limits.age && !lacks_age, by_period = limits.longest_gap().has_value();
  if (by_age || by_period)
    text += fmt::format(" late {} of {}{} ", grouped(flow.late),
                        grouped(!by_age     ? flow.period.count()
                                : by_period ? flow.messages - flow.not_judged
                                            : flow.age->count() - ahead),
                        lacks_age ? " (by period only)" : "");
  else if (lacks_age)
    text += " late unknown ";
  if (unknown > 0) text += fmt::format(" age unknown {} ", grouped(unknown));
  if (ahead > 0) text += fmt::format(" stamp ahead {} ", grouped(ahead));
  if (flow.not_judged > 0) text += fmt::format(" not judged {} ", grouped(flow.not_judged));
  if (flow.silent_ns > 0) text += fmt::format(" SILENT {} ", silence_of(flow));
  text += flow.lost ? fmt::format(" lost {} ", grouped(*flow.lost)) : " lost unknown ";
  if (flow.lost_not_judged > 0) text += fmt::format("(and {} not judged) ", grouped(flow.lost_not_judged));
  return text +
         fmt::format(" duplicated {}  out of order {}\n", grouped(flow.duplicated), grouped(flow.reordered));
}

record::Note note_of(const listen::Miss& miss, std::chrono::nanoseconds limit, bool with_date,
                     std::optional<std::uint64_t> message) {
  const std::chrono::sys_seconds at(
      std::chrono::floor<std::chrono::seconds>(std::chrono::nanoseconds(miss.at_ns)));
  const auto& why = *miss.why;
  const record::LateCause cause{
      .measures = miss.kind == listen::Miss::Kind::age ? "age" : "period",
      .date =
          with_date ? fmt::format("{:%F %T}", fmt::localtime(std::chrono::system_clock::to_time_t(at))) : "",
      .value_ns = miss.value_ns,
      .limit_ns = limit.count(),
      .sentence = why.sentence,
      .fix = why.fix,
      .alike = why.alike,
      .alike_fix = why.alike_fix,
      .ns = why.ns,
      .cpu = why.cpu};
  return {why.is_seen ? record::cause_of_late : record::cause_not_seen, report::text_of(cause),
          miss.course.taken_ns, message, cause};
}

std::string text_of(const listen::Miss& miss, std::size_t width) {
  constexpr std::size_t column = 14;
  auto says = fmt::format("{}  {}: {} ms {}", topic_of(miss.topic),
                          words_of(miss.reader, words_of(miss.writer, "").c_str()), in_ms(miss.value_ns),
                          miss.kind == listen::Miss::Kind::age ? "old" : "after the previous message");
  if (miss.why) says += fmt::format(": {}", table::printable(sentence_of(*miss.why)));
  auto text = table::labelled(clock_of(miss.at_ns), says, column, width);
  if (miss.why && !miss.why->fix.empty())
    text += table::labelled("", "fix: " + table::printable(miss.why->fix), column, width);
  return text;
}

ordered_json json_of(const listen::Party& party) {
  if (party == listen::Party{}) return nullptr;
  ordered_json json{{"name", party.name}, {"pid", nullptr}};
  if (party.process != 0) json["pid"] = party.process;
  return json;
}

ordered_json json_of(const listen::Distribution& values) {
  return {{"count", values.count()},
          {"p50_ns", values.quantile_ns(0.5)},
          {"p99_ns", values.quantile_ns(0.99)},
          {"max_ns", values.max_ns()}};
}

ordered_json json_of(const listen::Flow& flow) {
  return {{"topic", flow.topic},
          {"writer", json_of(flow.writer)},
          {"reader", json_of(flow.reader)},
          {"messages", flow.messages},
          {"rate_hz", is_rate_known(flow) ? ordered_json(flow.rate_hz()) : ordered_json()},
          {"period", json_of(flow.period)},
          {"age", json_of(flow.age)},
          {"age_from", flow.age ? ordered_json(start_of_age(flow.age_from)) : ordered_json()},
          {"age_unknown", json_of(flow.age_unknown)},
          {"stamp_ahead", json_of(flow.stamp_ahead)},
          {"late", flow.late},
          {"not_judged", flow.not_judged},
          {"silent_ns", flow.silent_ns},
          {"lost", json_of(flow.lost)},
          {"lost_not_judged", flow.lost_not_judged},
          {"duplicated", flow.duplicated},
          {"out_of_order", flow.reordered}};
}

ordered_json json_of(const listen::Miss& miss) {
  return {{"kind", miss.kind == listen::Miss::Kind::age ? "age" : "gap"},
          {"at_ns", miss.at_ns},
          {"value_ns", miss.value_ns},
          {"topic", miss.topic},
          {"writer", json_of(miss.writer)},
          {"reader", json_of(miss.reader)},
          {"why", json_of(miss.why)}};
}

namespace {

// A message can miss both limits, and several can arrive at the same time.
class LateMessages {
 public:
  void add(const listen::Miss& miss) {
    auto& [ages, gaps] = at_[{miss.flow, miss.topic, miss.reader.process, miss.at_ns}];
    ++(miss.kind == listen::Miss::Kind::age ? ages : gaps);
  }
  std::size_t count() const {
    return std::accumulate(at_.begin(), at_.end(), std::size_t{0}, [](auto sum, const auto& one) {
      return sum + std::max(one.second.first, one.second.second);
    });
  }

 private:
  using Arrival = std::tuple<std::uint64_t, std::string, std::uint32_t, std::int64_t>;
  std::map<Arrival, std::pair<std::size_t, std::size_t>> at_;  // ages and gaps
};

}  // namespace

std::string lines_of(const std::vector<listen::Miss>& misses, std::size_t width, std::string& day) {
  std::string lines;
  using Cause = std::tuple<std::string, std::uint32_t, std::string, std::int32_t, std::uint32_t>;
  LateMessages all, printed;
  for (const auto& miss : misses) all.add(miss);
  std::set<Cause> shown;
  const bool is_explained = std::ranges::any_of(misses, [](const auto& one) { return one.why.has_value(); });
  for (const auto& miss : misses) {
    if (shown.size() == listen::most_explained) break;
    if (is_explained && !miss.why) continue;
    // A gap is another matter than an age.
    const auto why =
        miss.why.value_or(listen::Why{.cause = miss.kind == listen::Miss::Kind::gap ? "gap" : ""});
    const auto& party = miss.reader.process != 0 ? miss.reader : miss.writer;
    if (shown.insert({miss.topic, party.process, why.cause, why.thread, why.culprit.process}).second) {
      lines += change_of_day(miss.at_ns, day) + text_of(miss, width);
      printed.add(miss);
    }
  }
  if (all.count() > printed.count()) {
    const auto last_ns = std::ranges::max_element(misses, {}, &listen::Miss::at_ns)->at_ns;
    const auto before = std::exchange(day, day_of(last_ns));
    const bool is_another_day = !before.empty() && before != day;
    lines += fmt::format(
        "… and {}{} until {}{}\n",
        table::many(all.count() - printed.count(), "more late message", "more late messages"),
        is_another_day ? " from " + before : "", is_another_day ? day + " " : "", clock_of(last_ns));
  }
  return lines;
}

}  // namespace ontime::app

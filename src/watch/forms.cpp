// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "gate/gate.hpp"
#include "table/table.hpp"
#include "watch/watch.hpp"

namespace ontime::watch {
namespace {

using nlohmann::json;

std::string word(const json& value) {
  if (value.is_null()) return "";
  return table::printable(value.is_string() ? value.get<std::string>()
                                            : value.dump(-1, ' ', true, json::error_handler_t::replace));
}

std::string time_of(std::int64_t ns) { return gate::time_of(static_cast<double>(ns)); }

// "1:02:03", below an hour "2:03".
std::string clock(double seconds) {
  const auto whole = static_cast<std::int64_t>(std::clamp(seconds, 0.0, 1e9));
  const auto minutes = whole / 60 % 60;
  return whole >= 3600 ? fmt::format("{}:{:02}:{:02}", whole / 3600, minutes, whole % 60)
                       : fmt::format("{}:{:02}", minutes, whole % 60);
}

std::optional<double> left_s(const Progress& progress) {
  if (!progress.duration_s || progress.state != Progress::State::measuring || progress.samples_wait)
    return {};
  return std::max(*progress.duration_s - progress.elapsed_s, 0.0);
}

std::string head_of(const Progress& progress) {
  if (progress.run.number == 0) return "no run yet\n";
  const auto& asked = progress.run.asked;
  auto text = fmt::format("run {}  {}", progress.run.number,
                          table::shortened(table::printable(asked.id), gate::longest_id));
  for (const auto& part : {asked.variant, asked.task.transport})
    if (!part.empty()) text += " " + table::printable(part);
  if (asked.repetition > 1) text += fmt::format(" ×{}", asked.repetition);
  if (!progress.samples_wait) {
    text += fmt::format("  {}", clock(progress.elapsed_s));
    if (progress.duration_s) text += " of " + clock(*progress.duration_s);
  } else {
    text += "  (measuring; its samples wait for the end, for ssh may take the link under test)";
  }
  if (const auto left = left_s(progress)) text += fmt::format(", {} left", clock(*left));
  const bool cut_off = progress.state == Progress::State::ended && !progress.run.outcome.has_ended();
  if (progress.state == Progress::State::waiting)
    text += progress.run.outcome.has_ended() ? "  (ended; the next has not begun)" : "  (not measuring yet)";
  else if (progress.state == Progress::State::ended)
    text += cut_off ? "  (cut off: no process writes into the file)" : "  (ended)";
  return text + "\n";
}

// The buckets from the first to the last that is not empty.
std::pair<std::size_t, std::size_t> filled(const Buckets& buckets) {
  const auto& counts = buckets.counts();
  const auto is_filled = [](std::uint64_t count) { return count > 0; };
  const auto first = std::find_if(counts.begin(), counts.end(), is_filled);
  const auto last = std::find_if(counts.rbegin(), counts.rend(), is_filled).base();
  return {static_cast<std::size_t>(first - counts.begin()), static_cast<std::size_t>(last - counts.begin())};
}

// As long as its logarithm, so that a single one is seen beside a million.
std::string bar(std::uint64_t count, std::uint64_t most) {
  constexpr double width = 40;
  const auto length = count == 0 ? 0.0
                                 : 1 + (width - 1) * std::log(static_cast<double>(count)) /
                                           std::max(std::log(static_cast<double>(most)), 1.0);
  std::string text;
  for (int i = 0; i < static_cast<int>(length); ++i) text += "█";
  return text;
}

std::string histogram_of(const Buckets& buckets) {
  const auto [first, end] = filled(buckets);
  const auto most = *std::max_element(buckets.counts().begin(), buckets.counts().end());
  std::string text;
  for (auto i = first; i < end; ++i) {
    const bool beyond = i + 1 == Buckets::size;
    text += fmt::format("{:>10} {:>10}  {}\n", beyond ? "more" : "≤ " + time_of(Buckets::upper_ns(i)),
                        buckets.counts()[i], bar(buckets.counts()[i], most));
  }
  return text;
}

double in_us(std::int64_t ns) { return static_cast<double>(ns) / 1e3; }

const char* word_of(Progress::State state) {
  switch (state) {
    case Progress::State::waiting:
      return "waiting";
    case Progress::State::measuring:
      return "measuring";
    case Progress::State::ended:
      break;
  }
  return "ended";
}

double mean_ns(const Buckets& buckets) { return buckets.sum_ns() / static_cast<double>(buckets.count()); }

template <class Value>
nlohmann::ordered_json or_null(bool is_known, Value value) {
  return is_known ? nlohmann::ordered_json(value) : nlohmann::ordered_json();
}

}  // namespace

std::string text_of(const Progress& progress) {
  auto text = head_of(progress);
  if (progress.sent == 0) return text;
  text += fmt::format("sent {}  on time {}  late {}  lost {}  skipped cycles {}\n", progress.sent,
                      progress.on_time, progress.late, progress.lost, progress.skipped_cycles);
  const auto& times = progress.round_trip;
  if (times.count() == 0) return text;
  text += fmt::format("round trip: min {}  mean {}  max {}\n", time_of(times.min_ns()),
                      gate::time_of(mean_ns(times)), time_of(times.max_ns()));
  text += histogram_of(times);
  for (const auto& worst : progress.worst)
    text += fmt::format("worst: response {} (round trip {}) at {:.2f} s, message {}\n",
                        time_of(worst.response_ns), time_of(worst.round_trip_ns), worst.at_s, worst.message);
  return text;
}

std::string json_of(const Progress& progress) {
  const auto& asked = progress.run.asked;
  const auto& times = progress.round_trip;
  nlohmann::ordered_json object = {{"state", word_of(progress.state)}};
  object["run"] = or_null(progress.run.number > 0, progress.run.number);
  for (const auto* key : {"id", "variant", "transport", "repetition"}) object[key] = asked.stated(key);
  object["samples_wait"] = progress.samples_wait;
  object["elapsed_s"] = or_null(!progress.samples_wait, progress.elapsed_s);
  object["duration_s"] = or_null(progress.duration_s.has_value(), progress.duration_s.value_or(0));
  const auto left = left_s(progress);
  object["left_s"] = or_null(left.has_value(), left.value_or(0));
  object["sent"] = progress.sent;
  object["on_time"] = progress.on_time;
  object["late"] = progress.late;
  object["lost"] = progress.lost;
  object["skipped_cycles"] = progress.skipped_cycles;
  object["round_trip_us"] = nullptr;
  if (times.count() > 0)
    object["round_trip_us"] = {{"min", in_us(times.min_ns())},
                               {"mean", std::round(mean_ns(times)) / 1e3},
                               {"max", in_us(times.max_ns())}};
  object["response_max_us"] = or_null(times.count() > 0, in_us(progress.response_max_ns));
  object["histogram"] = nlohmann::ordered_json::array();
  for (auto [i, end] = filled(times); i < end; ++i) {
    const bool beyond = i + 1 == Buckets::size;
    object["histogram"].push_back(
        {{"up_to_us", or_null(!beyond, in_us(Buckets::upper_ns(i)))}, {"count", times.counts()[i]}});
  }
  object["worst"] = nlohmann::ordered_json::array();
  for (const auto& worst : progress.worst)
    object["worst"].push_back({{"message", worst.message},
                               {"at_s", worst.at_s},
                               {"round_trip_us", in_us(worst.round_trip_ns)},
                               {"response_us", in_us(worst.response_ns)}});
  return object.dump(-1, ' ', true, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

std::string label(std::string_view name, std::string_view value) {
  std::string quoted;
  for (const char c : value) quoted += c == '\\' || c == '"' ? fmt::format("\\{}", c) : std::string(1, c);
  return fmt::format("{}=\"{}\"", name, quoted);
}

std::string metrics_of(const Progress& progress) {
  std::string text;
  const auto add = [&](const char* name, const char* type, const char* help) {
    text += fmt::format("# HELP ontime_{0} {2}\n# TYPE ontime_{0} {1}\n", name, type, help);
  };
  add("measuring", "gauge", "Whether a run is under way.");
  text += fmt::format("ontime_measuring {}\n", progress.state == Progress::State::measuring ? 1 : 0);
  if (progress.run.number == 0) return text;

  const auto& asked = progress.run.asked;
  auto run = fmt::format("run=\"{}\"", progress.run.number);
  for (const auto* key : {"id", "variant", "transport", "repetition"})
    run += "," + label(key, word(asked.stated(key)));
  add("messages_total", "counter", "Counted messages of the newest run, by what became of them.");
  // A counter never falls.
  const std::pair<const char*, std::uint64_t> fates[] = {
      {"on_time", progress.on_time}, {"late", progress.late}, {"lost", progress.lost_for_good}};
  for (const auto& [fate, count] : fates)
    text += fmt::format("ontime_messages_total{{{},fate=\"{}\"}} {}\n", run, fate, count);
  add("skipped_cycles_total", "counter", "Cycles that passed without a message.");
  text += fmt::format("ontime_skipped_cycles_total{{{}}} {}\n", run, progress.skipped_cycles);
  add("elapsed_seconds", "gauge", "From the first message to the newest.");
  text += fmt::format("ontime_elapsed_seconds{{{}}} {}\n", run, progress.elapsed_s);
  if (progress.duration_s) {
    add("duration_seconds", "gauge", "How long the run is to be.");
    text += fmt::format("ontime_duration_seconds{{{}}} {}\n", run, *progress.duration_s);
  }
  const auto& times = progress.round_trip;
  add("round_trip_max_seconds", "gauge", "The longest round trip of the run.");
  text +=
      fmt::format("ontime_round_trip_max_seconds{{{}}} {}\n", run, static_cast<double>(times.max_ns()) / 1e9);
  add("response_max_seconds", "gauge", "The longest time from when a message was due to its answer.");
  text += fmt::format("ontime_response_max_seconds{{{}}} {}\n", run,
                      static_cast<double>(progress.response_max_ns) / 1e9);
  add("round_trip_seconds", "histogram", "Round trips of the run.");
  std::uint64_t below = 0;
  for (std::size_t i = 0; i < Buckets::size; ++i) {
    below += times.counts()[i];
    const auto edge = i + 1 == Buckets::size
                          ? "+Inf"
                          : fmt::format("{:g}", static_cast<double>(Buckets::upper_ns(i)) / 1e9);
    text += fmt::format("ontime_round_trip_seconds_bucket{{{},le=\"{}\"}} {}\n", run, edge, below);
  }
  text +=
      fmt::format("ontime_round_trip_seconds_sum{{{0}}} {1}\nontime_round_trip_seconds_count{{{0}}} {2}\n",
                  run, times.sum_ns() / 1e9, times.count());
  return text;
}

}  // namespace ontime::watch

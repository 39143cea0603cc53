// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "gate/gate.hpp"
#include "statistics/statistics.hpp"
#include "table/table.hpp"
#include "watch/exposition.hpp"
#include "watch/watch.hpp"

namespace ontime::watch {
namespace {

using nlohmann::json;
using table::grouped;

std::string word(const json& value) {
  if (value.is_null()) return "";
  return value.is_string() ? value.get<std::string>()
                           : value.dump(-1, ' ', true, json::error_handler_t::replace);
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
  if (!progress.duration_s || progress.state != Progress::State::measuring || !progress.elapsed_s) return {};
  return std::max(*progress.duration_s - *progress.elapsed_s, 0.0);
}

const char* end_of(const record::Outcome& outcome) {
  return !outcome.has_ended()  ? "cut off: no process writes into the file"
         : outcome.interrupted ? "interrupted"
         : outcome.error       ? "failed"
                               : "ended";
}

std::string head_of(const Progress& progress) {
  if (progress.run.number == 0) return "no run yet\n";
  const auto& outcome = progress.run.outcome;
  const auto& asked = progress.run.asked;
  auto text = fmt::format("run {}  {}", progress.run.number,
                          table::shortened(table::printable(asked.id), gate::longest_id));
  for (const auto& part : {asked.variant, asked.task.transport})
    if (!part.empty()) text += " " + table::printable(part);
  if (asked.repetition > 1) text += fmt::format(" #{}", asked.repetition);
  if (progress.samples_wait)
    text += "  (measuring; samples come at the end, because ssh may use the link under test)";
  if (progress.elapsed_s) {
    // Back to back, a complete run's last answer came a little before its end.
    const bool is_complete = outcome.has_ended() && !outcome.interrupted && !outcome.error;
    text += "  " + clock(is_complete ? std::round(std::min(progress.measured_s,
                                                           progress.duration_s.value_or(progress.measured_s)))
                                     : *progress.elapsed_s);
    if (progress.duration_s) text += " of " + clock(*progress.duration_s);
  }
  if (const auto left = left_s(progress)) text += fmt::format(", {} left", clock(*left));
  if (progress.state == Progress::State::waiting)
    text += outcome.has_ended() ? fmt::format("  ({}; the next run has not started)", end_of(outcome))
                                : "  (not measuring yet)";
  else if (progress.state == Progress::State::ended)
    text += fmt::format("  ({})", end_of(outcome));
  else if (asked.keeps_worst())
    text += "  (flight recorder: counts are up to a minute old)";
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

// Logarithmic length, so that 1 is visible beside a million.
std::string bar(std::uint64_t count, std::uint64_t most) {
  constexpr double width = 40;
  const auto length = count == 0 ? 0.0
                                 : 1 + (width - 1) * std::log(static_cast<double>(count)) /
                                           std::max(std::log(static_cast<double>(most)), 1.0);
  return fmt::format("{:█<{}}", "", static_cast<int>(length));
}

std::string histogram_of(const Buckets& buckets) {
  const auto [first, end] = filled(buckets);
  const auto most = std::ranges::max(buckets.counts());
  std::string text;
  for (auto i = first; i < end; ++i) {
    const bool beyond = i + 1 == Buckets::size;
    text += fmt::format("{:>10} {:>10}  {}\n", beyond ? "more" : "≤ " + time_of(Buckets::upper_ns(i)),
                        grouped(buckets.counts()[i]), bar(buckets.counts()[i], most));
  }
  return text;
}

double in_us(std::int64_t ns) { return static_cast<double>(ns) / 1e3; }

const char* word_of(Progress::State state) {
  constexpr const char* words[] = {"waiting", "measuring", "ended"};
  return words[static_cast<std::size_t>(state)];
}

double mean_ns(const Buckets& buckets) { return buckets.sum_ns() / static_cast<double>(buckets.count()); }

template <class Value>
nlohmann::ordered_json or_null(bool is_known, Value value) {
  return is_known ? nlohmann::ordered_json(value) : nlohmann::ordered_json();
}

}  // namespace

std::string text_of(const Progress& progress) {
  auto text = head_of(progress);
  if (progress.sent == 0 && progress.skipped_cycles == 0) return text;
  const auto known = [](bool is_known, std::uint64_t count) { return is_known ? grouped(count) : "unknown"; };
  const bool late = statistics::knows_late(progress.run), lost = statistics::knows_loss(progress.run);
  text += fmt::format("sent {}  on time {}  late {}  lost {}  skipped cycles {}\n", grouped(progress.sent),
                      known(late && lost, progress.on_time), known(late, progress.late),
                      known(lost, progress.lost), grouped(progress.skipped_cycles));
  if (progress.unrecorded > 0)
    text += fmt::format("samples not recorded (missing below): {}\n", grouped(progress.unrecorded));
  const auto& times = progress.round_trip;
  const auto& asked = progress.run.asked;
  const auto measures = asked.is_listened() ? table::printable(asked.measures) : "round trip";
  if (times.count() > 0) {
    text += fmt::format("{}: min {}  mean {}  max {}   (bars: logarithmic)\n", measures,
                        time_of(times.min_ns()), gate::time_of(mean_ns(times)), time_of(times.max_ns()));
    text += histogram_of(times);
  }
  for (const auto& worst : progress.worst)
    text += !worst.message ? fmt::format("worst: response ≥ {} (no answer) at {:.2f} s\n",
                                         time_of(worst.response_ns), worst.at_s)
                           : fmt::format("worst: {}{}, message {}\n",
                                         asked.is_listened() ? measures + " " + time_of(worst.round_trip_ns)
                                                             : fmt::format("response {} (round trip {})",
                                                                           time_of(worst.response_ns),
                                                                           time_of(worst.round_trip_ns)),
                                         asked.keeps_worst() ? "" : fmt::format(" at {:.2f} s", worst.at_s),
                                         *worst.message);
  return text;
}

std::string json_of(const Progress& progress) {
  const auto& asked = progress.run.asked;
  const auto& times = progress.round_trip;
  nlohmann::ordered_json object = {{"state", word_of(progress.state)}};
  object["run"] = or_null(progress.run.number > 0, progress.run.number);
  for (const auto* key : {"id", "variant", "transport", "repetition"}) object[key] = asked.stated(key);
  object["samples_wait"] = progress.samples_wait;
  object["elapsed_s"] = or_null(progress.elapsed_s.has_value(), progress.elapsed_s.value_or(0));
  object["duration_s"] = or_null(progress.duration_s.has_value(), progress.duration_s.value_or(0));
  const auto left = left_s(progress);
  object["left_s"] = or_null(left.has_value(), left.value_or(0));
  object["sent"] = progress.sent;
  const bool late = statistics::knows_late(progress.run), lost = statistics::knows_loss(progress.run);
  object["on_time"] = or_null(late && lost, progress.on_time);
  object["late"] = or_null(late, progress.late);
  object["lost"] = or_null(lost, progress.lost);
  object["skipped_cycles"] = progress.skipped_cycles;
  object["dropped_records"] = progress.unrecorded;
  object["round_trip_us"] = nullptr;
  if (times.count() > 0)
    object["round_trip_us"] = {{"min", in_us(times.min_ns())},
                               {"mean", std::round(mean_ns(times)) / 1e3},
                               {"max", in_us(times.max_ns())}};
  object["response_max_us"] =
      or_null(progress.response_max_ns.has_value(), in_us(progress.response_max_ns.value_or(0)));
  object["histogram"] = nlohmann::ordered_json::array();
  for (auto [i, end] = filled(times); i < end; ++i) {
    const bool beyond = i + 1 == Buckets::size;
    object["histogram"].push_back(
        {{"up_to_us", or_null(!beyond, in_us(Buckets::upper_ns(i)))}, {"count", times.counts()[i]}});
  }
  object["worst"] = nlohmann::ordered_json::array();
  for (const auto& worst : progress.worst)
    object["worst"].push_back(
        {{"message", or_null(worst.message.has_value(), worst.message.value_or(0))},
         {"at_s", or_null(!asked.keeps_worst(), worst.at_s)},
         {"round_trip_us", or_null(worst.message.has_value(), in_us(worst.round_trip_ns))},
         {"response_us", in_us(worst.response_ns)}});
  return object.dump(-1, ' ', true, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

std::string metrics_of(const Progress& newest, const std::deque<Progress>& before) {
  Exposition text;
  text.begin("measuring", "gauge", "1 while a run is measured, else 0.");
  text.add("", newest.state == Progress::State::measuring ? 1 : 0);
  if (newest.run.number == 0) return std::move(text).text();

  std::vector<std::pair<std::string, const Progress*>> runs;
  const auto add_run = [&](const Progress& progress) {
    const auto value = [&](const char* key) { return word(progress.run.asked.stated(key)); };
    runs.emplace_back(labels({{"run", fmt::to_string(progress.run.number)},
                              {"id", value("id")},
                              {"variant", value("variant")},
                              {"transport", value("transport")},
                              {"repetition", value("repetition")}}),
                      &progress);
  };
  for (const auto& progress : before) add_run(progress);
  add_run(newest);
  const auto add = [&](const char* name, const char* type, const char* help, auto&& number_of) {
    bool has_begun = false;
    for (const auto& [run, progress] : runs)
      if (const auto number = number_of(*progress)) {
        if (!std::exchange(has_begun, true)) text.begin(name, type, help);
        text.add(run, *number);
      }
  };
  const auto in_s = [](std::int64_t ns) { return static_cast<double>(ns) / 1e9; };
  text.begin("messages_total", "counter", "Messages of a run, by outcome.");
  for (const auto& [run, progress] : runs) {
    const auto add_fate = [&text, &run = run](const char* fate, bool is_known, std::uint64_t count) {
      if (is_known) text.add(run + "," + labels({{"fate", fate}}), count);
    };
    const bool late = statistics::knows_late(progress->run), lost = statistics::knows_loss(progress->run);
    add_fate("on_time", late && lost, progress->on_time);
    add_fate("late", late, progress->late);
    add_fate("lost", lost, progress->lost_for_good);  // a counter never falls
  }
  add("skipped_cycles_total", "counter", "Cycles that passed without a message.",
      [](const Progress& of) { return std::optional(of.skipped_cycles); });
  add("elapsed_seconds", "gauge", "From the first message to the newest.",
      [](const Progress& of) { return of.elapsed_s; });
  add("duration_seconds", "gauge", "Requested duration of the run.",
      [](const Progress& of) { return of.duration_s; });
  add("round_trip_max_seconds", "gauge", "Longest round trip of the run.", [&](const Progress& of) {
    return of.round_trip.count() > 0 ? std::optional(in_s(of.round_trip.max_ns())) : std::nullopt;
  });
  add("response_max_seconds", "gauge",
      "Longest wait, also of a lost message: from the due time to the reply, or as long as is known.",
      [&](const Progress& of) {
        return of.worst.empty() ? std::nullopt : std::optional(in_s(of.worst.front().response_ns));
      });
  text.begin("round_trip_seconds", "histogram", "Round trips of the run.");
  for (const auto& [run, progress] : runs)
    text.add(run, listen::round_times_ns, progress->round_trip.counts(), progress->round_trip.sum_ns());
  return std::move(text).text();
}

}  // namespace ontime::watch

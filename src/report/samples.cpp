// SPDX-License-Identifier: Apache-2.0
#include <cstdlib>
#include <iterator>
#include <optional>

#include <fmt/format.h>

#include "gate/gate.hpp"
#include "report/report.hpp"
#include "report/words.hpp"
#include "statistics/statistics.hpp"

namespace ontime::report {
namespace {

using roundtrip::Fate;
using roundtrip::Sample;

constexpr std::size_t enough = 1 << 16;  // bytes, to be written at once

// The names of the columns, as the first line of CSV has them.
constexpr const char* sample_columns =
    "run,id,transport,repetition,message,fate,intended_ns,due_ns,woke_ns,sent_ns,received_ns,"
    "server_received_ns,server_sent_ns,skipped_cycles,passed_wake_ns,wake_up_us,round_trip_us,response_us,"
    "server_us,variant,component,complete,unfit";

// Why its numbers are not those that were requested, as far as no sample tells; empty: they are.
std::string unfit(const record::Run& run) {
  statistics::Summary without_samples;
  without_samples.run = run;
  without_samples.sent = 1;  // it has samples, or no line
  without_samples.has_worst_only = run.asked.keeps_worst() && run.outcome.has_ended();
  return gate::unfit(without_samples);
}

// A line of the file: its form is all that the formats differ in.
class Line {
 public:
  Line(SampleFormat format, const record::Run& run)
      : json_(format == SampleFormat::jsonl),
        has_cycles_(run.asked.task.client.schedule != roundtrip::Schedule::back_to_back) {
    std::vector<std::string> texts;
    for (const auto* key : {"id", "transport", "repetition"}) texts.push_back(text_of(run.asked.stated(key)));
    const auto number = std::to_string(run.number);
    if (json_)
      run_ = fmt::format(R"({{"run":{},"id":{},"transport":{},"repetition":{},"message":)", number, texts[0],
                         texts[1], texts[2]);
    else
      run_ = as_csv({number, texts[0], texts[1], texts[2]}, {});
    if (!json_) run_.back() = ',';
    const auto why = unfit(run);
    rest_ = {text_of(run.asked.stated("variant")), text_of(run.asked.stated("component")),
             statistics::is_complete(run) ? "true" : "false",
             text_of(why.empty() ? nlohmann::json() : nlohmann::json(why))};
    if (!json_) {
      auto line = as_csv(rest_, {});
      line.pop_back();
      rest_ = {line};
    }
  }

  void add(fmt::memory_buffer& out, const Sample& sample, std::int64_t start_ns) {
    const auto after_start = [&](std::int64_t ns) { return ns - start_ns; };
    std::optional<std::int64_t> received, round_trip, response, wake_up, server_received, server_sent, server;
    if (sample.fate != Fate::lost) {
      received = after_start(sample.received_ns);
      round_trip = sample.received_ns - sample.sent_ns;
      response = sample.received_ns - sample.intended_ns;
    }
    if (has_cycles_) wake_up = sample.woke_ns - sample.due_ns;
    if (sample.server_received_ns != 0) server_received = sample.server_received_ns;
    if (sample.server_sent_ns != 0) server_sent = sample.server_sent_ns;
    if (server_received && server_sent) server = *server_sent - *server_received;

    out.append(run_);
    fmt::format_to(std::back_inserter(out), "{}", sample.index);
    column_ = first_column;
    if (json_)
      fmt::format_to(std::back_inserter(out), R"(,"fate":"{}")", word_of(sample.fate));
    else
      fmt::format_to(std::back_inserter(out), ",{}", word_of(sample.fate));
    for (const auto ns : {sample.intended_ns, sample.due_ns, sample.woke_ns, sample.sent_ns})
      add(out, after_start(ns));
    for (const auto& ns : {received, server_received, server_sent}) add(out, ns);
    add(out, sample.skipped_cycles);
    add(out, sample.passed_wake_ns);
    for (const auto& ns : {wake_up, round_trip, response, server}) add_us(out, ns);
    for (const auto& text : rest_) {
      begin(out);
      out.append(text);
    }
    out.append(std::string_view(json_ ? "}\n" : "\n"));
  }

 private:
  static constexpr std::size_t first_column = 6;  // that is a number of this sample

  std::string text_of(const nlohmann::json& value) const {
    // As ASCII, as all our JSON.
    if (json_) return value.dump(-1, ' ', true, nlohmann::json::error_handler_t::replace);
    return value.is_null() ? "" : word(value);
  }

  void begin(fmt::memory_buffer& out) {
    if (json_)
      fmt::format_to(std::back_inserter(out), R"(,"{}":)", columns_[column_++]);
    else
      out.push_back(',');
  }
  void add(fmt::memory_buffer& out, const std::optional<std::int64_t>& value) {
    begin(out);
    if (value)
      fmt::format_to(std::back_inserter(out), "{}", *value);
    else
      add_nothing(out);
  }
  void add_us(fmt::memory_buffer& out, const std::optional<std::int64_t>& ns) {
    begin(out);
    if (ns)
      fmt::format_to(std::back_inserter(out), "{}{}.{:03}", *ns < 0 ? "-" : "", std::abs(*ns) / 1000,
                     std::abs(*ns) % 1000);
    else
      add_nothing(out);
  }
  void add_nothing(fmt::memory_buffer& out) const {
    if (json_) out.append(std::string_view("null"));
  }

  const std::vector<std::string> columns_ = split(sample_columns, ',');
  const bool json_, has_cycles_;
  std::string run_;                // what all lines of a run begin with
  std::vector<std::string> rest_;  // and what they end with
  std::size_t column_ = first_column;
};

}  // namespace

void export_samples(const record::Reader& reader, const std::vector<record::Run>& runs, SampleFormat format,
                    const std::function<void(std::string_view)>& write) {
  fmt::memory_buffer out;
  const auto hand_over = [&] {
    write({out.data(), out.size()});
    out.clear();
  };
  if (format == SampleFormat::csv) fmt::format_to(std::back_inserter(out), "{}\n", sample_columns);
  for (const auto& run : runs) {
    Line line(format, run);
    auto start_ns = run.start_ns;
    reader.each_sample(run.number, [&](const Sample& sample) {
      if (!start_ns) start_ns = sample.intended_ns;
      line.add(out, sample, *start_ns);
      if (out.size() >= enough) hand_over();
    });
  }
  hand_over();
}

}  // namespace ontime::report

// SPDX-License-Identifier: Apache-2.0
// What people and programs read: the paper's table with percentiles added, JSON, CSV, Markdown, LaTeX,
// HTML.
// Ordinary thread; returns text, prints nothing.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "explain/explain.hpp"
#include "gate/gate.hpp"
#include "report/answer.hpp"
#include "statistics/statistics.hpp"

namespace ontime::report {

enum class Format { table, json, csv, markdown, latex, html };
std::optional<Format> format_of(const std::string& word);

// Every table of all runs, one row a run; as HTML the tables alone. docs/reference/json.md describes the
// JSON; it is stable. `width`: of a terminal, for Format::table.
std::string render(const std::vector<statistics::Summary>&, Format, const Origin& = {},
                   std::size_t width = 100);
// The first screen instead, where the form is Format::table.
std::string render_answer(const std::vector<statistics::Summary>&, Format, const Origin&, std::size_t width);
// The threads of each run as the kernel said they were: policy, priority, affinity, faults, switches.
std::string render_threads(const std::vector<statistics::Summary>&, Format, std::size_t width = 100);

// What an end requested of its machine and was denied, for people; alike ones together.
std::vector<std::string> refusals_of(const record::Host& end);

// The page: verdict, table, figures of every message, settings. One file that opens anywhere; it reads the
// samples once more. `name` is what the page is of, such as the results file's name.
std::string render_html(const record::Reader&, const std::vector<statistics::Summary>&,
                        const std::string& name);

// A figure for a paper: of one column's width, or `wide`, of both. Letters are of 7 pt at that size.
struct Plot {
  enum class Figure { time, ccdf, conditions, payload, neighbours } figure = Figure::time;
  enum class Form { svg, pdf, png } form = Form::svg;
  bool wide = false;
};
// The commands for gnuplot, which writes the figure to its standard output. Of runs that were measured; of a
// long one the extremes of as many stretches of time as can be told apart are drawn, so that none is missing.
std::string gnuplot_of(const std::vector<statistics::Summary>&, const Plot&);

// What each layer costs a message, of runs that say what they add to: a waterfall.
std::string render_layers(const std::vector<statistics::Summary>&, Format, std::size_t width = 100);

// Runs set side by side: those of A and of B that have the same key, repetitions together, in A's order. It
// points into what was given.
struct Comparison {
  using Runs = std::vector<const statistics::Summary*>;
  struct Pair {
    Runs from, to;
  };
  std::vector<Pair> pairs;
  std::vector<Runs> only_from, only_to;  // those without a partner
};
Comparison compare(const std::vector<statistics::Summary>& a, const std::vector<statistics::Summary>& b);
// Of runs that were chosen, whose keys differ: those whose conditions are the same in transports, options,
// what receives and what tells variants apart; or, if either side has only one kind, that.
Comparison compare_chosen(const std::vector<statistics::Summary>& a,
                          const std::vector<statistics::Summary>& b);
// Of runs of one suite: those with the value `from` of a scenario's key (such as "kernel.threaded-napi")
// against those with the value `to`, all else alike.
Comparison compare_by(const std::vector<statistics::Summary>&, const std::string& key,
                      const std::string& from, const std::string& to);
// The values that runs have of it, in the order of the runs; `unset` of those that have none.
inline constexpr const char* unset = "unset";
std::vector<std::string> values_of(const std::vector<statistics::Summary>&, const std::string& key);
// B / A of each metric with its interval, as a figure for a paper. Empty: there is nothing to compare.
std::string gnuplot_of(const Comparison&, const Plot&);
// Each metric, how much it changed and the interval of the change; what else differs between the two sides;
// and what has no partner.
std::string render(const Comparison&, const std::vector<gate::Judgement>&, Format, std::size_t width = 100);

// Why messages of a run were late or lost; as table, Markdown or JSON.
struct Explained {
  record::Run run;
  explain::Account account;
};
std::string render_explained(const std::vector<Explained>&, Format);
// All of one message's delay.
std::string render_explained(const Explained&, const explain::Message&, Format);

// What was seen around these messages of a run, for ui.perfetto.dev and chrome://tracing.
std::string perfetto_of(const record::Reader&, const record::Run&, const std::vector<explain::Message>&,
                        const explain::Pong* = nullptr);

// What gates came to, for a CI: JUnit's XML as Jenkins, GitLab and GitHub's actions read it. What was missed
// is a failure, what could not be judged an error.
std::string junit(const std::vector<gate::Judgement>&);

// Every sample of these runs, a line each, in order of run and message; docs/reference/results-file.md names
// the columns. `write` is given pieces of the text: memory does not grow with the number of samples.
enum class SampleFormat { csv, jsonl };
std::optional<SampleFormat> sample_format_of(const std::string& word);
void export_samples(const record::Reader&, const std::vector<record::Run>&, SampleFormat,
                    const std::function<void(std::string_view)>& write);

}  // namespace ontime::report

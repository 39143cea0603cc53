// SPDX-License-Identifier: Apache-2.0
#include "page/page.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "page/parts.hpp"
#include "report/conditions.hpp"
#include "report/paper.hpp"
#include "report/runs.hpp"
#include "report/words.hpp"
#include "table/table.hpp"

namespace ontime::page {
namespace {

using nlohmann::json;

// Runs of an id as the page names them, in its order: figures_of() has the same.
struct Shown {
  explicit Shown(const Group& group) : runs(group), labels(labels_apart(group)) {}
  Group runs;
  std::vector<std::string> labels;
};

std::string heading_of(const Summary& summary) {
  const auto title = word(summary.run.asked.title);
  const auto id = id_of(summary.run.asked);
  return title == nothing ? id : id + " · " + title;
}

// The exact value for programs, rounded as in JSON; `shown`, as in the tables, for users.
std::string time_cell(const std::string& shown, double ns, const char* name) {
  if (shown == nothing) return "<td class=\"number\">–</td>";
  return fmt::format("<td class=\"number\"><data data-figure=\"{}\" value=\"{:.3f}\">{}</data></td>", name,
                     std::round(ns) / 1e3, escaped(shown));
}

std::string count_cell(std::uint64_t count, const char* name, bool is_fault) {
  return fmt::format("<td class=\"number{}\"><data data-figure=\"{}\" value=\"{}\">{}</data></td>",
                     is_fault && count > 0 ? " fault" : "", name, count, grouped(count));
}

std::string against_deadline(const Summary& summary) {
  const auto deadline_ns = summary.run.asked.task.client.deadline.count();
  if (deadline_ns <= 0 || summary.round_trip.count == 0) return "–";
  const auto share = static_cast<double>(summary.round_trip.max) / static_cast<double>(deadline_ns);
  return share < 1 ? percent(share) + " %" : fmt::format("{:.1f} ×", share);
}

constexpr const char* unknown = "<td class=\"number\">–</td>";

std::string row_of(const Summary& summary, const std::string& label, std::size_t figure, bool by_response) {
  const auto& of = summary.round_trip;
  const auto time = [&](double ns, const char* name) {
    return time_cell(of.count == 0 ? nothing : microseconds(ns), ns, name);
  };
  const auto quantile = [&](Figure metric) {
    return time_cell(percentile(of, metric), static_cast<double>(of[metric]),
                     statistics::metric_of(metric).name);
  };
  return fmt::format("<tr data-run=\"{}\"><th scope=\"row\"><a href=\"#run-{}\">{}</a></th>",
                     summary.run.number, figure, escaped(label)) +
         count_cell(summary.sent, "sent", false) +
         (statistics::knows_late(summary.run) ? count_cell(summary.late, "late", true) : unknown) +
         (!by_response                ? ""
          : !summary.late_by_response ? unknown
                                      : count_cell(*summary.late_by_response, "late_by_response", true)) +
         (statistics::knows_loss(summary.run) ? count_cell(summary.lost, "lost", true) : unknown) +
         time(static_cast<double>(of.min), "min") + time(of.mean, "mean") + quantile(Figure::p50) +
         quantile(Figure::p99) + quantile(Figure::p99_9) + time(static_cast<double>(of.max), "max") +
         fmt::format("<td class=\"number\">{}</td><td class=\"range\" data-figure-of=\"{}\"></td></tr>\n",
                     against_deadline(summary), figure);
}

constexpr const char* table_head = R"(<div class="wide" tabindex="0" role="region" aria-label="All runs">
<table class="runs">
<caption>Times in µs</caption>
<thead><tr><th scope="col">Run</th><th scope="col" class="number">Sent</th><th scope="col" class="number">Late</th>
{}<th scope="col" class="number">Lost</th><th scope="col" class="number">Min</th><th scope="col" class="number">Mean</th>
<th scope="col" class="number">p50</th><th scope="col" class="number">p99</th><th scope="col" class="number">p99.9</th>
<th scope="col" class="number">Max</th><th scope="col" class="number">Max to deadline</th>
<th scope="col" class="range">Min to max, p50, p99</th></tr></thead>
)";

// The paper's values beside it.
std::string row_of(const PaperRow& paper, bool by_response) {
  const auto us = [](const auto& value) {
    return fmt::format("<td class=\"number\">{}</td>", microseconds(static_cast<double>(value) * 1e3));
  };
  const auto number = [](std::uint64_t value) {
    return fmt::format("<td class=\"number\">{}</td>", grouped(value));
  };
  return fmt::format("<tr class=\"paper\"><th scope=\"row\">paper’s {}</th>", escaped(paper.dds)) +
         number(paper.messages) + number(paper.missed_deadlines) + (by_response ? unknown : "") +
         number(paper.lost) + us(paper.min_us) + us(paper.avg_us) + unknown + unknown + unknown +
         us(paper.max_us) + unknown + "<td></td></tr>\n";
}

std::string table_of(const std::vector<Shown>& groups, bool by_response) {
  auto text = fmt::format(
      table_head, by_response ? "<th scope=\"col\" class=\"number\">Late by response time</th>\n" : "");
  std::size_t figure = 0;
  for (const auto& group : groups) {
    text += fmt::format("<tbody>\n<tr><th scope=\"rowgroup\" colspan=\"{}\"><span>{}</span></th></tr>\n",
                        by_response ? 13 : 12, escaped(heading_of(*group.runs.front())));
    for (std::size_t i = 0; i < group.runs.size(); ++i)
      text += row_of(*group.runs[i], group.labels[i], figure++, by_response);
    for (const auto& paper : paper_rows(group.runs.front()->run.asked)) text += row_of(paper, by_response);
    text += "</tbody>\n";
  }
  return text + "</table>\n</div>\n";
}

// The longest waits, stage by stage.
Table worst_of(const Shown& group) {
  Table table{.title = "Longest waits (µs)",
              .columns = columns_of(
                  "Run", {"Message", "At (s)", "Wait", "Wake-up latency", "Wake-up to send", "Round trip"})};
  constexpr std::size_t most = 5;  // of a run
  for (std::size_t run = 0; run < group.runs.size(); ++run) {
    const auto& worst = group.runs[run]->shape.worst;
    const auto& summary = *group.runs[run];
    if (!worst.empty() && table.notes.empty() &&
        worst.front().took_ns < std::max({summary.response.max, summary.lost_wait_ns, summary.open_wait_ns}))
      table.notes.emplace_back(
          "Wait: from when the message before was answered, if that was later than the message was due. So a "
          "cycle's worst wait can be longer.");
    for (std::size_t i = 0; i < std::min(most, worst.size()); ++i) {
      const auto& message = worst[i].message;
      table.rows.push_back({group.labels[run], fmt::format("{}", message.index),
                            fmt::format("{:.3f}", seconds_into(*group.runs[run], message.due_ns)),
                            microseconds(worst[i].took_ns),
                            microseconds(roundtrip::wake_up_latency_ns(message)),
                            microseconds(message.sent_ns - message.woke_ns),
                            microseconds(message.received_ns - message.sent_ns)});
    }
  }
  return table;
}

// Where the time goes, of the median and of the slowest.
Table parts_of(const Shown& group) {
  Table table{.title = "Where the time goes (µs): median / p99 / max",
              .columns = columns_of("Run", {"Wake-up latency"})};
  const bool any_parts =
      std::ranges::any_of(group.runs, [](const auto* run) { return run->parts.has_value(); });
  if (any_parts) table.columns.push_back({"Request leg"});
  table.columns.push_back({"Server turnaround"});
  if (any_parts) table.columns.push_back({"Reply leg"});
  table.columns.push_back({"Response time"});
  const auto cell = [](const statistics::Distribution& of) {
    if (of.count == 0) return std::string(nothing);
    return percentile(of, Figure::p50) + " / " + percentile(of, Figure::p99) + " / " + microseconds(of.max);
  };
  for (std::size_t i = 0; i < group.runs.size(); ++i) {
    const auto& summary = *group.runs[i];
    std::vector<std::string> row = {group.labels[i], cell(summary.wake_up)};
    const auto parts = summary.parts.value_or(statistics::Parts{});
    if (any_parts) row.push_back(cell(parts.there));
    row.push_back(cell(summary.server));
    if (any_parts) row.push_back(cell(parts.back));
    row.push_back(cell(summary.response));
    table.rows.push_back(row);
  }
  table.notes.emplace_back(
      "Wake-up latency: from when a message was due until its sender ran. Response time: from when a cycle "
      "was due until its answer came, including cycles without a message (corrected for coordinated "
      "omission).");
  return table;
}

std::string details(const std::string& summary, const std::string& content, bool open = false) {
  return std::string(open ? "<details open" : "<details") + "><summary>" + escaped(summary) + "</summary>\n" +
         content + "</details>\n";
}

std::string time_figure(const Summary& run, const std::string& label, std::size_t figure) {
  const auto& of = run.round_trip;
  auto text = many(run.sent, "message", "messages");
  if (statistics::knows_late(run.run)) text += fmt::format(", {} late", grouped(run.late));
  if (statistics::knows_loss(run.run)) text += fmt::format(", {} lost", grouped(run.lost));
  if (differs_by_response(run))
    text += fmt::format(", {} not in time", many(*run.late_by_response, "cycle", "cycles"));
  if (of.count > 0)
    text += fmt::format("; {} to {} µs, median {}", microseconds(of.min), microseconds(of.max),
                        microseconds(of[Figure::p50]));
  auto html = fmt::format(
      "<figure class=\"time\" id=\"run-{0}\" data-figure-of=\"{0}\">\n<figcaption "
      "id=\"caption-{0}\"><b>{1}</b> <span>{2}</span></figcaption>\n</figure>\n",
      figure, escaped(label), escaped(text));
  if (const auto remark = remarks(run); !remark.empty()) html += note_as_html(label + ": " + remark);
  return html;
}

constexpr const char* time_plot_key =
    R"(<p class="note key">In the plots over time: <span class="column">┃</span>from the fastest to the slowest message
<span class="late">●</span>late <span class="lost">×</span>lost (at the top) <span class="limit">╌</span>deadline <span
class="middle">─</span>median <span class="stall">━</span>longest wait of cycles without a message
<span>⚑</span>note</p>
)";

// What the table's columns mean.
std::string table_legend(const Summaries& summaries) {
  auto legend = all_listened(all_of(summaries))
                    ? "Late: beyond the limit. Lost: published and never taken."
                    : fmt::format("Late: answered after the {}. Lost: not answered within the {}.",
                                  limit_of(summaries, "deadline", &roundtrip::ClientOptions::deadline),
                                  limit_of(summaries, "time-out", &roundtrip::ClientOptions::timeout));
  if (std::ranges::any_of(summaries, differs_by_response))
    legend += " Late by response time: cycles without an answer within the deadline after they were due.";
  if (!all_listened(all_of(summaries)))
    legend += " Missed (%): cycles without an answer in time, of all cycles.";
  legend += " p99: 99 % of the messages took no longer. ~: fewer than 10 messages were slower. –: not known.";
  if (any_of_paper(summaries)) legend += " " + replace_all(paper_legend, "'", "’");
  return legend;
}

// Drawings of messages: as many as a browser can load.
constexpr std::size_t most_drawings = 60, most_drawings_of_a_run = 6;
struct Drawings {
  std::vector<json> drawn;
  std::size_t of_a_run = 0;
};

std::string list_of(std::size_t first, std::size_t count) {
  std::vector<std::string> numbers;
  for (std::size_t i = first; i < first + count; ++i) numbers.push_back(fmt::format("{}", i));
  return join(numbers, " ");
}

// Of each run that was measured with `explain: on`.
std::string whys_of(const record::Reader& reader, const std::string& file, const Shown& group,
                    Drawings& drawings) {
  std::string html;
  for (std::size_t i = 0; i < group.runs.size(); ++i) {
    auto why = why_of(reader, group.runs[i]->run, file, drawings.drawn.size(),
                      std::min(drawings.of_a_run, most_drawings - drawings.drawn.size()));
    if (why.html.empty()) continue;
    html +=
        fmt::format("<div class=\"why\">\n<h3>Why: {}</h3>\n{}</div>\n", escaped(group.labels[i]), why.html);
    for (auto& drawing : why.drawings) drawings.drawn.push_back(std::move(drawing));
  }
  return html;
}

std::string section_of(const record::Reader& reader, const std::string& file, const Shown& shown,
                       std::size_t first, Drawings& drawings) {
  const auto& [group, labels] = shown;
  auto html = fmt::format("<section>\n<h2>{}</h2>\n<p>{}</p>\n", escaped(heading_of(*group.front())),
                          escaped(join(shared_conditions(group), ", ")));
  for (std::size_t i = 0; i < group.size(); ++i) html += time_figure(*group[i], labels[i], first + i);
  html += whys_of(reader, file, shown, drawings);
  html += fmt::format(
      "<div class=\"pair\">\n<figure class=\"ccdf\" data-figures-of=\"{0}\">\n<figcaption><b>Exceedance "
      "(CCDF)</b> <span>share of messages slower than x; a lost message counts as "
      "slowest</span></figcaption>\n</figure>\n"
      "<figure class=\"histogram\" data-figures-of=\"{0}\">\n<figcaption><b>Distribution</b> <span>answered "
      "messages per bin; 16 equal bins to each doubling of the round "
      "trip</span></figcaption>\n</figure>\n</div>\n",
      list_of(first, group.size()));
  auto worst = worst_case_table(labels, group);
  worst.title = "Slowest: seen and extrapolated";
  if (!worst.rows.empty()) html += details("Extrapolated worst case", as_html(worst), true);
  for (const auto& note : unbounded_notes(labels, group)) html += note_as_html(note);
  if (auto sure = certainty_table(labels, group); !sure.rows.empty()) {
    sure.title = "95 % confidence intervals";
    html += details("Confidence intervals", as_html(sure));
  }
  if (!all_listened(group)) html += details("Where the time goes", as_html(parts_of(shown)));
  html += details("Longest waits", as_html(worst_of(shown)));
  return html + "</section>\n";
}

std::string comparing_figures(const Summaries& summaries, std::size_t groups) {
  std::string html;
  const auto all = list_of(0, summaries.size());
  if (groups > 1)
    html += fmt::format(
        "<figure class=\"ccdf\" data-figures-of=\"{}\" data-names=\"whole\">\n<figcaption><b>Exceedance "
        "(CCDF)</b> <span>share of messages slower than x, of all runs</span></figcaption>\n</figure>\n",
        all);
  const auto payload_of = [](const Summary& summary) { return summary.run.asked.task.client.payload_bytes; };
  if (std::ranges::any_of(summaries,
                          [&](const auto& one) { return payload_of(one) != payload_of(summaries.front()); }))
    html += fmt::format(
        "<figure class=\"payload\" data-figures-of=\"{}\">\n<figcaption><b>Round trip against payload</b> "
        "<span>p50 and p99 of the answered messages</span></figcaption>\n</figure>\n",
        all);
  const auto layers = layers_page_of(summaries);
  if (!layers.tables.empty()) {
    html +=
        "<figure class=\"layers\">\n<figcaption><b>What each layer costs</b> <span>round trip of the median "
        "message; filled: what the layer adds</span></figcaption>\n</figure>\n";
    for (const auto& table : layers.tables) html += details(table.title, as_html(table));
  }
  return html.empty() ? "" : "<section>\n<h2>Side by side</h2>\n" + html + "</section>\n";
}

// Imported histograms of another tool have no messages and no time axis.
std::string imported_section_of(const Summaries& imported) {
  std::string html = "<section>\n<h2>Imported</h2>\n";
  for (const auto& group : by_id(imported)) html += as_html(imported_table_of(group));
  return html + details("The machines", as_html(machines_of(imported))) + "</section>\n";
}

std::string settings_of(const Summaries& summaries) {
  std::string html = "<section>\n<h2>Conditions: requested and found</h2>\n";
  const auto differences = differences_of(summaries);
  html += differences.columns.size() > 1 ? as_html(differences)
                                         : "<p>" + escaped(differences.conditions) + "</p>\n";
  for (const auto& refusal : refusals(summaries)) html += note_as_html(refusal);
  html += details("Load: requested and achieved", as_html(loads_of(summaries)));
  std::string threads;
  for (const auto& table : threads_page_of(summaries).tables) threads += as_html(table);
  if (!threads.empty()) html += details("Threads, as the kernel reports them", threads);
  html += details("The machines", as_html(machines_of(summaries)));
  return html + "</section>\n";
}

const char* class_of(Verdict::Word word) {
  return word == Verdict::Word::yes ? "yes" : word == Verdict::Word::no ? "no" : "partly";
}

// The first screen's sentence and commands, and each condition by itself.
std::string headline_of(const Summaries& measured, bool any_imported, const Origin& origin) {
  const auto verdict = verdict_of(measured);
  if (measured.empty())
    return fmt::format(
        "<h1 class=\"{}\">{}</h1>\n", class_of(verdict.word),
        any_imported ? "No messages were measured; all data are imported." : escaped(verdict.sentence));
  const auto answer = answer_of(measured, origin);
  auto html = fmt::format("<h1 class=\"{}\">{}</h1>\n", class_of(verdict.word), escaped(answer.sentence));
  const auto groups = by_id(measured);
  if (groups.size() < 2) {
    html += fmt::format("<p>{}</p>\n", escaped(verdict.further));
  } else {
    html += "<ul class=\"answers\">\n";
    for (const auto& group : groups) {
      Summaries runs;
      for (const auto* run : group) runs.push_back(*run);
      const auto own = verdict_of(runs);
      html += fmt::format("<li class=\"{}\"><b>{}</b> {} {}</li>\n", class_of(own.word),
                          escaped(heading_of(runs.front())), escaped(own.sentence), escaped(own.further));
    }
    html += "</ul>\n";
  }
  html += "<dl class=\"next\">\n";
  for (const auto& step : answer.next)
    html += fmt::format("<dt>{}</dt><dd><code>{}</code></dd>\n", escaped(step.why), escaped(step.command));
  return html + "</dl>\n";
}

// Escaped, so that no text within can end the element.
std::string data_element(const json& data) {
  const auto text = data.dump(-1, ' ', true, json::error_handler_t::replace);
  return "<script type=\"application/json\" id=\"data\">" + replace_all(text, "<", "\\u003c") + "</script>\n";
}

}  // namespace

std::string page_of(const record::Reader& reader, const Summaries& summaries, const report::Origin& origin) {
  const auto& name = origin.file;
  Summaries measured, imported;
  for (const auto& summary : summaries) (summary.imported ? imported : measured).push_back(summary);
  auto body = fmt::format("<header>\n<p class=\"brand\">ontime <span>{}</span></p>\n{}</header>\n<main>\n",
                          escaped(name), headline_of(measured, !imported.empty(), origin));
  Drawings drawings;
  if (!measured.empty()) {
    const auto by_ids = by_id(measured);
    const std::vector<Shown> groups(by_ids.begin(), by_ids.end());
    body += table_of(groups, std::ranges::any_of(measured, differs_by_response));
    body += note_as_html(table_legend(measured));
    if (const auto when = when_of(measured); !when.empty()) body += note_as_html(when);
    body +=
        "<noscript><p class=\"note\">The figures need JavaScript, which is off. The tables do "
        "not.</p></noscript>\n";
    body += time_plot_key;
    std::size_t first = 0;
    drawings.of_a_run = std::clamp<std::size_t>(most_drawings / measured.size(), 1, most_drawings_of_a_run);
    for (const auto& group : groups) {
      body += section_of(reader, name, group, first, drawings);
      first += group.runs.size();
    }
    body += comparing_figures(measured, groups.size()) + settings_of(measured);
  }
  if (!imported.empty()) body += imported_section_of(imported);
  body += "</main>\n<footer><p>Made by ontime " ONTIME_VERSION
          " from the results file, which has every sample. Figures: D3; its licence is in this file's "
          "source.</p></footer>\n";
  auto data = figures_of(reader, measured);
  data["drawings"] = drawings.drawn;
  data["source"] = {{"file", printable(name)}, {"ontime", ONTIME_VERSION}};
  body += data_element(data) + fmt::format("<!--\n{}-->\n", web::d3_licence);
  return table::standing_alone(name + " · ontime", body,
                               {web::d3, web::course, web::figures, web::way, web::time_plot});
}

}  // namespace ontime::page

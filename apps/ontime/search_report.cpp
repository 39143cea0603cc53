// SPDX-License-Identifier: Apache-2.0
#include "search_report.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "report/words.hpp"
#include "table/table.hpp"

namespace ontime::app {
namespace {

using nlohmann::ordered_json;
using search::Decision, search::End, search::Trial;
using table::escaped;
using table::printable;
using Purpose = Trial::Purpose;

constexpr std::size_t most_causes = 3, most_name = 60;

std::string answer_of(const SearchReport& report) {
  switch (report.outcome.end) {
    case End::goal_holds:
      return report.outcome.set.empty() ? "the goal holds without changes" : "the goal holds";
    case End::not_proven:
      return "not proven: too few messages to tell whether it holds. Use longer runs or an easier goal";
    case End::nothing_left:
      return "the goal does not hold, and no setting is left to try";
    case End::no_time:
      return "stopped: " + report.stopped;
    case End::cannot_measure:
      return "cannot measure: " + report.outcome.why;
  }
  return "";
}

// A rest of rounding is 0.
std::string percent(double share) { return std::abs(share) < 1e-9 ? "0" : table::percent(share, 3); }

// A limit on response times counts cycles, also those without a message.
const char* unit_of(const search::Limit& limit) {
  return limit.text.starts_with("response") ? "cycles" : "messages";
}

// "p99.9 < 1 ms: 3 of 24000 messages break it, 95 % confidence interval [0.001, 0.06] %"; where the goal
// holds, on a second line the one-sided limit of the proof: "proven: less than 0.09 % (goal: 0.1 %), if they
// come in bursts of up to 5".
std::string share_text(const search::Limit& limit, const search::Share& share, const search::Proof* proof) {
  auto text = fmt::format("{}: {} of {} {} break it", limit.text,
                          table::grouped(static_cast<std::uint64_t>(share.events)),
                          table::grouped(static_cast<std::uint64_t>(share.messages)), unit_of(limit));
  if (proof == nullptr)
    return text + fmt::format(", 95 % confidence interval [{}, {}] %", percent(share.range.low),
                              percent(share.range.high));
  text += fmt::format("\n    proven: less than {} % ({}: {} %)", percent(report::rounded_up(proof->below)),
                      limit.share > 0 ? "goal" : "one burst in each run would be", percent(proof->permitted));
  if (limit.share > 0)
    text += proof->burst < 2
                ? ", if they come one by one"
                : fmt::format(", if they come in bursts of up to {:.0f}", std::floor(proof->burst));
  return text;
}

// The last runs of the set that was found.
const Trial* last_of(const search::Outcome& outcome) {
  const auto found = std::find_if(outcome.trials.rbegin(), outcome.trials.rend(), [&](const Trial& trial) {
    return trial.set == outcome.set && !trial.shares.empty();
  });
  return found == outcome.trials.rend() ? nullptr : &*found;
}

std::string contribution_text(const search::Problem& problem, const search::Contribution& one) {
  std::vector<std::string> parts;
  for (std::size_t limit = 0; limit < problem.goal.size() && limit < one.less.size(); ++limit)
    parts.push_back(fmt::format("{} {} break {} ([{}, {}] % of all)",
                                one.less[limit].low > 0 ? "more" : "not proven that more",
                                unit_of(problem.goal[limit]), problem.goal[limit].text,
                                percent(one.less[limit].low), percent(one.less[limit].high)));
  return fmt::format("without it, {}{}", fmt::join(parts, ", "),
                     one.is_needed ? "" : "; not proven to be needed");
}

// Settings that trials of this purpose and decision added or removed, without those that the search kept.
std::vector<std::string> not_kept(const search::Outcome& outcome, Purpose purpose, Decision decision) {
  std::vector<std::string> all;
  for (const auto& trial : outcome.trials) {
    if (trial.purpose != purpose || trial.decision != decision) continue;
    const auto &more = purpose == Purpose::add ? trial.set : trial.reference,
               &fewer = purpose == Purpose::add ? trial.reference : trial.set;
    search::Set settings;
    std::set_difference(more.begin(), more.end(), fewer.begin(), fewer.end(),
                        std::inserter(settings, settings.end()));
    const bool is_one = settings.size() == 1;
    if (is_one && std::includes(outcome.set.begin(), outcome.set.end(), settings.begin(), settings.end()))
      continue;
    report::add_once(all, is_one ? words_of(settings) : fmt::format("{} settings together", settings.size()));
  }
  return all;
}

// Why settings were refused, each reason once.
std::vector<std::string> refusals(const search::Outcome& outcome) {
  std::vector<std::string> all;
  for (const auto& trial : outcome.trials)
    if (trial.decision == Decision::refused) report::add_once(all, trial.why);
  return all;
}

std::string list(const char* title, const std::vector<std::string>& words) {
  return words.empty() ? "" : fmt::format("\n{}: {}\n", title, fmt::join(words, "; "));
}

// Titles, and text to paste. The results file may be another user's.
std::vector<std::pair<std::string, std::string>> how_to_keep(const search::Kept& kept) {
  std::vector<std::pair<std::string, std::string>> parts;
  if (!kept.scenario.empty())
    parts.emplace_back(fmt::format("In run {} of the scenario (replace keys that it already has)",
                                   table::shortened(printable(kept.run), most_name)),
                       kept.scenario);
  for (const auto& unit : kept.units) {
    const auto where = unit.host.empty() ? "on each machine" : "on the " + unit.host;
    if (unit.why_not.empty())
      parts.emplace_back(fmt::format("At every boot, {} ({})", where, unit.command), unit.text);
    else
      parts.emplace_back(fmt::format("At every boot, {}", where),
                         fmt::format("{}\n{}\n", unit.command, unit.why_not));
  }
  if (!kept.fill_in.empty()) parts.emplace_back("To fill in", kept.fill_in + "\n");
  if (!kept.left_out.empty()) parts.emplace_back("Not set at boot", kept.left_out + "\n");
  return parts;
}

std::string simulated_text(const SearchReport& report) {
  return fmt::format("SIMULATED by {}: compares settings, predicts no real machine's times",
                     report.simulated);
}

const char* purpose_words(Purpose purpose) {
  constexpr const char* words[] = {"measured alone", "added", "removed", "measured again"};
  return words[static_cast<std::size_t>(purpose)];
}

// ── The picture: one row a trial, one column a limit; the share that broke it, on a logarithmic scale.

// As wide as a page in a window of 1000 px, with up to five limits.
constexpr double row_px = 26, label_px = 330, gap_px = 30, columns_px = 600, top_px = 34, least_share = 1e-6;

struct Columns {
  double px;  // of each
  double x_of(double share, std::size_t column) const {
    const auto decades = std::log10(std::clamp(share, least_share, 1.0) / least_share);
    return label_px + static_cast<double>(column) * (px + gap_px) + decades / -std::log10(least_share) * px;
  }
};

Columns columns_of(std::size_t limits) {
  constexpr double least_px = 90, most_px = 300;
  return {std::clamp(columns_px / static_cast<double>(limits) - gap_px, least_px, most_px)};
}

std::string bar(const Columns& at, const search::Share& share, std::size_t column, double y,
                const char* color) {
  const auto seen = share.messages > 0 ? share.events / share.messages : 0;
  return fmt::format(
      R"(<line x1="{:.1f}" x2="{:.1f}" y1="{:.1f}" y2="{:.1f}" stroke="{}" stroke-width="2"/><circle cx="{:.1f}" cy="{:.1f}" r="4" fill="{}"/>)",
      at.x_of(share.range.low, column), at.x_of(share.range.high, column), y, y, color, at.x_of(seen, column),
      y, color);
}

std::string picture_of(const SearchReport& report) {
  const auto& goal = report.problem.goal;
  const auto& trials = report.outcome.trials;
  const auto at = columns_of(goal.size());
  const auto height = top_px + row_px * static_cast<double>(trials.size()) + 24;
  const auto width = at.x_of(1, goal.size() - 1) + gap_px;
  std::string svg = fmt::format(
      R"(<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {:.0f} {:.0f}" width="{:.0f}" font-family="sans-serif" font-size="12" role="img" aria-label="Share of messages or cycles that break each limit, by trial">)",
      width, height, width);
  for (std::size_t column = 0; column < goal.size(); ++column) {
    svg += fmt::format(R"(<text x="{:.1f}" y="14" font-weight="bold" fill="currentColor">{}</text>)",
                       at.x_of(0, column), escaped(goal[column].text));
    for (const auto& [share, label] : {std::pair{1e-6, "0"}, {1e-4, "0.01 %"}, {1e-2, "1 %"}, {1.0, "100 %"}})
      svg += fmt::format(
          R"(<line x1="{0:.1f}" x2="{0:.1f}" y1="{1:.0f}" y2="{2:.0f}" stroke="#8884"/><text x="{0:.1f}" y="{3:.0f}" text-anchor="middle" fill="currentColor">{4}</text>)",
          at.x_of(share, column), top_px - 12, height - 20, height - 4, label);
    if (goal[column].share > 0)
      svg += fmt::format(
          R"(<line x1="{0:.1f}" x2="{0:.1f}" y1="{1:.0f}" y2="{2:.0f}" stroke="#c00" stroke-dasharray="4 3"/>)",
          at.x_of(goal[column].share, column), top_px - 12, height - 20);
  }
  for (std::size_t i = 0; i < trials.size(); ++i) {
    const auto& trial = trials[i];
    const auto y = top_px + row_px * static_cast<double>(i);
    auto name = words_of(trial.set);
    if (name.size() > 40) name = fmt::format("{} settings", trial.set.size());
    svg += fmt::format(R"(<text x="0" y="{:.1f}" fill="currentColor">{} {}: {}</text>)", y + 4, i + 1,
                       escaped(name), search::word_of(trial.decision));
    for (std::size_t column = 0; column < goal.size(); ++column) {
      if (column < trial.reference_shares.size())
        svg += bar(at, trial.reference_shares[column], column, y + 5, "#999");
      if (column < trial.shares.size()) svg += bar(at, trial.shares[column], column, y - 3, "#06c");
    }
  }
  return svg + "</svg>";
}

ordered_json json_of(const std::vector<search::Share>& shares) {
  auto all = ordered_json::array();
  for (const auto& share : shares)
    all.push_back({{"events", share.events},
                   {"messages", share.messages},
                   {"low", share.range.low},
                   {"high", share.range.high}});
  return all;
}

}  // namespace

std::string goal_of(const search::Problem& problem) {
  return table::join(table::texts_of(problem.goal, &search::Limit::text), " and ");
}

std::string words_of(const search::Set& set) {
  if (set.empty()) return "no settings";
  const auto words_of_one = [](const auto& one) { return fmt::format("{}: {}", one.first, one.second); };
  return table::join(table::texts_of(set, words_of_one), ", ");
}

std::string text_of(const SearchReport& report) {
  const auto& outcome = report.outcome;
  std::string text = fmt::format("Goal: {}: {}.\n", goal_of(report.problem), answer_of(report));
  if (!report.simulated.empty()) text += fmt::format("  {}\n", simulated_text(report));
  if (const auto* last = last_of(outcome))
    for (std::size_t limit = 0; limit < last->shares.size(); ++limit)
      text +=
          fmt::format("  {}\n", share_text(report.problem.goal[limit], last->shares[limit],
                                           limit < outcome.proofs.size() ? &outcome.proofs[limit] : nullptr));
  const bool holds = outcome.end == End::goal_holds;
  if (!outcome.set.empty()) text += holds ? "\nSmallest set of settings:\n" : "\nBest settings so far:\n";
  for (const auto& one : outcome.contributions)
    text += fmt::format("  {}: {}\n    {}\n", one.member.key, one.member.value,
                        contribution_text(report.problem, one));
  if (!outcome.remaining.empty()) text += "\nRemaining causes:\n";
  for (std::size_t i = 0; i < std::min(most_causes, outcome.remaining.size()); ++i)
    text += fmt::format("  {}\n", search::text_of(outcome.remaining[i]));
  text += list("No effect", not_kept(outcome, Purpose::add, Decision::no_effect));
  text += list("Not needed", not_kept(outcome, Purpose::remove, Decision::holds));
  text += list("Harmful", not_kept(outcome, Purpose::add, Decision::harms));
  text += list("Not possible here", refusals(outcome));
  for (const auto& [title, words] : how_to_keep(report.kept)) text += fmt::format("\n{}:\n{}", title, words);
  text += fmt::format("\nTrials: {}. Runs: {}. Results: {}. Picture: {}.\n", outcome.trials.size(),
                      outcome.runs, report.results, report.page);
  return table::printable_lines(text);
}

ordered_json json_of(const SearchReport& report) {
  const auto& outcome = report.outcome;
  ordered_json all{{"goal", goal_of(report.problem)},
                   {"end", search::word_of(outcome.end)},
                   {"why", outcome.end == End::cannot_measure ? outcome.why : report.stopped},
                   {"simulated", report.simulated.empty() ? ordered_json() : ordered_json(report.simulated)},
                   {"set", outcome.set},
                   {"runs", outcome.runs},
                   {"results", report.results},
                   {"page", report.page}};
  auto& proofs = all["proofs"] = ordered_json::array();
  for (std::size_t limit = 0; limit < outcome.proofs.size(); ++limit)
    proofs.push_back({{"limit", report.problem.goal[limit].text},
                      {"below", outcome.proofs[limit].below},
                      {"permitted", outcome.proofs[limit].permitted},
                      {"burst", outcome.proofs[limit].burst}});
  const auto& kept = report.kept;
  auto units = ordered_json::array();
  for (const auto& unit : kept.units)
    units.push_back(
        {{"host", unit.host}, {"command", unit.command}, {"systemd", unit.text}, {"why_not", unit.why_not}});
  all["keep"] = {{"run", kept.run},
                 {"scenario", kept.scenario},
                 {"units", units},
                 {"fill_in", kept.fill_in},
                 {"left_out", kept.left_out}};
  auto& contributions = all["contributions"] = ordered_json::array();
  for (const auto& one : outcome.contributions) {
    auto less = ordered_json::array();
    for (const auto& range : one.less) less.push_back({{"low", range.low}, {"high", range.high}});
    contributions.push_back(
        {{"key", one.member.key}, {"value", one.member.value}, {"needed", one.is_needed}, {"less", less}});
  }
  auto& trials = all["trials"] = ordered_json::array();
  for (const auto& trial : outcome.trials)
    trials.push_back({{"purpose", search::word_of(trial.purpose)},
                      {"set", trial.set},
                      {"reference", trial.reference},
                      {"decision", search::word_of(trial.decision)},
                      {"why", trial.why},
                      {"runs", trial.runs},
                      {"shares", json_of(trial.shares)},
                      {"reference_shares", json_of(trial.reference_shares)}});
  auto& remaining = all["remaining"] = ordered_json::array();
  for (const auto& finding : outcome.remaining)
    remaining.push_back({{"cause", finding.cause}, {"messages", finding.messages}});
  auto& left_out = all["left_out"] = ordered_json::array();
  for (const auto& [key, why] : report.left_out) left_out.push_back({{"key", key}, {"why", why}});
  return all;
}

std::string page_of(const SearchReport& report) {
  const auto& outcome = report.outcome;
  std::string body =
      fmt::format("<h1>Search of settings: {}</h1><p>Goal: {}: <strong>{}</strong>.</p>",
                  escaped(report.scenario), escaped(goal_of(report.problem)), escaped(answer_of(report)));
  if (!report.simulated.empty()) body += fmt::format("<p>{}</p>", escaped(simulated_text(report)));
  if (!outcome.set.empty()) {
    body += "<h2>Settings</h2><ul>";
    for (const auto& one : outcome.contributions)
      body += fmt::format("<li><code>{}: {}</code>: {}</li>", escaped(one.member.key),
                          escaped(one.member.value), escaped(contribution_text(report.problem, one)));
    body += "</ul>";
  }
  for (const auto& [title, words] : how_to_keep(report.kept))
    body += fmt::format("<h2>{}</h2><pre>{}</pre>", escaped(title), table::escaped_lines(words));
  body +=
      "<h2>Trials</h2><p>Share of messages (response: of cycles) that break each limit. Blue: the settings "
      "of the trial. Gray: "
      "what they were compared with. Lines: 95 % confidence intervals. Dashed: the limit.</p>";
  body += "<div class=\"wide\">" + picture_of(report) + "</div><div class=\"wide\">";
  body +=
      "<table><tr><th></th><th>settings</th><th>step</th><th>compared "
      "with</th><th>reason</th><th>runs</th><th>result</th></tr>";
  for (std::size_t i = 0; i < outcome.trials.size(); ++i) {
    const auto& trial = outcome.trials[i];
    body +=
        fmt::format("<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
                    i + 1, escaped(words_of(trial.set)), purpose_words(trial.purpose),
                    trial.purpose == Purpose::measure ? "" : escaped(words_of(trial.reference)),
                    escaped(trial.why), trial.runs, search::word_of(trial.decision));
  }
  body += "</table></div>";
  if (!outcome.remaining.empty()) body += "<h2>Remaining causes</h2><ul>";
  for (const auto& finding : outcome.remaining)
    body += fmt::format("<li>{}</li>", escaped(search::text_of(finding)));
  if (!outcome.remaining.empty()) body += "</ul>";
  return table::standing_alone("Search: " + report.scenario, body);
}

}  // namespace ontime::app

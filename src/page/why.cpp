// SPDX-License-Identifier: Apache-2.0
// Why messages of a run were late or lost, on the page.
#include <algorithm>
#include <map>
#include <optional>

#include <fmt/format.h>

#include "page/parts.hpp"
#include "report/explained.hpp"
#include "report/runs.hpp"
#include "report/words.hpp"

namespace ontime::page {
namespace {

using explain::Account;
using explain::Cause;
using explain::Group;
using explain::Message;
using roundtrip::Fate;

constexpr std::size_t most_culprits = 20,
                      most_parts = 20;  // of a run, of a message; `ontime explain` has all

// How many of the examined late and lost messages have this main culprit: as a bar and in words.
std::string share_of(const Group& group, std::size_t messages) {
  const auto share = static_cast<double>(group.messages) / static_cast<double>(messages);
  auto html = fmt::format(
      "<li><svg class=\"share\" viewBox=\"0 0 100 8\" preserveAspectRatio=\"none\" "
      "aria-hidden=\"true\"><rect "
      "class=\"of\" width=\"100\" height=\"8\"/><rect class=\"{}\" width=\"{:.1f}\" height=\"8\"/></svg>"
      "<p><b>{} of {}</b> {}",
      group.culprit.cause == Cause::unknown ? "unknown" : "culprit", share * 100, group.messages, messages,
      escaped(sentence_of(group)));
  if (const auto remedy = explain::text_of(group.remedy); !remedy.empty())
    html += "<span class=\"remedy\">" + escaped(remedy) + "</span>";
  return html + "</p></li>\n";
}

// The worst messages, at most two of each culprit: late and lost ones, or, if no message was, the slowest.
std::vector<Message> chosen(const Account& account, std::size_t most) {
  constexpr std::size_t most_of_a_culprit = 2;
  std::vector<Message> all;
  std::map<std::string, std::size_t> said;
  for (const auto& message : account.messages) {
    if (message.parts.empty() || message.is_fault() == faults_of(account).empty()) continue;
    if (++said[explain::sentence_of(message.parts.front())] <= most_of_a_culprit && all.size() < most)
      all.push_back(message);
  }
  return all;
}

std::string heading_of(const Message& message) {
  const auto which = "Message " + grouped(message.sample.index);
  if (message.sample.fate == Fate::lost) return which + " was lost";
  return fmt::format("{} was {} delayed by {}", which,
                     message.is_fault() ? std::string(word_of(message)) + ":" : "on time, but",
                     span_of(message.delay_ns));
}

// What the figure shows, in words: the delay, the largest parts first.
std::string parts_of(const Message& message, const std::string& command) {
  Table table{.title = "Delay by stage",
              .columns = {{"Stage", Column::Align::left}, {"Took"}, {"Cause", Column::Align::left}}};
  const auto shown = std::min(message.parts.size(), most_parts);
  for (std::size_t i = 0; i < shown; ++i) {
    const auto& part = message.parts[i];
    table.rows.push_back({explain::word_of(part.stage), part.ns == 0 ? nothing : span_of(part.ns),
                          explain::sentence_of(part)});
  }
  if (shown < message.parts.size())
    table.notes.push_back(fmt::format("{} more parts: see `{}`.", message.parts.size() - shown, command));
  if (!message.whole) table.notes.emplace_back("Some kernel events around it are missing.");
  return as_html(table);
}

// The figure, or a note that it cannot be drawn; and all parts in words.
std::string figure_of(const Message& message, const std::string& explain,
                      std::optional<std::size_t> drawing) {
  const auto command = fmt::format("{} --message {}", explain, message.sample.index);
  const auto& culprit = message.parts.front();
  auto says = explain::sentence_of(culprit);
  if (culprit.ns > 0) says += ": " + span_of(culprit.ns);
  const auto caption = fmt::format("<b>{}</b> <span>{}</span>", escaped(heading_of(message)), escaped(says));
  auto html =
      drawing ? fmt::format(
                    "<figure class=\"way\" data-drawing=\"{}\">\n<figcaption>{}</figcaption>\n"
                    "</figure>\n",
                    *drawing, caption)
              : fmt::format("<p>{}</p>\n", caption) +
                    note_as_html(fmt::format("Too many events to draw. See `{} --perfetto FILE`.", command));
  return html + "<details><summary>Part by part</summary>\n" + parts_of(message, command) + "</details>\n";
}

constexpr const char* key =
    R"(<p class="note key">In the plots of a message’s path: <span class="culprit">▨</span>the culprit, and what it
delayed <span class="ours">■</span>an ontime thread runs <span class="ready">▨</span>it is ready, waits for a CPU <span
class="other">■</span>another thread <span class="interrupt">■</span>interrupts <span class="packet">■</span>packets</p>
)";

}  // namespace

Why why_of(const record::Reader& reader, const record::Run& run, const std::string& file,
           std::size_t first_drawing, std::size_t most_drawings) {
  const auto account = explain::account_of(reader, run);
  if (!account.traced) return {};
  const auto explain =
      table::shell_line({"ontime", "explain", table::as_operand(file), "--only", std::to_string(run.number)});
  Why why;
  const auto faults = faults_of(account);
  std::size_t looked_at = 0;
  for (const auto& group : account.groups) looked_at += group.messages;
  why.html = fmt::format("<p>{}</p>\n", faults.empty() ? "Nothing was late or lost. Causes of the slowest:"
                                                       : faults + ". Main causes:");
  if (!account.groups.empty()) {
    why.html += "<ol class=\"culprits\">\n";
    const auto shown = std::min(account.groups.size(), most_culprits);
    for (std::size_t i = 0; i < shown; ++i) why.html += share_of(account.groups[i], looked_at);
    why.html += "</ol>\n";
    if (shown < account.groups.size())
      why.html += note_as_html(fmt::format("{}, each of fewer messages: see `{}`.",
                                           many(account.groups.size() - shown, "more cause", "more causes"),
                                           explain));
  }
  for (const auto& limit : account.limits) why.html += note_as_html(limit);

  const auto worst = chosen(account, most_drawings);
  if (worst.empty()) {
    if (most_drawings == 0 && !chosen(account, 1).empty())
      why.html += note_as_html(fmt::format(
          "Its messages are not drawn: the drawings of earlier runs fill the page. See `{}`.", explain));
    return why;
  }
  std::map<std::uint64_t, nlohmann::json> drawings;  // by message
  explain::each_scene(reader, run, worst, [&](const Message& message, const explain::Scene& scene) {
    drawings[message.sample.index] = drawing_of(message, scene, explain::deadline_ns_of(run));
  });
  why.html += key;
  for (const auto& message : worst) {
    auto& drawing = drawings[message.sample.index];
    if (drawing.is_null()) {
      why.html += figure_of(message, explain, std::nullopt);
      continue;
    }
    why.html += figure_of(message, explain, first_drawing + why.drawings.size());
    why.drawings.push_back(std::move(drawing));
  }
  return why;
}

}  // namespace ontime::page

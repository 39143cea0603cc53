// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <string_view>

#include <fmt/format.h>

#include "report/answer.hpp"
#include "report/comparison.hpp"
#include "report/conditions.hpp"
#include "report/runs.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

using statistics::Change;
using statistics::Tendency;
using statistics::Times;
using statistics::Verdict;
using Pair = Comparison::Pair;

constexpr std::size_t most_pairs = 9, lines_of_differences = 3;

std::string one_run(const Comparison& comparison) {
  const bool is_listened = comparison.pairs.front().from.front()->run.asked.is_listened();
  return fmt::format("single runs do not show how starts vary. Fix: {}",
                     is_listened ? "compare five recordings a side" : "repeat: 5");
}

// How a pair counts misses, the most telling way first. A side without cycles counts late messages; a side
// without a limit only lost ones.
struct Missed {
  Times times;
  Figure figure;
  const char *heading, *words;
  bool is_of_own = false;  // of a robot's own messages, which are no cycles
};
constexpr std::array ways_to_miss = {
    Missed{Times::response, Figure::late, "late or\nlost", "late or lost messages", true},
    Missed{Times::response, Figure::late, "not in time", "cycles without an answer in time"},
    Missed{Times::round_trip, Figure::late, "late", "late messages"},
    Missed{Times::round_trip, Figure::lost, "lost", "lost messages"}};

const Missed* missed_of(const Pair& pair) {
  const bool is_own = pair.from.front()->run.asked.is_listened();
  const auto knows = [&](bool (*what)(const record::Run&)) {
    return std::ranges::all_of(std::array{&pair.from, &pair.to}, [&](const auto* side) {
      return std::ranges::all_of(*side, [&](const auto* run) { return what(run->run); });
    });
  };
  const bool knows_both = knows(statistics::knows_late) && knows(statistics::knows_loss);
  for (const auto& way : ways_to_miss) {
    if (way.times == Times::response && (way.is_of_own != is_own || (is_own && !knows_both))) continue;
    if (change_of(pair, way.times, way.figure)) return &way;
  }
  return nullptr;
}

struct Changed {
  std::vector<std::size_t> less, more;  // places of pairs
  bool none() const { return less.empty() && more.empty(); }
};

bool any_repeated(const Comparison& comparison) { return std::ranges::any_of(comparison.pairs, is_repeated); }

// Beside a repeated pair single runs do not count. `metric_of`: nothing, where the pair does not have it.
template <typename MetricOf>
Changed changed_of(const Comparison& comparison, MetricOf metric_of) {
  Changed changed;
  const bool repeated_only = any_repeated(comparison);
  for (std::size_t i = 0; i < comparison.pairs.size(); ++i)
    if (const std::optional<Change> change = metric_of(comparison.pairs[i]);
        change && (change->repeated || !repeated_only)) {
      if (change->tendency == Tendency::less) changed.less.push_back(i);
      if (change->tendency == Tendency::more) changed.more.push_back(i);
    }
  return changed;
}

// By id and transport, without what the sides' names say. More only where that is the same.
std::vector<std::string> names_of_pairs(const Comparison& comparison) {
  const auto& pairs = comparison.pairs;
  const auto asked_of = [&](std::size_t place) -> const record::Asked& {
    return pairs[place].to.front()->run.asked;
  };
  const bool several_ids = std::ranges::any_of(
      pairs, [&](const Pair& pair) { return pair.to.front()->run.asked.id != asked_of(0).id; });
  std::vector<std::string> names;
  std::vector<std::pair<std::string, std::vector<std::size_t>>> alike;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const auto &from = pairs[i].from.front()->run.asked, &to = asked_of(i);
    std::vector<std::string> parts;
    if (several_ids) parts.push_back(from.id == to.id ? id_of(to) : id_of(from) + " → " + id_of(to));
    if (!to.is_listened() && !(several_ids && comparison.key == "transport")) {
      const auto before = word(from.task.transport), after = word(to.task.transport);
      parts.push_back(before == after ? after : fmt::format("{} → {}", before, after));
    }
    entry_of(alike, names.emplace_back(join(parts, " "))).push_back(i);
  }
  for (const auto& [name, places] : alike) {
    if (places.size() == 1 && !name.empty()) continue;
    Group group;
    for (const auto place : places) group.push_back(pairs[place].to.front());
    const auto labels = labels_without_repetition(group);
    for (std::size_t i = 0; i < places.size(); ++i) {
      const auto& asked = asked_of(places[i]);
      auto more = labels[i];  // begins with the transport
      if (!asked.is_listened()) more.erase(0, std::min(more.size(), word(asked.task.transport).size() + 1));
      names[places[i]] += (name.empty() || more.empty() ? "" : " ") + more;
    }
  }
  return names;
}

// "fewer late messages (udp, fastdds), more (cyclonedds)".
std::string said(const Changed& changed, const std::vector<std::string>& names, const std::string& less,
                 const std::string& more, const std::string& what) {
  const auto of = [&](const std::vector<std::size_t>& places) {
    return places.size() == names.size() ? "" : " (" + name_of_some(names, places) + ")";
  };
  std::vector<std::string> parts;
  if (!changed.less.empty()) parts.push_back(less + " " + what + of(changed.less));
  if (!changed.more.empty())
    parts.push_back(more + (changed.less.empty() ? " " + what : "") + of(changed.more));
  return join(parts, " and ");
}

std::string change_text(const std::optional<Change>& change, std::string (*form)(double)) {
  if (!change) return nothing;
  const auto from = form(change->from), to = form(change->to);
  return (from == to ? from : from + " → " + to) + (change->verdict() != Verdict::cannot_tell ? " *"
                                                    : change->is_of_unequal_numbers           ? " †"
                                                                                              : "  ");
}

std::string share_text(double share) { return share > 0 ? percent(share) + " %" : "0"; }

// The places of the pairs that have space, in their order: those that changed before others.
std::vector<std::size_t> shown_of(const Comparison& comparison) {
  std::vector<std::size_t> changed, others;
  for (std::size_t i = 0; i < comparison.pairs.size(); ++i) {
    const auto& pair = comparison.pairs[i];
    const auto has_changed = [&](Times times, Figure figure) {
      const auto change = change_of(pair, times, figure);
      return change && change->tendency != Tendency::unclear;
    };
    const auto* const way = missed_of(pair);
    const bool any =
        (way != nullptr && has_changed(way->times, way->figure)) ||
        std::ranges::any_of(std::array{Figure::p50, Figure::p99, Figure::max},
                            [&](Figure figure) { return has_changed(Times::round_trip, figure); });
    (any ? changed : others).push_back(i);
  }
  changed.insert(changed.end(), others.begin(), others.end());
  changed.resize(std::min(most_pairs, changed.size()));
  std::ranges::sort(changed);
  return changed;
}

Table table_of(const Comparison& comparison, const std::vector<std::string>& names, const Missed* missed,
               std::size_t width) {
  using enum Column::Align;
  Table table{.columns = {{"", left},
                          {missed != nullptr ? missed->heading : "not in time"},
                          {"p50", right, false, 1},
                          {"p99"},
                          {"max", right, false, 2}}};
  const auto time_text = [](const Pair& pair, Figure figure) {
    return change_text(change_of(pair, Times::round_trip, figure), milliseconds);
  };
  for (const auto i : shown_of(comparison)) {
    const auto& pair = comparison.pairs[i];
    const auto* const way = missed_of(pair);
    table.rows.push_back(
        {names[i],
         way != nullptr ? change_text(change_of(pair, way->times, way->figure), share_text) : nothing,
         time_text(pair, Figure::p50), time_text(pair, Figure::p99), time_text(pair, Figure::max)});
  }
  constexpr std::size_t gap = 2, least = 24;  // a name that the line has no space for stands on its own line
  std::size_t numbers = 0;
  for (std::size_t i = 1; i < table.columns.size(); ++i) numbers += gap + table::width_of_column(table, i);
  shorten_names(table.rows, 0, width > numbers + least ? width - numbers : least);
  return table;
}

// Settings that belong together become a count: "realtime: off → on; kernel (2 values)".
std::string differences_text(const Comparison& comparison) {
  constexpr std::string_view version = "transport version", of_kernel = "Linux ";
  std::vector<Difference> all;
  for (const auto& pair : comparison.pairs)
    for (auto& difference : other_differences(comparison, pair)) {
      auto& [host, what, from, to, difference_text] = difference;
      if (what == version) {  // each pair may have another transport
        if (from.starts_with(of_kernel) && to.starts_with(of_kernel)) continue;  // kernel_release says it
        const auto transport = word(pair.to.front()->run.asked.task.transport);
        difference_text =
            replace_all(difference_text, "transport version", fmt::format("{} version", transport));
        what += " of " + transport;
      }
      if (std::ranges::find(all, difference.name(), &Difference::name) == all.end())
        all.push_back(std::move(difference));
    }
  std::vector<std::pair<std::string, std::vector<Difference>>> kinds;
  for (auto& difference : by_importance(all)) {
    const auto first = split(difference.what, ' ')[0];
    const bool is_of_one_host = !difference.host.empty() && difference.host != Difference::both;
    const auto name = difference.what.find(" version of ") != std::string::npos ? difference.name()
                      : is_of_one_host        ? difference.host + ' ' + first
                      : first == "others"     ? "the other components"  // the record's words
                      : first == "neighbours" ? "background topics"
                                              : first;
    if (name != "id") entry_of(kinds, name).push_back(std::move(difference));
  }
  // Of what was requested, what takes the fewest words first.
  const auto first_of_hosts =
      std::ranges::find_if(kinds, [](const auto& kind) { return !is_requested(kind.second.front()); });
  std::ranges::stable_sort(kinds.begin(), first_of_hosts, {},
                           [](const auto& kind) { return kind.second.size(); });
  const auto text = [](const auto& kind) {
    const auto& [name, of_kind] = kind;
    return of_kind.size() == 1 ? of_kind.front().words()
                               : fmt::format("{} ({} values)", name, of_kind.size());
  };
  return join(texts_of(kinds, text), "; ");
}

// "4 of 8 runs (idle udp (run 1), …): text", in so much space: names are cut before the text.
std::string caution_of(std::string names, const std::string& text, std::size_t room) {
  constexpr std::string_view more = ", …)";
  const auto left = room - std::min(room, width_of(text) + 2);
  while (names.ends_with(more) && width_of(names) > left) {
    const auto last = names.rfind(", ", names.size() - more.size() - 1);
    auto shorter =
        last == names.npos ? names.substr(0, names.find(" (")) : names.substr(0, last).append(more);
    if (shorter.size() >= names.size()) break;  // a name in the file may end so
    names = std::move(shorter);
  }
  return shortened(shortened(names, std::max(left, room / 4)) + ": " + text, room);
}

// Each in so many columns.
std::vector<std::string> cautions_of(const Comparison& comparison, const std::vector<std::string>& pairs,
                                     std::size_t room) {
  std::vector<std::string> cautions, names;
  Group runs;
  std::vector<std::size_t> single;
  for (std::size_t i = 0; i < pairs.size(); ++i)
    if (!is_repeated(comparison.pairs[i])) single.push_back(i);
  // There is room for few: the new side's come first.
  for (const auto side : {&Pair::to, &Pair::from})
    for (const auto& pair : comparison.pairs)
      for (const auto* run : pair.*side) {
        runs.push_back(run);
        const auto& of = side == &Pair::from ? comparison.from_name : comparison.to_name;
        names.push_back(shortened(gate::name_of(*run), room) + (comparison.one_file ? "" : " of " + of));
        if (!gate::lacks_samples(gate::flaw_of(*run))) continue;
        const auto missed = statistics::fates_of(*run).not_in_time;
        cautions.push_back(caution_of(
            "left out: " + names.back(),
            gate::unfit(*run) +
                (missed > 0 ? fmt::format("; {} not in time", run->run.asked.is_listened()
                                                                  ? many(missed, "message", "messages")
                                                                  : many(missed, "cycle", "cycles"))
                            : ""),
            room));
      }
  auto remarks = shared_remarks(runs);
  gather_requirements(remarks, names);
  const auto add = [&](Remark::Weight weight) {
    for (const auto& remark : remarks)
      if (remark.weight == weight)
        cautions.push_back(remark.names_a_run
                               ? shortened(remark.text, room)
                               : caution_of(name_of_some(names, remark.runs), remark.text, room));
  };
  add(Remark::Weight::not_applied);
  if (!single.empty() && any_repeated(comparison))  // else the sentence says it
    cautions.push_back(caution_of(shortened(name_of_some(pairs, single), room), one_run(comparison), room));
  add(Remark::Weight::caution);
  return cautions;
}

std::string sentence_of(const Comparison& comparison, const std::vector<std::string>& names) {
  if (std::ranges::all_of(comparison.pairs, [](const Pair& pair) {
        return whole(pair.from).empty() || whole(pair.to).empty();
      }))
    return "Nothing to compare: all runs of one side are left out.";
  const auto* const missed = missed_of(comparison.pairs.front());
  const auto metric = [](Times times, Figure figure) {
    return [=](const Pair& pair) { return change_of(pair, times, figure); };
  };
  const auto misses = changed_of(comparison, [](const Pair& pair) -> std::optional<Change> {
    const auto* const way = missed_of(pair);
    return way != nullptr ? change_of(pair, way->times, way->figure) : std::nullopt;
  });
  const auto lost = changed_of(comparison, metric(Times::round_trip, Figure::lost));
  const auto p99 = changed_of(comparison, metric(Times::round_trip, Figure::p99));
  std::vector<std::string> parts;
  const auto add = [&](const Changed& changed, const char* less, const char* more, const std::string& what) {
    if (!changed.none()) parts.push_back(said(changed, names, less, more, what));
  };
  add(misses, "fewer", "more", missed != nullptr ? missed->words : "late messages");
  if (missed == nullptr || missed->figure != Figure::lost) add(lost, "fewer", "more", "lost messages");
  add(p99, "a lower", "a higher", "p99");
  const bool repeated = any_repeated(comparison);
  if (parts.empty()) {
    const auto* const what = missed != nullptr ? missed->words : "late messages";
    return fmt::format("No difference in {} or p99 is proven: {}", what,
                       repeated ? "chance may explain it." : one_run(comparison));
  }
  const bool is_simple = parts.size() == 2 && join(parts, "").find(" and ") == std::string::npos;
  const auto changes = join(parts, is_simple ? " and " : "; ");
  return repeated ? fmt::format("{} has {} than {}.", comparison.to_name, changes, comparison.from_name)
                  : fmt::format("In these runs {} had {} than {}. Not proven: {}", comparison.to_name,
                                changes, comparison.from_name, one_run(comparison));
}

}  // namespace

std::string render_answer(Comparison comparison, const std::vector<gate::Judgement>& judgements,
                          Format format, const std::string& full_command, std::size_t width) {
  const auto is_imported = [](const Pair& pair) {
    return pair.from.front()->imported || pair.to.front()->imported;
  };
  if (format != Format::table || comparison.pairs.empty() ||
      std::ranges::any_of(comparison.pairs, is_imported))
    return render(comparison, judgements, format, width);

  const auto sides = comparison.from_name + " → " + comparison.to_name;
  // A load is a long name: only the line below the sentence has all of it.
  constexpr std::size_t longest_name = 40;
  std::vector<std::vector<std::string>> brief = {{comparison.from_name}, {comparison.to_name}};
  shorten_names(brief, 0, longest_name);
  comparison.from_name = brief.front().front();
  comparison.to_name = brief.back().front();
  const auto names = names_of_pairs(comparison);
  std::string text = wrapped(printable(sentence_of(comparison, names)), width);
  std::vector<std::size_t> from, to;
  for (const auto& pair : comparison.pairs) {
    from.push_back(whole(pair.from).size());
    to.push_back(whole(pair.to).size());
  }
  const auto range = [](const std::vector<std::size_t>& counts) {
    const auto [least, most] = std::ranges::minmax(counts);
    return least == most ? std::to_string(most) : fmt::format("{} to {}", least, most);
  };
  const bool any_mean = std::ranges::max(from) + std::ranges::max(to) > 2;
  const Group first{comparison.pairs.front().from.front(), comparison.pairs.front().to.front()};
  text += wrapped(printable(fmt::format("{}; {} in ms; runs per row: {} and {}{}", sides,
                                        all_listened(first) ? "times" : "round trips", range(from), range(to),
                                        any_mean ? "; each value is their mean, max the greatest" : "")),
                  width);
  auto table = table::as_text(
      {.tables = {table_of(comparison, names, missed_of(comparison.pairs.front()), width)}}, width);
  table.pop_back();  // the empty line after it
  text += table;
  if (names.size() > most_pairs)
    text += fmt::format("… and {}\n", many(names.size() - most_pairs, "more", "more"));
  if (table.find('*') != table.npos) text += wrapped("* statistically significant (98 % confidence)", width);
  if (table.find("†") != table.npos)
    text += wrapped("† not comparable: the more messages a side has, the greater its max", width);
  const auto add_list = [&](const char* heading, const std::string& list) {
    if (!list.empty())
      text += wrapped(heading + shortened(printable(list), lines_of_differences * width - 24), width);
  };
  add_list("Also different: ", differences_text(comparison));
  std::vector<std::string> alone;
  for (const auto* side : {&comparison.only_from, &comparison.only_to})
    for (const auto& name : names_apart(*side))
      alone.push_back(fmt::format("{} of {}", name,
                                  side == &comparison.only_from ? comparison.from_name : comparison.to_name));
  add_list("Only on one side: ", join(alone, ", "));
  const auto cautions = cautions_of(comparison, names, 2 * width - 24);
  for (std::size_t i = 0; i < std::min(most_cautions, cautions.size()); ++i)
    text += wrapped("Caution: " + printable(cautions[i]), width);
  text += more_cautions(cautions.size());
  for (const auto& judgement : judgements)
    if (!judgement.says.empty()) text += wrapped(printable(gate::text_of(judgement)), width);
  return text + steps_text({{"All metrics", full_command}}, width);
}

}  // namespace ontime::report

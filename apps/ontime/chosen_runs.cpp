// SPDX-License-Identifier: Apache-2.0
#include "chosen_runs.hpp"

#include <algorithm>
#include <chrono>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "flags.hpp"
#include "report/words.hpp"
#include "spelling/spelling.hpp"
#include "table/table.hpp"
#include "terminal.hpp"

namespace ontime::app {
namespace {

bool is_called(const record::Run& run, const std::string& word) {
  return std::to_string(run.number) == word || run.asked.id == word;
}

// "1 to 12 (ids: idle, loaded)".
std::string all_of(const std::vector<record::Run>& runs, std::vector<std::string>& ids) {
  for (const auto& run : runs)
    if (const auto id = table::printable(run.asked.id);
        !id.empty() && std::ranges::find(ids, id) == ids.end())
      ids.push_back(id);
  constexpr std::size_t most_ids = 20;
  const auto shown = std::min(ids.size(), most_ids);
  return fmt::format("{} to {} (ids: {}{})", runs.front().number, runs.back().number,
                     fmt::join(ids.begin(), ids.begin() + static_cast<std::ptrdiff_t>(shown), ", "),
                     shown < ids.size() ? ", …" : "");
}

}  // namespace

void add_only(Command& command, std::vector<std::string>& words, const std::string& older) {
  add_list(command, "--only" + older, words, "RUN,...", "only the runs with these ids or numbers");
}

std::vector<record::Run> chosen_runs(const record::Reader& reader, const std::string& file,
                                     const std::vector<std::string>& words) {
  auto runs = reader.runs();
  for (const auto& word : words) {
    if (std::ranges::any_of(runs, [&](const auto& run) { return is_called(run, word); })) continue;
    if (runs.empty()) throw wrong("{} has no runs", file);
    std::vector<std::string> ids;
    const auto all = all_of(runs, ids);
    const bool is_range = word.find_first_not_of("0123456789-") == word.npos && word.find('-') != word.npos;
    throw wrong("{} has no run '{}'{}. It has runs {}{}", file, word, spelling::suggestion(word, ids), all,
                is_range ? ". Fix: name runs one by one: 1,2,3" : "");
  }
  if (!words.empty())
    std::erase_if(runs, [&](const auto& run) {
      return std::ranges::none_of(words, [&](const auto& word) { return is_called(run, word); });
    });
  return runs;
}

std::vector<statistics::Summary> chosen_summaries(const record::Reader& reader, const std::string& file,
                                                  const std::vector<std::string>& words) {
  return summaries_of(reader, chosen_runs(reader, file, words));
}

std::vector<statistics::Summary> summaries_of(const record::Reader& reader,
                                              const std::vector<record::Run>& runs) {
  constexpr std::uint64_t many = 1'000'000;
  Terminal terminal;
  const auto begun = std::chrono::steady_clock::now();
  std::vector<statistics::Summary> summaries;
  for (const auto& run : runs) {
    const auto messages = run.asked.keeps_worst() ? 0 : run.outcome.counters.sent;
    if (messages > many || std::chrono::steady_clock::now() - begun > std::chrono::seconds(2))
      terminal.does(fmt::format("reading run {}, {} of {}{}", run.number, summaries.size() + 1, runs.size(),
                                messages > 0 ? fmt::format(": {} messages", table::grouped(messages)) : ""));
    summaries.push_back(statistics::summarise(reader, run));
  }
  return summaries;
}

}  // namespace ontime::app

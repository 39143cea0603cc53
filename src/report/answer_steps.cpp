// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <initializer_list>
#include <span>
#include <string_view>

#include <fmt/format.h>

#include "conditions/conditions.hpp"
#include "report/answer.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

using statistics::Summary;

bool is_simulated(const Summary& run) {
  const auto& hosts = run.run.outcome.hosts;
  return std::ranges::any_of(hosts,
                             [](const auto& host) { return host.second.machine.simulated.has_value(); });
}

using Options = std::span<const std::string_view>;
bool is_one_of(std::string_view word, Options all) { return std::ranges::find(all, word) != all.end(); }

// "--duration" of "--duration=5s".
std::string name_of_option(const std::string& word) { return word.substr(0, word.find('=')); }

constexpr std::string_view of_all[] = {"--deploy",     "--cable",    "--only",
                                       "--transports", "--duration", "--explain"};
constexpr std::string_view of_the_lab[] = {"--nic", "--live", "--cpus", "--kernel", "--memory", "--with"};
constexpr std::string_view without_value[] = {"--deploy", "--explain", "--live",
                                              "--resume", "--full",    "--deterministic"};
constexpr std::string_view of_output[] = {"--results", "--format", "--output", "--full", "--keep"};
// Those that name files or interfaces.
constexpr std::string_view only_own[] = {"--kernel", "--with", "--cable"};
// Options of transports that name files, ports or queues.
constexpr std::string_view own_options[] = {"config", "profiles", "port", "queue"};

// Whether the word after this one is its value.
bool takes_value(const std::string& option) {
  return option != "--" && option.find('=') == std::string::npos && !is_one_of(option, without_value);
}

// Until 0.2 the lab's runs had the command line of the machine in it, which is of no use here.
bool is_of_lab_machine(const Summary& run) {
  const auto& words = run.run.asked.command_line;
  return is_simulated(run) && words.size() > 1 && words[1] == "run";
}

// The scenarios of its command line, which may be folders.
std::vector<std::string> scenarios_named(const Summary& run) {
  const auto& words = run.run.asked.command_line;
  std::vector<std::string> names;
  if (is_of_lab_machine(run)) return names;
  // After "ontime run", "ontime lab run", "ontime tune search".
  const std::size_t first = words.size() > 1 && words[1] == "run" ? 2 : 3;
  for (std::size_t i = first; i < words.size(); ++i)
    if (!words[i].starts_with('-'))
      names.push_back(words[i]);
    else if (takes_value(words[i]))
      ++i;
  return names;
}

// The scenario of this run as it was named then: a name, or a path.
std::string scenario_of(const Summary& run) {
  const std::filesystem::path file(run.run.asked.scenario_file);
  const auto named = scenarios_named(run);
  if (file.empty() || std::ranges::find(named, file.string()) != named.end()) return file.string();
  for (const auto& one : named)
    if (const auto name = std::filesystem::path(one).filename();  // of "demo", "lab/tsn" and "demo.yaml"
        name == file.stem() || name == file.filename())
      return one;
  return file.string();
}

// Options of the scenario's command line, with their values, without these; and all options of the lab.
std::vector<std::string> options_of(const Summary& run, Options without, bool is_own) {
  const auto& words = run.run.asked.command_line;
  std::vector<std::string> kept;
  const bool in_lab = is_simulated(run);
  if (is_of_lab_machine(run)) return kept;
  for (std::size_t i = 2; i < words.size(); ++i) {
    if (!words[i].starts_with('-')) continue;
    const auto name = name_of_option(words[i]);
    const bool has_value = takes_value(words[i]) && i + 1 < words.size();
    const bool is_wanted = is_one_of(name, of_all) && !is_one_of(name, without);
    if ((is_wanted || (in_lab && is_one_of(name, of_the_lab))) && (is_own || !is_one_of(name, only_own))) {
      kept.push_back(words[i]);
      if (has_value) kept.push_back(words[i + 1]);
    }
    i += has_value ? 1 : 0;
  }
  return kept;
}

// Options of ping and listen that open no file, port, host or interface.
bool is_harmless(const std::string& option) {
  constexpr std::string_view of_listen[] = {"--loopback", "--wait",       "--chain",  "--age",   "--for",
                                            "--list",     "--no-explain", "--budget", "--reader"};
  return is_one_of(option, of_listen) ||
         std::ranges::any_of(conditions::fields(), [&](const auto& field) { return field.flag == option; });
}

// Of a transport's options: "executor=single", which opens no file.
bool is_plain(const std::string& option) {
  const auto end = option.find('=');
  const auto is_word = [](std::string_view text) {
    return !text.empty() && text.find_first_not_of("abcdefghijklmnopqrstuvwxyz0123456789_-") == text.npos;
  };
  return end != option.npos && option.front() >= 'a' && option.front() <= 'z' &&
         is_word(option.substr(0, end)) && is_word(option.substr(end + 1)) &&
         !is_one_of(option.substr(0, end), own_options);
}

// The words of ping or listen again, without where it writes. Of a stranger's file only what is harmless.
std::vector<std::string> again_alone(const std::vector<std::string>& words, Options without, bool is_own) {
  const bool listens = words[1] == "listen";
  const auto is_kept = [&](const std::string& option) {
    if (is_one_of(option, of_output) || (!is_own && !is_harmless(option))) return false;
    return !is_one_of(option == "--for" ? "--duration" : option, without);
  };
  std::vector<std::string> kept = {"ontime", words[1]};
  // So many words, the values of an option that is dropped. ping has no words but values.
  std::size_t skipped = listens ? 0 : words.size();
  for (std::size_t i = 2; i < words.size(); ++i) {
    const auto& word = words[i];
    if (!word.starts_with('-')) {
      if (skipped == 0) kept.push_back(word);
      skipped -= skipped > 0 ? 1 : 0;
      continue;
    }
    const auto option = name_of_option(word);
    skipped = 0;
    const auto value = i + 1 < words.size() ? words[i + 1] : "";
    const bool is_safe = (word == "--option" && is_plain(value)) || (word == "--interface" && value == "lo");
    if (is_safe || is_kept(option)) {
      kept.push_back(word);
      continue;
    }
    if (option == "--pcap") return {};  // a capture gets no longer
    if (!is_own && option == "--peer") kept.insert(kept.end(), {option, "HOST"});
    if (!is_own && option == "--option") kept.insert(kept.end(), {option, "NAME=VALUE"});
    // listen's topics follow one value.
    skipped = !listens ? words.size() : option == word ? 1 : 0;
  }
  return kept;
}

// The words that measure this run again; none, if they are not known. With --only, which may choose runs of
// other scenarios, they name all that were run with it.
std::vector<std::string> again(const Summary& run, Options without, const Origin& origin) {
  const auto& words = run.run.asked.command_line;
  if (const auto scenario = scenario_of(run); !scenario.empty()) {
    if (scenario.starts_with('-')) return {};  // of a foreign file: it would be an option
    const auto named = is_one_of("--only", without) ? std::vector<std::string>() : scenarios_named(run);
    const auto is_trusted = [&](const auto& one) {
      return origin.is_own || (origin.trusts && origin.trusts(one));
    };
    std::vector<std::string> all = {"ontime"};
    if (is_simulated(run)) all.emplace_back("lab");
    all.emplace_back("run");
    for (const auto& one : named.empty() ? std::vector{scenario} : named)
      all.push_back(is_trusted(one) ? one : "SCENARIO");
    const auto options = options_of(run, without, origin.is_own);
    all.insert(all.end(), options.begin(), options.end());
    return all;
  }
  if (words.size() < 2 || (words[1] != "ping" && words[1] != "listen")) return {};
  return again_alone(words, without, origin.is_own);
}

// It fails again without it.
bool needs_root(const Summary& run) {
  const auto& asked = run.run.asked;
  return asked.explain || !asked.kernel.empty() || asked.isolation.any() || asked.faults.any();
}

std::string plain_time(double ns) {
  if (ns < 120e9) return fmt::format("{:.0f}s", std::max(1.0, std::ceil(ns / 1e9)));
  if (ns < 120 * 60e9) return fmt::format("{:.0f}min", std::ceil(ns / 60e9));
  return fmt::format("{:.0f}h", std::ceil(ns / 3600e9));
}

// --only takes ids, which a comma would part. What begins with a dash would be an option.
bool can_be_named(const std::string& id) {
  return !id.empty() && id != nothing && id.find(',') == std::string::npos && !id.starts_with('-');
}

}  // namespace

std::vector<Answer::Step> next_steps(const Findings& found, const Origin& origin) {
  std::vector<Answer::Step> steps;
  const auto add = [&](const std::string& why, const std::vector<std::string>& words, bool as_root = false) {
    const auto line = table::line_to_paste(words);
    if (!line || words.empty()) return;
    as_root = as_root && words[1] != "lab";
    if (as_root && origin.has_no_root) return;
    steps.push_back({why, (as_root && !origin.is_root ? "sudo " : "") + *line});
    for (const auto* word : {"SCENARIO", "HOST", "NAME=VALUE"})  // see again()
      if (!origin.is_own && std::ranges::find(words, word) != words.end())
        steps.back().fill_in.emplace_back(word);
  };
  const auto again = [&](const Summary& run, std::initializer_list<std::string_view> without) {
    return report::again(run, without, origin);
  };
  const auto with = [](std::vector<std::string> words, std::initializer_list<std::string> further) {
    if (!words.empty()) words.insert(words.end(), further);
    return words;
  };
  using Words = std::vector<std::string>;
  const auto is_of_listen = [](const Words& words) { return words.size() > 1 && words[1] == "listen"; };
  const auto is_of_scenario = [&](const Words& words) {
    return words.size() > 1 && words[1] != "ping" && !is_of_listen(words);
  };
  const auto file = table::as_operand(origin.file);
  if (found.denied != nullptr && !origin.is_root) add("Permit all", again(*found.denied, {}), true);
  if (origin.running_from && !file.empty())
    add("Watch", {"ontime", "watch", file});
  else if (!origin.finish.empty())
    steps.push_back({"Finish", origin.finish});
  else if (found.unfinished != nullptr && !file.empty())
    if (const auto words = again(*found.unfinished, {}); is_of_scenario(words))
      add("Finish", with(words, {"--resume", "--results", file}),
          found.failed && needs_root(*found.unfinished));
  if (found.late != nullptr) {
    const auto id = word(found.late->run.asked.id);
    const auto words = again(*found.late, {"--explain"});
    if ((found.late->run.asked.explain || is_of_listen(words)) && !file.empty())
      add("Why late", {"ontime", "explain", file});
    else if (is_of_scenario(words) && can_be_named(id))
      add("Why late", with(again(*found.late, {"--only", "--explain"}), {"--only", id, "--explain"}), true);
    else
      add("Why late", with(words, {"--explain", "--results", "why.ontime"}), true);
  }
  if (found.from != nullptr && found.to != nullptr && !file.empty()) {
    auto from = word(found.from->run.asked.id), to = word(found.to->run.asked.id);
    if (from == to) {
      from = std::to_string(found.from->run.number);
      to = std::to_string(found.to->run.number);
    }
    add("Compare", {"ontime", "compare", file, "--from", from, "--to", to});
  }
  if (found.longer != nullptr && found.longer_ns > 0) {
    const auto id = word(found.longer->run.asked.id);
    const bool is_alone = origin.only == id && can_be_named(id);  // `report --only` showed no other
    auto words = is_alone ? again(*found.longer, {"--only", "--duration", "--explain"})
                          : again(*found.longer, {"--duration", "--explain"});
    if (is_alone && is_of_scenario(words)) words = with(words, {"--only", id});
    const bool listens = is_of_listen(words);
    add(found.longer_tells, with(words, {listens ? "--for" : "--duration", plain_time(found.longer_ns)}),
        listens && !origin.has_no_root);  // with --reader, say, it may do without
  }
  const auto words = again(*found.any, {});
  if (!file.empty())
    add("All tables", origin.only.empty() ? Words{"ontime", "report", file, "--full"}
                                          : Words{"ontime", "report", file, "--only", origin.only, "--full"});
  else if (!is_of_listen(words) && !found.failed)       // what failed fails again
    add("Again, all tables", with(words, {"--full"}));  // measures anew: no samples were kept
  return steps;
}

}  // namespace ontime::report

// SPDX-License-Identifier: Apache-2.0
// Settings of a machine, applied by hand until revert or a reboot.
#include <set>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>

#include "campaign/campaign.hpp"
#include "commands.hpp"
#include "flags.hpp"
#include "journal/journal.hpp"
#include "keeper/keeper.hpp"
#include "machine/machine.hpp"
#include "output.hpp"
#include "scenario_files.hpp"
#include "settings/settings.hpp"
#include "spelling/spelling.hpp"
#include "table/table.hpp"
#include "terminal.hpp"

namespace ontime::app {
namespace {

using campaign::Error;
using nlohmann::json;
using table::printable;

struct TuneArguments {
  std::string interface, peer, network_namespace, format = "table", scenario, run, boot;
  std::vector<std::string> sets;
  bool dry_run = false;
};

settings::Link link_of(const TuneArguments& arguments) {
  settings::Link link{arguments.interface, arguments.network_namespace};
  if (!arguments.peer.empty())
    link.interface = machine::interface_to(arguments.peer, arguments.network_namespace);
  return link;
}

// Reads NAME=VALUE by the table of scenario keys, also as they have it: kernel.NAME=VALUE. Returns NAME.
std::string set(campaign::Run& run, const std::string& said) {
  const auto equals = said.find('=');
  if (equals == said.npos || equals == 0)
    throw wrong("--set: '{}' is not NAME=VALUE, such as ksoftirqd=60", said);
  auto name = said.substr(0, equals);  // not const: it is returned by a move
  if (name.starts_with("kernel.")) name.erase(0, 7);
  std::vector<std::string> names;
  for (const auto& key : campaign::keys()) {
    if (!key.path.starts_with("kernel.")) continue;
    names.push_back(key.path.substr(7));
    if (names.back() != name) continue;
    read_flag("--set " + name, [&] { key.set(run, said.substr(equals + 1)); });
    return name;
  }
  const auto meant = spelling::suggestion(name, names);
  throw wrong("--set: unknown setting '{}'{}", name,
              meant.empty() ? fmt::format(". Settings: {}", fmt::join(names, ", ")) : meant);
}

campaign::Run run_of(const TuneArguments& arguments) {
  if (arguments.scenario.empty()) return {};
  const auto files = scenario_files({arguments.scenario});
  if (files.size() != 1)
    throw wrong("--scenario: {} has {} scenarios. Fix: name one of them", arguments.scenario, files.size());
  const auto scenario = campaign::read_scenario(files.front(), {{arguments.run}, {}, {}});
  for (const auto& run : scenario.runs) {
    if (run.isolation.any())
      throw wrong(
          "--only: run '{}' has isolation.*, which only `ontime run` applies. Fix: state its kernel settings "
          "with --set. To reserve CPUs permanently: `ontime check`",
          arguments.run);
    if (run.kernel != scenario.runs.front().kernel)
      throw wrong("--only: the runs with id '{}' have different kernel settings. Fix: state them with --set",
                  arguments.run);
  }
  return scenario.runs.front();
}

std::string in_words(const settings::Change& change) {
  if (change.thing.kind == nullptr)
    return fmt::format("{}: {}, once {} is on", change.setting->name, change.after,
                       change.setting->comes_with);
  return change.before == change.after
             ? fmt::format("{}: {} is already {}", change.setting->name, change.thing.title(), change.after)
             : fmt::format("{}: {} from {} to {}", change.setting->name, change.thing.title(), change.before,
                           change.after);
}

void print_lines(const std::vector<std::string>& lines) {
  for (const auto& line : lines) print(wrapped_lines(printable(line), reading_columns()));
}

void print_errors(const std::vector<std::string>& lines) {
  for (const auto& line : lines) print_error(line);
}

void warn(const campaign::Run& run, bool is_of_scenario) {
  constexpr int usual = 80;  // the paper's, and what `--realtime` gives
  const auto text =
      settings::warning(run.kernel, is_of_scenario ? campaign::application_priority(run) : usual);
  if (!text.empty()) print_error(text);
  if (const auto note = settings::without_effect(run.kernel); !note.empty()) print_error(note);
}

// For settings, and for root's journal, which lists what was applied.
void need_root(const char* what) {
  if (geteuid() != 0) throw Error(3, fmt::format("tune {} needs root. Fix: {}", what, campaign::as_root()));
}

int apply(const TuneArguments& arguments) {
  auto run = run_of(arguments);
  std::set<std::string> stated;
  for (const auto& said : arguments.sets)
    if (const auto [name, is_new] = stated.insert(set(run, said)); !is_new)
      throw wrong("--set: {} is given twice", *name);
  if (run.kernel.empty())
    throw Error(2,
                arguments.scenario.empty()
                    ? "nothing to set. Fix: --set NAME=VALUE, or --scenario SCENARIO --only ID"
                    : fmt::format("run '{}' states no kernel.* keys. Fix: --set NAME=VALUE", arguments.run));
  const auto link = link_of(arguments);
  for (const auto& setting : settings::table())
    if (setting.of_interface && link.interface.empty() && run.kernel.contains(setting.name))
      throw wrong("{} is a setting of an interface. Fix: --interface NAME, or --peer HOST", setting.name);
  if (!arguments.boot.empty()) {
    using settings::Form;
    const auto form =
        word_flag<Form>("--print", arguments.boot,
                        {{"systemd", Form::systemd}, {"tmpfiles", Form::tmpfiles}, {"shell", Form::shell}});
    print(settings::at_every_boot(form, run.kernel, settings::plan(run.kernel, link), link,
                                  {orders::this_program()}));
    return 0;
  }
  warn(run, !arguments.scenario.empty());
  std::vector<std::string> lines;
  if (arguments.dry_run) {
    for (const auto& change : settings::plan(run.kernel, link)) lines.push_back(in_words(change));
    print_lines(lines);
    return 0;
  }
  need_root("apply");
  // Signals are caught, so that none comes between the last change and keep().
  auto& interrupts = catch_interrupts();
  print_errors(journal::revert_abandoned(keeper::kinds()));
  journal::Journal journal(keeper::kinds());
  const auto restore = [&] { print_errors(journal.revert()); };
  std::vector<settings::Change> changes;
  try {
    changes = settings::apply(journal, run.kernel, link);
    settings::remember(journal, changes, link);
    for (const auto& change : changes) lines.push_back(in_words(change));
    try {
      print_lines(lines);          // first: where it cannot be written, nothing stays changed
    } catch (const ReaderGone&) {  // `| head` has what it wanted
    }
    if (interrupts > 0) {
      restore();
      return 130;
    }
    journal.keep();
  } catch (...) {
    restore();
    throw;
  }
  print_error("this lasts until `ontime tune revert` or a reboot");
  return 0;
}

int show(const TuneArguments& arguments) {
  const bool json_asked = is_json_flag(arguments.format);
  auto all = json::array();
  std::string text;
  for (const auto& state : settings::show(link_of(arguments))) {
    auto things = json::object();
    for (const auto& [thing, value] : state.things) things[thing.title()] = value;
    all.push_back({{"setting", state.setting->name},
                   {"values", state.setting->values},
                   {"now", things},
                   {"cannot", state.cannot.empty() ? json() : json(state.cannot)}});
    text += table::labelled(state.setting->name,
                            (state.things.empty() ? "-" : printable(settings::values_that_keep(state))) +
                                (state.cannot.empty() ? "" : " (" + printable(state.cannot) + ")"),
                            18, reading_columns());
  }
  if (json_asked)
    print_json(json{{"settings", all}});
  else
    print(text);
  return 0;
}

int verify(const TuneArguments& arguments) {
  const bool json_asked = is_json_flag(arguments.format);
  need_root("verify");
  const auto kept = journal::kept(keeper::kinds());
  if (kept.empty()) {
    print_error("nothing was applied since the last boot. See: ontime tune apply --help");
    return 1;
  }
  auto all = json::array();
  std::vector<std::string> lines;
  int code = 0;
  for (const auto& one : kept) {
    const bool is_so = one.unseen.empty() && one.now == one.after;
    if (!is_so) code = 1;
    const auto now = !one.unseen.empty() ? one.unseen : one.now.value_or("gone");
    all.push_back({{"kind", one.kind},
                   {"thing", one.what},
                   {"applied", one.after.value_or("")},
                   {"now", now},
                   {"is_so", is_so}});
    lines.push_back(fmt::format("{} {} {}: applied {}, {}{}", is_so ? "OK    " : "NOT OK", one.kind,
                                one.title, one.after.value_or(""),
                                one.unseen.empty() ? "is " : "now unknown: ", now));
  }
  if (json_asked)
    print_json(json{{"applied", all}});
  else
    print_lines(lines);
  return code;
}

int revert() {
  need_root("revert");
  journal::Journal journal(keeper::kinds());
  const auto given_back = journal.revert_kept();
  print_errors(given_back.left);  // first: where the output cannot be written, these are still told
  for (const auto& folder : journal::forgotten_directories(journal::time_of_boot()))
    print_error(fmt::format("{} is left from an ontime that a power cut ended. Fix: {}", folder,
                            table::shell_line({"rm", "-r", folder})));
  print_lines(given_back.done);
  if (given_back.done.empty() && given_back.left.empty()) print_error("nothing was applied");
  return given_back.finished ? 0 : 3;
}

}  // namespace

void add_tune(Command& app) {
  auto* command = app.add_subcommand(
      "tune", "Shows and changes this machine's settings: kernel threads and network path");
  command->require_subcommand();
  std::string settings = "Settings:\n";
  for (const auto& setting : settings::table())
    settings += fmt::format("  {:<32}{}\n", fmt::format("{}={}", setting.name, setting.values), setting.help);
  settings += "  preset=paper                    irq-threads=90 and ksoftirqd=60";
  auto arguments = std::make_shared<TuneArguments>();
  const auto add = [&](const char* name, const char* what, int (*act)(const TuneArguments&)) {
    auto* added = command->add_subcommand(name, what);
    added->calls([arguments, act] {
      try {
        return act(*arguments);
      } catch (const settings::WrongInput& error) {
        throw wrong("{}", error.what());
      }
    });
    return added;
  };
  const auto add_place = [&](Command* to) {
    add_link(*to, arguments->interface, arguments->peer, "the interface, for settings of an interface");
    add_value(*to, "--namespace", arguments->network_namespace, "NAME",
              "network namespace of the interface, as in ip netns");
  };
  auto* shown = add("show", "Shows each setting with its value, or why it cannot be set", show);
  add_place(shown);
  add_format(*shown, arguments->format);
  auto* applied = add("apply", "Applies settings, until revert or a reboot", apply);
  add_value(*applied, "--set", arguments->sets, "NAME=VALUE",
            "apply this setting, such as ksoftirqd=60; repeatable");
  constexpr const char* codes =
      "Exit codes: 0 OK · 2 invalid usage or input · 3 this machine cannot do it · 130 interrupted";
  applied->footer(settings + "\n\n" + codes);
  auto* scenario =
      add_value(*applied, "--scenario", arguments->scenario, "SCENARIO",
                "apply kernel.* of a run of this scenario: a file, or a name that `ontime scenarios` lists");
  add_value(*applied, "--only,--run", arguments->run, "ID", "id of that run")->needs("--scenario");
  scenario->needs("--only");
  add_place(applied);
  applied->add_flag("--dry-run", arguments->dry_run, "print what would change; change nothing");
  add_value(*applied, "--print", arguments->boot, "FORM",
            "print what applies it at every boot: systemd, tmpfiles or shell; change nothing")
      ->excludes("--dry-run");
  auto* verified = add("verify", "Checks whether applied values still hold", verify);
  verified->footer(
      "Exit codes: 0 all hold · 1 one has changed, or nothing was applied · 2 invalid usage or input · 3 "
      "this machine cannot do it");
  add_format(*verified, arguments->format);
  add("revert", "Restores what apply changed, and what a killed ontime left changed",
      [](const TuneArguments&) { return revert(); })
      ->footer(codes);
  add_tune_search(*command);
  command->footer(settings);  // last: the others would inherit it
}

}  // namespace ontime::app

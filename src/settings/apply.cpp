// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <charconv>
#include <functional>
#include <sstream>

#include <fmt/format.h>
#include <net/if.h>
#include <unistd.h>

#include "process/process.hpp"
#include "realtime/realtime.hpp"
#include "settings/kinds.hpp"

namespace ontime::settings {
namespace {

struct Wish {
  const Setting* setting;
  std::string asked;
};

// In the order of the table, after all checks that need no machine.
std::vector<Wish> in_order(const Wishes& wishes) {
  std::vector<Wish> all;
  for (const auto& setting : table())
    if (const auto wish = wishes.find(setting.name); wish != wishes.end()) {
      try {
        all.push_back({&setting, setting.stated(wish->second)});
      } catch (const std::invalid_argument& error) {
        throw Error(fmt::format("{}: {}", setting.name, error.what()));
      }
    }
  for (const auto& wished : wishes)
    if (std::ranges::none_of(all, [&](const Wish& wish) { return wished.first == wish.setting->name; }))
      throw Error(fmt::format("unknown setting '{}'", wished.first));
  return all;
}

void where_the_interface_is(const Link& link, const std::function<void()>& action) {
  if (!journal::is_interface_name(link.interface))
    throw journal::Error(
        fmt::format("interface name '{}': only letters, digits and _-.@ are supported. Fix: ip link set ... "
                    "name NAME",
                    link.interface));
  journal::within_namespace(link.network_namespace, [&] {
    if (if_nametoindex(link.interface.c_str()) == 0)
      throw Unknown(fmt::format("no interface {} on this machine (see ip link)", link.interface));
    action();
  });
}

// Runs the action in the network namespace in which the things of a setting are visible.
void where_it_is(const Setting& setting, const Link& link, const std::function<void()>& action) {
  if (!setting.of_interface) return journal::within_namespace("", action);
  if (link.interface.empty()) throw journal::Error("needs --interface");
  where_the_interface_is(link, action);
}

// As where_it_is(), with the setting's name in front of an error.
void by_name(const Setting& setting, const Link& link, const std::function<void()>& action) {
  try {
    where_it_is(setting, link, action);
  } catch (const Unknown& error) {
    throw WrongInput(fmt::format("{}: {}", setting.name, error.what()));
  } catch (const journal::Error& error) {
    throw Error(fmt::format("{}: {}", setting.name, error.what()));
  }
}

std::vector<Change> changes_of(const Wish& wish, const Link& link) {
  std::vector<Change> changes;
  by_name(*wish.setting, link, [&] {
    for (auto& thing : wish.setting->things(link.interface)) {
      const auto before = thing.kind->read(thing.what);
      if (!before) continue;  // a thread that has ended
      auto after = wish.setting->wanted(wish.asked, thing, *before);
      if (after.empty()) continue;  // another CPU's
      changes.push_back({wish.setting, std::move(thing), *before, std::move(after)});
    }
  });
  return changes;
}

// Whether another wish, such as threaded-napi=on, will create the things of this one.
bool will_come(const Wish& wish, const Wishes& wishes) {
  const auto other = wishes.find(wish.setting->comes_with);
  return other != wishes.end() && other->second == "on";
}

// Of "60", or "0=60,1=other".
int highest_priority(const std::string& asked) {
  int highest = 0;
  std::istringstream parts(asked);
  for (std::string part; std::getline(parts, part, ',');) {
    int number = 0;
    std::from_chars(part.data() + (part.find('=') + 1), part.data() + part.size(), number);
    highest = std::max(highest, number);
  }
  return highest;
}

}  // namespace

Wishes away_to(const std::string& cpus, const Link& link) {
  Wishes wishes = {{"workqueue-cpus", cpus}};
  if (link.interface.empty()) return wishes;
  const auto setting = std::ranges::find(table(), std::string_view("irq-cpus"), &Setting::name);
  by_name(*setting, link, [&] {
    if (hides_interrupts(link.interface))
      throw journal::Error(fmt::format(
          "not all receive interrupts of {} were found. Fix: leave this setting out, or name the interface "
          "below it, if any",
          link.interface));
    if (!interrupts_of(link.interface).empty()) wishes["irq-cpus"] = cpus;
  });
  return wishes;
}

std::vector<Change> plan(const Wishes& wishes, const Link& link) {
  std::vector<Change> all;
  for (const auto& wish : in_order(wishes)) {
    try {
      const auto changes = changes_of(wish, link);
      all.insert(all.end(), changes.begin(), changes.end());
    } catch (const Error&) {
      if (!will_come(wish, wishes)) throw;
      all.push_back({wish.setting, {nullptr, ""}, "", wish.asked});
    }
  }
  return all;
}

void require_writable(const std::vector<Change>& changes, const Link& link) {
  for (const auto& change : changes)
    if (change.thing.kind != nullptr && change.before != change.after)
      by_name(*change.setting, link, [&] {
        if (const auto why = read_only(change.thing); !why.empty()) throw journal::Error(why);
      });
}

std::vector<Change> apply(journal::Journal& journal, const Wishes& wishes, const Link& link) {
  if (!wishes.empty() && geteuid() != 0)
    throw Error(fmt::format("{} needs root. Fix: run as root", in_order(wishes).front().setting->name));
  require_writable(plan(wishes, link), link);
  std::vector<Change> all;
  try {
    for (const auto& wish : in_order(wishes))
      for (auto& change : changes_of(wish, link)) {
        by_name(*wish.setting, link,
                [&] { journal.change(*change.thing.kind, change.thing.what, change.after); });
        for (auto& earlier : all)  // a thread has a priority and CPUs, each by a setting of its own
          if (earlier.thing.kind == change.thing.kind && earlier.thing.what == change.thing.what)
            earlier.after = change.after;
        all.push_back(std::move(change));
      }
  } catch (...) {
    try {
      take_back(journal, all);
    } catch (const std::exception&) {  // it stays in the journal
    }
    throw;
  }
  return all;
}

void remember(journal::Journal& journal, const std::vector<Change>& changes, const Link& link) {
  for (const auto& change : changes)
    if (change.before == change.after)
      by_name(*change.setting, link, [&] { journal.remember(*change.thing.kind, change.thing.what); });
}

std::vector<std::string> take_back(journal::Journal& journal, const std::vector<Change>& changes) {
  std::vector<std::string> left;
  for (auto change = changes.rbegin(); change != changes.rend(); ++change) {
    const auto lines = journal.take_back(*change->thing.kind, change->thing.what);
    left.insert(left.end(), lines.begin(), lines.end());
  }
  return left;
}

journal::Value now(const Change& change, const Link& link) {
  journal::Value value;
  try {
    where_it_is(*change.setting, link, [&] { value = change.thing.kind->read(change.thing.what); });
  } catch (const journal::Error&) {
    return {};
  }
  return value;
}

std::vector<State> show(const Link& link) {
  try {
    if (!link.interface.empty()) where_the_interface_is(link, [] {});
  } catch (const Unknown& error) {
    throw WrongInput(error.what());
  }
  std::vector<State> states;
  for (const auto& setting : table()) {
    State state{&setting, {}, geteuid() == 0 ? "" : "needs root"};
    try {
      where_it_is(setting, link, [&] {
        for (auto& thing : setting.things(link.interface))
          if (const auto value = thing.kind->read(thing.what)) {
            if (state.cannot.empty()) state.cannot = read_only(thing);
            state.things.emplace_back(std::move(thing), *value);
          }
      });
    } catch (const journal::Error& error) {
      state.cannot = error.what();
    }
    states.push_back(std::move(state));
  }
  return states;
}

std::string warning(const Wishes& wishes, int application_priority) {
  std::string above;
  for (const auto* name : {"irq-threads", "ksoftirqd", "napi-threads"})
    if (const auto wish = wishes.find(name);
        wish != wishes.end() && highest_priority(wish->second) > application_priority)
      above += fmt::format("{}{} {}", above.empty() ? "" : ", ", name, wish->second);
  if (above.empty()) return "";
  return fmt::format(
      "{}: above the application's {}, so received packets of all programs are processed before it runs. "
      "Many packets of others then make messages late. Fix: measure with and without",
      above, application_priority == 0 ? "SCHED_OTHER" : std::to_string(application_priority));
}

std::string without_effect(const Wishes& wishes) {
  if (!wishes.contains("rt-throttling")) return "";
  const bool has_budget =
      std::ranges::any_of(realtime::budget_files(process::text_of("/proc/self/cgroup").value_or("")),
                          [](const auto& file) { return access(file.c_str(), F_OK) == 0; });
  const auto release = process::text_of("/proc/sys/kernel/osrelease").value_or("");
  if (realtime::throttles_real_time(release, has_budget)) return "";
  return "rt-throttling: it changes nothing for real-time threads, because Linux 6.12 and later have the "
         "fair server instead. See fair-server in `ontime check`";
}

}  // namespace ontime::settings

// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <ctime>
#include <functional>
#include <set>
#include <tuple>

#include <fmt/chrono.h>
#include <fmt/format.h>

#include "gate/gate.hpp"
#include "realtime/realtime.hpp"
#include "report/runs.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

using record::find;
using record::Outcome;

// How a run ended, if not as requested.
std::string ending(const Outcome& outcome) {
  if (outcome.counted_until_s) return "not ended (cut off or still running): recorded until {}";
  if (!outcome.has_ended()) return "not ended (cut off or still running): shows what is recorded so far";
  if (outcome.error) return "failed: " + word(*outcome.error);
  return outcome.interrupted ? "interrupted before its end" : "";
}

// A simulated machine's table must not pass for a robot's.
std::string simulated(const Outcome& outcome) {
  for (const auto& [name, host] : outcome.hosts)
    if (const auto& by = host.machine.simulated)
      return fmt::format("SIMULATED by {}: compares settings, predicts no real machine's times", word(*by));
  return "";
}

using Weight = Remark::Weight;
using Requirement = Remark::Requirement;

std::string utc_text(double unix_s) {
  constexpr double last = 253'402'300'799;  // of the year 9999
  return fmt::format("{:%F %T} UTC", fmt::gmtime(static_cast<std::time_t>(std::clamp(unix_s, 0.0, last))));
}
std::string percent_text(double share) { return percent(share) + " %"; }
// A damaged file may count more than an integer holds.
std::string number_text(double number) {
  return grouped(static_cast<std::uint64_t>(std::min(number, 0x1p63)));
}
std::string milliseconds_text(double ns) { return statistics::time_of(ns, 3); }

// A recording of a robot's messages has no ends.
bool is_one_machine(const statistics::Summary& summary) {
  return summary.run.asked.is_listened() || record::on_one_machine(summary.run.outcome);
}

// A share of each machine's CPUs, from `least` on. `words` has "{}" for it; `whose`: "controller's ", or ""
// of one machine.
void add_of_cpus(std::vector<Remark>& remarks, const statistics::Summary& summary,
                 double (*share)(const record::Activity&), double least,
                 std::string (*words)(const std::string& whose)) {
  const bool one_machine = is_one_machine(summary);
  for (const auto* host : record::both_hosts) {
    const auto seen = share(find(summary.run.outcome.conditions, host));
    if (seen < least) continue;
    remarks.push_back(
        {Weight::caution, words(one_machine ? "" : fmt::format("{}'s ", host)), seen, percent_text});
    if (one_machine) break;
  }
}

// Delays outside the network and the server: stolen CPU time, and the sender's own wake-up latency.
constexpr double much_stolen = 0.001;
void add_taken_away(std::vector<Remark>& remarks, const statistics::Summary& summary) {
  const auto stolen = [](const record::Activity& seen) { return seen.cpu_stolen.value_or(0); };
  add_of_cpus(remarks, summary, stolen, much_stolen, [](const std::string& whose) {
    return fmt::format("the hypervisor took {{}} of {}CPU time (steal)", whose.empty() ? "" : "the " + whose);
  });
  if (summary.shape.worst.empty() || summary.wake_up.count == 0) return;
  const auto& [took_ns, before, message, after] = summary.shape.worst.front();
  // A cycle that was skipped, or lost its message, may have waited longer for its answer.
  const bool is_open = summary.response.max == summary.open_wait_ns;
  if (took_ns < std::max(summary.lost_wait_ns, is_open ? 0 : summary.response.max)) return;
  const auto share =
      static_cast<double>(roundtrip::wake_up_latency_ns(message)) / static_cast<double>(took_ns);
  if (share >= 0.5)
    remarks.push_back({Weight::detail, "sender wake-up latency was {} of the longest answered wait",
                       std::min(share, 1.0), percent_text});
}

// docker --cpus, Kubernetes' limits, a unit's CPUQuota=.
void add_quota(std::vector<Remark>& remarks, const Outcome& outcome) {
  for (const auto& [whose, quota] : record::throttled(outcome))
    remarks.push_back(
        {Weight::caution,
         fmt::format(
             "a CPU quota of {:.3g} CPUs stopped {} control group for {{}}, added over CPUs. Fix: raise the "
             "quota (docker --cpus, Kubernetes limits.cpu, systemd CPUQuota=), or measure outside that group",
             quota.cpus, whose),
         static_cast<double>(quota.throttled_ns), milliseconds_text});
}

// By other programs, unless the run keeps the CPUs busy itself.
constexpr double all_busy = 0.9;
void add_other_load(std::vector<Remark>& remarks, const statistics::Summary& summary) {
  const auto& asked = summary.run.asked;
  const auto polls = [](const auto& options) {
    const auto found = options.find("busy-poll");
    return found != options.end() && found->second != "off";
  };
  if (!simulated(summary.run.outcome).empty() || summary.imported || asked.is_listened() ||
      asked.controller_load.any() || asked.component_load.any() || asked.traffic.any() ||
      asked.task.background.topics > 0 || asked.others.components > 0 ||
      asked.task.client.schedule == roundtrip::Schedule::back_to_back || polls(asked.task.config.options) ||
      polls(asked.component_options))
    return;
  // What a hypervisor took is told apart.
  const auto busy = [](const record::Activity& seen) {
    return seen.cpu_busy.value_or(0) - seen.cpu_stolen.value_or(0);
  };
  add_of_cpus(remarks, summary, busy, all_busy, [](const std::string& whose) {
    return fmt::format("the {}CPUs were {{}} busy, though this run requested no load", whose);
  });
}

// Clock events during the run.
constexpr double long_s = 0.1;         // more than two clocks are read apart on a busy machine
constexpr double much_slew_ppm = 500;  // beyond any crystal and the usual correction of a time service
std::vector<std::string> clocks(const statistics::Summary& summary) {
  std::vector<std::string> parts;
  const bool one_machine = is_one_machine(summary);
  for (const auto* host : record::both_hosts) {
    if (one_machine && host != std::string_view("controller")) continue;
    const std::string machine = one_machine ? "the machine" : fmt::format("the {}'s machine", host);
    const auto& activity = find(summary.run.outcome.conditions, host);
    const auto slept = activity.suspended_s.value_or(0), moved = activity.clock_moved_s.value_or(0),
               slewed = activity.clock_slew_ppm.value_or(0);
    if (slept >= long_s)
      parts.push_back(
          fmt::format("{} was suspended for {:.1f} s; no measured time includes that", machine, slept));
    if (std::abs(moved) >= long_s)
      parts.push_back(fmt::format("the system clock of {} was moved by {:+.1f} s; no measured time uses it",
                                  machine, moved));
    if (std::abs(slewed) >= much_slew_ppm)
      parts.push_back(fmt::format(
          "the clock of {} was slewed by {:+.0f} ppm; so are all its measured times. Fix: measure when its "
          "time service has settled",
          machine, slewed));
  }
  return parts;
}

// Whether a thread of this role was under real-time scheduling; any thread, if none has the role.
bool ran_in_real_time(const record::Host& host, const char* role) {
  bool of_role = false, any = false, has_role = false;
  for (const auto& thread : host.threads) {
    const auto& policy = thread.policy;
    const bool real_time = policy == "fifo" || policy == "rr" || policy == "deadline";
    any = any || real_time;
    if (thread.role != role) continue;
    has_role = true;
    of_role = of_role || real_time;
  }
  return has_role ? of_role : any;
}

// A kernel limit that takes the CPU from real-time threads in each second, and for how long.
struct Throttle {
  std::string name;
  double least_ns = 0;
};
std::optional<Throttle> throttle_of(const record::Machine& machine) {
  const auto runtime_us = machine.rt_runtime_us.value_or(-1), period_us = machine.rt_period_us.value_or(-1);
  const bool has_budget = runtime_us >= 0 && period_us > runtime_us;
  // RT throttling became the fair server: 50 ms of each second for ordinary threads. Kernels with
  // CONFIG_RT_GROUP_SCHED, of which the record knows nothing, have both.
  if (realtime::is_kernel_since(6, 12, machine.kernel_release))
    return Throttle{has_budget ? "fair server or RT throttling" : "fair server", 50e6};
  if (!has_budget) return std::nullopt;
  return Throttle{fmt::format("RT throttling (kernel.sched_rt_runtime_us is {})", runtime_us),
                  static_cast<double>(period_us - runtime_us) * 1e3};
}

void add_throttling(std::vector<Remark>& remarks, const statistics::Summary& summary) {
  const auto suspect = [&](const char* host, const char* role, const char* what, std::int64_t ns) {
    const auto& of = find(summary.run.outcome.hosts, host);
    const auto throttle = throttle_of(of.machine);
    if (!throttle || static_cast<double>(ns) < throttle->least_ns || !ran_in_real_time(of, role)) return;
    remarks.push_back({Weight::caution, fmt::format("{} {{}} late; likely cause: {}", what, throttle->name),
                       static_cast<double>(ns), milliseconds_text});
  };
  suspect("controller", "send", "sender woke", summary.wake_up.max);
  suspect("component", "receive", "server answered", summary.server.max);
  // A faulty or a full link delays as long by itself, and so does a repeated transmission.
  const auto& asked = summary.run.asked;
  const bool by_the_link = asked.faults.disturb() || !asked.faults.qdisc.empty() || asked.traffic.any() ||
                           std::ranges::any_of(summary.run.outcome.hosts, [](const auto& host) {
                             return host.second.losses.on_the_way > 0;
                           });
  if (summary.parts && !by_the_link)
    suspect("component", "receive", "server received",
            summary.parts->there.max - summary.parts->there[statistics::Figure::p50]);
}

// "at 3.2 s: the pong left".
constexpr std::size_t most_notes = 5;
std::string text_of(const record::Note& note, const statistics::Summary& summary) {
  auto text = report::text_of(note);
  if (note.message) text += fmt::format(" (message {})", *note.message);
  if (!note.at_ns || summary.start_ns == 0) return text;
  if (*note.at_ns < summary.start_ns) return "before the first message: " + text;
  return fmt::format("at {:.1f} s: {}", seconds_into(summary, *note.at_ns), text);
}

void add_notes(std::vector<Remark>& remarks, const statistics::Summary& summary) {
  std::vector<const record::Note*> notes, of_late;
  for (const auto& note : summary.notes)
    if (!note.kind.starts_with("search"))  // by these a search of settings resumes
      (record::tells_of_late(note) ? of_late : notes).push_back(&note);
  // Notes about the whole run first: notes about single messages may be many.
  std::stable_partition(notes.begin(), notes.end(),
                        [](const auto* note) { return !note->message && !note->at_ns; });
  const auto requirement_of = [](const auto* note) {
    return note->kind == gate::missed_note ? Requirement::missed
           : note->kind == gate::open_note ? Requirement::open
                                           : Requirement::none;
  };
  std::ranges::stable_sort(notes, std::greater(), requirement_of);
  std::size_t told = 0, left_out = 0;
  const auto tell = [&](std::string text, Requirement requirement) {
    if (told == most_notes) {
      ++left_out;
      return;
    }
    ++told;
    remarks.push_back({Weight::caution, std::move(text)});
    remarks.back().requirement = requirement;
  };
  for (const auto* note : notes) tell(text_of(*note, summary), requirement_of(note));
  for (const auto& [same, text, fix] : same_causes_of(of_late))
    tell(same.size() == 1 ? text_of(*same.front(), summary)
                          : printable(fmt::format("{} messages: {}{}", same.size(), text,
                                                  fix.empty() ? "" : "; fix: " + fix)),
         Requirement::none);
  if (left_out > 0) remarks.push_back({Weight::detail, many(left_out, "more note", "more notes")});
}

// A pong that died, a cable that was pulled: not every transport notices.
// One that waits for each answer sends few messages meanwhile: then time tells.
constexpr std::uint64_t surely_gone = 10, few = 3;  // messages
void add_silence(std::vector<Remark>& remarks, const statistics::Summary& summary) {
  if (summary.unanswered_at_end < few || summary.unanswered_at_end == summary.sent) return;
  const auto& client = summary.run.asked.task.client;
  const auto ns = [](auto count) { return static_cast<double>(count); };
  const auto silent_ns = ns(summary.start_ns) + ns(client.duration.count()) - ns(summary.unanswered_from_ns);
  const bool is_long = statistics::is_complete(summary.run) && summary.run.asked.faults.loss == 0 &&
                       silent_ns > 2 * ns(client.timeout.count());
  if (summary.unanswered_at_end < surely_gone && !is_long) return;
  remarks.push_back({Weight::caution, fmt::format("no answers from {:.1f} s to the end: {} messages",
                                                  seconds_into(summary, summary.unanswered_from_ns),
                                                  grouped(summary.unanswered_at_end))});
}

// Settings of a machine that another process changed during the run.
std::vector<std::string> changed_settings(const Outcome& outcome) {
  std::vector<std::string> parts;
  for (const auto& [name, host] : outcome.hosts)
    for (const auto& [group, settings] : {std::pair("kernel", &host.kernel), {"isolation", &host.isolation}})
      for (const auto& one : *settings)
        if (!one.lasted())
          parts.push_back(fmt::format("{}.{} changed during the run: at the end {} of the {} was {}, not {}",
                                      group, word(one.setting), word(one.thing), word(name),
                                      one.now.is_null() ? "gone" : word(one.now), word(one.after)));
  return parts;
}

std::string smaller_load(const gate::SmallerLoad& load) {
  if (load.divided_among > 0)
    return fmt::format(
        "the load on the {} was smaller than requested: an older ontime divided {} among {} {} workers",
        load.host, size(load.requested_bytes), load.divided_among, load.kind);
  return fmt::format(
      "HDD LOAD SHORTFALL on the {}: an hdd worker's file reached {}, requested: {}. Fix: measure longer, or "
      "lower hdd-bytes",
      load.host, size(load.had_bytes), size(load.requested_bytes));
}

}  // namespace

std::vector<Remark> remarks_of(const statistics::Summary& summary) {
  const auto& outcome = summary.run.outcome;
  std::vector<Remark> remarks;
  const auto add = [&](Weight weight, std::string text) {
    if (!text.empty()) remarks.push_back({weight, std::move(text)});
  };
  add(Weight::not_applied, ending(outcome));
  if (outcome.counted_until_s)
    remarks.back() = {Weight::not_applied, ending(outcome), static_cast<double>(*outcome.counted_until_s),
                      utc_text};
  if (const auto what = record::misfit_of(summary.run.asked, outcome); !what.empty())
    add(Weight::not_applied, "invalid " + printable(what) + " in the results file: not read");
  const bool was_asked = !summary.imported && !summary.run.asked.is_listened();
  if (was_asked && statistics::is_complete(summary.run) && statistics::unrecorded(summary.run) == 0 &&
      summary.sent == 0)
    add(Weight::not_applied, "no message was sent");
  add(Weight::caution, simulated(outcome));
  for (const auto& [name, host] : outcome.hosts)
    if (host.load_running == false)
      add(Weight::not_applied, "the load on the " + word(name) + " stopped before the end");
  for (const auto& load : gate::smaller_loads(summary.run.asked, outcome))
    add(Weight::not_applied, smaller_load(load));
  for (auto& remark : {traffic_remark(outcome), background_remark(outcome)}) add(remark.weight, remark.text);
  if (summary.run.asked.faults.any())
    for (const auto& [name, host] : outcome.hosts)
      if (const auto& gone = host.link.gone)
        add(Weight::not_applied, "LINK FAULTS NOT VERIFIED on the " + word(name) + ": " + word(*gone));
  if (outcome.link_unproved) add(Weight::caution, word(*outcome.link_unproved));
  for (const auto& text : changed_settings(outcome)) add(Weight::not_applied, text);
  add_notes(remarks, summary);
  add_silence(remarks, summary);
  add(Weight::detail, drops_text(outcome));
  add(Weight::detail, link_faults_text(outcome));
  add(Weight::detail, missed_launches_text(outcome));
  for (const auto& text : clocks(summary)) add(Weight::caution, text);
  const auto count = [&](Weight weight, const char* what, std::uint64_t number) {
    if (number > 0)
      remarks.push_back({weight, fmt::format("{}: {{}}", what), static_cast<double>(number), number_text});
  };
  // A few cycles leave the rate as it was: the longest wait tells of their stall.
  const auto skipped = static_cast<double>(summary.skipped_cycles);
  const auto sent = static_cast<double>(statistics::fates_of(summary).sent);
  const bool is_slower = sent < record::enough_of_request * (sent + skipped);
  count(is_slower ? Weight::caution : Weight::detail,
        is_slower ? "requested rate not reached; skipped cycles" : "skipped cycles", summary.skipped_cycles);
  add_taken_away(remarks, summary);
  add_quota(remarks, outcome);
  add_other_load(remarks, summary);
  add_throttling(remarks, summary);
  if (const auto text = losses_text(outcome, &record::Losses::overwritten, "at"); !text.empty())
    add(Weight::detail, "overwritten before they were read: " + text);
  if (const auto text = losses_text(outcome, &record::Losses::on_the_way, "to"); !text.empty())
    add(Weight::detail, "lost on the way: " + text);
  for (const auto& text : other_traffic(summary)) add(Weight::caution, text);
  add(Weight::detail, summary.no_parts);
  const auto& counters = outcome.counters;
  count(Weight::detail, "duplicates", counters.duplicates);
  count(Weight::detail, "stray answers", counters.strays);
  count(Weight::detail, summary.run.asked.is_listened() ? "messages out of order" : "answers out of order",
        counters.reordered);
  count(Weight::caution, "answers with another payload size, ignored", counters.wrong_size);
  count(Weight::caution, "answers with server times outside their round trips", counters.wrong_server_times);
  count(Weight::detail, "messages refused by the transport", counters.refused_sends);
  // A requirement that is open for it says so, too.
  if (const auto shift = statistics::shift_text(summary); std::ranges::none_of(
          remarks, [&](const auto& remark) { return remark.text.find(shift) != std::string::npos; }))
    add(Weight::caution, shift);
  if (summary.has_worst_only && !outcome.document.is_null())
    add(Weight::caution,
        "only samples around the worst late messages are kept; counts and times are of all messages, times "
        "within 1.6 %");
  else if (summary.run.asked.keeps_worst() && !outcome.has_ended())
    add(Weight::caution,
        "only samples around the worst late messages are kept; counts and times are of these");
  else
    count(Weight::caution, "samples not recorded (missing above)", counters.dropped_records);
  return remarks;
}

std::string remarks(const statistics::Summary& summary) {
  const auto text = [](const Remark& remark) {
    return remark.amount ? replace_all(remark.text, "{}", remark.shown(*remark.amount)) : remark.text;
  };
  return join(texts_of(remarks_of(summary), text), "; ");
}

std::string name_of_some(const std::vector<std::string>& names, const std::vector<std::size_t>& places) {
  constexpr std::size_t most_named = 3;
  if (places.size() == names.size() && names.size() > 1) return "all runs";
  std::vector<std::string> some;
  for (std::size_t i = 0; i < std::min(most_named, places.size()); ++i) some.push_back(names.at(places[i]));
  if (places.size() <= most_named) return join(some, ", ");
  return fmt::format("{} of {} runs ({}, …)", places.size(), names.size(), join(some, ", "));
}

std::vector<SharedRemark> shared_remarks(const Group& runs) {
  struct Gathered {
    Remark remark;
    double most = 0;
    std::vector<std::size_t> runs;
  };
  std::vector<Gathered> all;
  for (std::size_t run = 0; run < runs.size(); ++run)
    for (const auto& remark : remarks_of(*runs[run])) {
      auto same = std::ranges::find_if(all, [&](const Gathered& other) {
        return other.remark.text == remark.text &&
               other.remark.amount.has_value() == remark.amount.has_value();
      });
      if (same == all.end())
        same = all.insert(all.end(), {remark, remark.amount.value_or(0), {}});
      else if (remark.amount) {
        same->most = std::max(same->most, *remark.amount);
        same->remark.amount = std::min(*same->remark.amount, *remark.amount);
      }
      if (same->runs.empty() || same->runs.back() != run) same->runs.push_back(run);
    }
  std::vector<SharedRemark> shared;
  for (auto& [remark, most, of] : all) {
    auto text = remark.text;
    if (remark.amount) {
      const auto low = remark.shown(*remark.amount), high = remark.shown(most);
      text = replace_all(text, "{}", low == high ? low : fmt::format("{} to {}", low, high));
    }
    shared.push_back({remark.weight, std::move(text), std::move(of), remark.requirement, false});
  }
  return shared;
}

void gather_requirements(std::vector<SharedRemark>& remarks, const std::vector<std::string>& names) {
  for (const auto& [requirement, most, what] : {std::tuple(Remark::Requirement::open, 1, "open requirements"),
                                                {Remark::Requirement::missed, 2, "missed requirements"}}) {
    const auto is_told = [wanted = requirement](const auto& one) { return one.requirement == wanted; };
    if (std::ranges::count_if(remarks, is_told) <= most) continue;
    auto all = *std::ranges::find_if(remarks, is_told);  // "FAIL: p99 <= 1 ms: …"
    std::set<std::size_t> runs;
    for (const auto& remark : remarks)
      if (is_told(remark)) runs.insert(remark.runs.begin(), remark.runs.end());
    all.text = fmt::format("{} in {}, such as {}{}", what, many(runs.size(), "run", "runs"),
                           names.size() > 1 ? names[all.runs.front()] + ": " : "",
                           all.text.substr(all.text.find(' ') + 1));
    all.runs.assign(runs.begin(), runs.end());
    all.names_a_run = true;
    std::erase_if(remarks, is_told);
    remarks.insert(remarks.begin(), std::move(all));
  }
}

std::vector<std::string> remark_lines(const std::vector<std::string>& names, const Group& runs) {
  std::vector<std::pair<std::vector<std::size_t>, std::vector<std::string>>> notes;
  for (const auto& remark : shared_remarks(runs)) entry_of(notes, remark.runs).push_back(remark.text);
  return texts_of(notes, [&](const auto& note) {
    return name_of_some(names, note.first) + ": " + join(note.second, "; ");
  });
}

}  // namespace ontime::report

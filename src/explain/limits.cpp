// SPDX-License-Identifier: Apache-2.0
#include "explain/limits.hpp"

#include <algorithm>
#include <string_view>

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace ontime::explain {
namespace {

using roundtrip::Fate;
using Lines = std::vector<std::string>;

// Where the kernel traces every switch, none is inferred except after lost events.
void add_untold_switches(Lines& limits, const TracesByMessage& traces) {
  constexpr std::size_t surely_some = 10;
  std::map<std::pair<std::string, int>, std::size_t> inferred;
  for (const auto& [message, windows] : traces)
    for (const auto* trace : windows) {
      const auto& window = trace->window;
      for (const auto& [event, latest_ns] : scheduling_of(window.events, window.span.from_ns))
        if (latest_ns > event.at_ns && latest_ns >= window.span.from_ns) ++inferred[{trace->host, event.cpu}];
    }
  for (const auto& [place, switches] : inferred)
    if (switches >= surely_some)
      limits.push_back(
          fmt::format("the {}'s kernel does not trace all thread switches of CPU {}: ontime infers them from "
                      "later events; the time until then is unknown",
                      place.first, place.second));
}

void add_throttled(Lines& limits, const record::Run& run) {
  for (const auto& [whose, quota] : record::throttled(run.outcome))
    limits.push_back(fmt::format(
        "a CPU quota of {:.3g} CPUs stopped {} control group in {} of the quota's periods, for {:.1f} s "
        "added over CPUs. No event shows such a stop: where other threads ran meanwhile, it counts as a wait "
        "for a CPU. Fix: raise the quota; it does not stop real-time threads",
        quota.cpus, whose, quota.throttled_periods, static_cast<double>(quota.throttled_ns) / 1e9));
}

void add_untraced(Lines& limits, const record::Run& run) {
  if (!run.outcome.trace) return;
  for (const auto& [host, traced] : *run.outcome.trace) {
    if (!traced.error.empty()) limits.push_back(fmt::format("no trace from the {}: {}", host, traced.error));
    for (const auto& what : traced.missing)
      limits.push_back(fmt::format("the {}'s kernel does not trace {}", host, what));
  }
}

void add_not_looked_at(Lines& limits, const Account& account) {
  std::uint64_t late = 0, lost = 0, in_part = 0, without_times = 0;
  for (const auto& message : account.messages) {
    lost += message.sample.fate == Fate::lost ? 1 : 0;
    late += message.is_fault() && message.sample.fate != Fate::lost ? 1 : 0;
    in_part += message.whole ? 0 : 1;
    without_times += message.sample.fate == Fate::lost || has_server_times(message.sample) ? 0 : 1;
  }
  const auto all_late = account.late + account.late_by_response + account.after_skipped;
  Lines examined;
  if (late < all_late)
    examined.push_back(
        fmt::format("the worst {} of {} messages that {}", late, all_late,
                    account.after_skipped > 0 ? "were late or came after skipped cycles" : "were late"));
  if (lost < account.lost)
    examined.push_back(fmt::format("the first {} of {} lost messages", lost, account.lost));
  if (!examined.empty()) limits.push_back(fmt::format("examined: {}", fmt::join(examined, " and ")));
  if (in_part > 0)
    limits.push_back(fmt::format("incomplete trace of {} message{}: more events than ontime keeps", in_part,
                                 in_part == 1 ? "" : "s"));
  if (without_times > 0)
    limits.push_back(fmt::format(
        "{} message{} without the server's times: the time from sending to the answer is one part",
        without_times, without_times == 1 ? "" : "s"));
}

// With two machines, the trace of one shows nothing about the other.
void add_one_sided(Lines& limits, const Account& account, const record::Run& run,
                   const TracesByMessage& traces) {
  const auto traced = run.outcome.trace.value_or(record::ByName<record::Traced>());
  for (const auto* host : record::both_hosts) {
    const auto is_seen = [&](const auto& message) {
      return std::ranges::any_of(message.second, [&](const auto* trace) { return trace->host == host; });
    };
    if (!traces.empty() && std::ranges::none_of(traces, is_seen)) {
      const auto* const remedy =
          !is_by_hand(run) ? ""
          : host == std::string_view("component")
              ? ". Fix: ontime pong --explain --results FILE there, then ontime explain … --pong FILE"
              : ". Fix: ontime ping --explain";
      if (record::find(traced, host).error.empty())  // otherwise add_untraced reports the error
        limits.push_back(fmt::format("no trace from the {}{}", host, remedy));
      continue;
    }
    std::size_t faults = 0, of_others = 0;
    for (const auto& message : account.messages) {
      if (!message.is_fault()) continue;
      ++faults;
      of_others += is_seen(*traces.find(message.sample.index)) ? 0 : 1;
    }
    if (of_others > 0)
      limits.push_back(
          fmt::format("no trace from the {} for {} of {} late and lost messages", host, of_others, faults));
  }
}

}  // namespace

bool is_by_hand(const record::Run& run) { return !run.outcome.hosts.contains("component"); }

std::vector<std::string> limits_of(const Account& account, const record::Run& run,
                                   const TracesByMessage& traces, bool one_machine,
                                   std::optional<std::int64_t> clocks_ns) {
  Lines limits;
  add_throttled(limits, run);
  add_untraced(limits, run);
  add_not_looked_at(limits, account);
  if (!one_machine) add_one_sided(limits, account, run, traces);
  if (clocks_ns)
    limits.push_back(fmt::format(
        "clock error between the machines: ±{:.1f} µs; the part of each machine may be wrong by that much",
        static_cast<double>(*clocks_ns) / 1e3));
  add_untold_switches(limits, traces);
  return limits;
}

}  // namespace ontime::explain

// SPDX-License-Identifier: Apache-2.0
#include "statistics/clocks.hpp"

#include <algorithm>
#include <utility>

#include <fmt/format.h>

namespace ontime::statistics {
namespace {

// A PTP clock knows its offset from its grandmaster, which may have any time; other clocks know theirs from
// UTC.
bool have_one_reference(const record::Clock& client, const record::Clock& server) {
  if (client.source != "ptp" && server.source != "ptp") return true;
  return client.source == server.source && !client.reference.empty() && client.reference == server.reference;
}

}  // namespace

std::optional<RoundTripParts::Clocks> RoundTripParts::clocks_of(const record::Outcome& outcome) {
  if (record::on_one_machine(outcome)) return Clocks{.one = true};
  const auto& client = record::find(outcome.hosts, "controller").machine.clock;
  const auto& server = record::find(outcome.hosts, "component").machine.clock;
  if (!have_one_reference(client, server)) return {};
  Clocks clocks{};
  for (const auto* clock : {&client, &server}) {
    const auto error_ns = clock->error_ns.value_or(-1);
    const auto offset_ns = clock->realtime_offset_ns;
    if (!clock->synchronised || error_ns < 0 || !offset_ns) return {};
    if (__builtin_add_overflow(clocks.error_ns, error_ns, &clocks.error_ns)) return {};
    const auto moved_ns = clock->moved_ns.value_or(0);
    if (moved_ns > error_ns || moved_ns < -error_ns) clocks.moved_ns = moved_ns;
    // By way of the time of day, which both know: client = server + server's offset - client's offset.
    clocks.ahead_ns = clock == &client ? between(*offset_ns, 0) : nth_after(clocks.ahead_ns, *offset_ns, 1);
  }
  return clocks;
}

RoundTripParts::RoundTripParts(const record::Outcome& outcome) : clocks_(clocks_of(outcome)) {}

void RoundTripParts::message(const roundtrip::Sample& sample) {
  if (!clocks_) return;
  const auto there_ns = between(sample.sent_ns, nth_after(sample.server_received_ns, clocks_->ahead_ns, 1));
  const auto back_ns = between(nth_after(sample.server_sent_ns, clocks_->ahead_ns, 1), sample.received_ns);
  there_.add(there_ns);
  back_.add(back_ns);
  least_ns_ = std::min({least_ns_, there_ns, back_ns});
}

void RoundTripParts::into(Summary& summary) && {
  if (!clocks_ || there_.count() == 0) return;
  if (clocks_->moved_ns != 0) {
    summary.no_parts =
        fmt::format("request and reply legs unknown: a clock was set by {:.1f} µs during the run",
                    static_cast<double>(clocks_->moved_ns) / 1e3);
    return;
  }
  if (least_ns_ < -clocks_->error_ns) {
    const auto by_us = static_cast<double>(least_ns_) / 1e3;
    summary.no_parts =
        clocks_->one
            ? fmt::format(
                  "request and reply legs unknown: one would be {:.1f} µs, though both ends report one clock",
                  by_us)
            : fmt::format(
                  "request and reply legs unknown: one would be {:.1f} µs, beyond the clocks' stated error "
                  "of ±{:.1f} µs",
                  by_us, static_cast<double>(clocks_->error_ns) / 1e3);
    return;
  }
  summary.parts = {Ranks(std::move(there_)).distribution(), Ranks(std::move(back_)).distribution(),
                   clocks_->error_ns, clocks_->one};
}

}  // namespace ontime::statistics

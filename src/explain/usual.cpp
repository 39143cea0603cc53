// SPDX-License-Identifier: Apache-2.0
#include "explain/usual.hpp"

#include <utility>

#include "statistics/values.hpp"

namespace ontime::explain {

using roundtrip::Sample;

Usual::Usual(const record::Reader& reader, std::int64_t run, bool one_clock)
    : clocks_(one_clock ? Drift() : Drift(reader, run)) {
  std::array<statistics::Values, legs + 1> on_time, late;
  reader.each_sample(run, [&](const Sample& sample) {
    if (sample.received_ns == 0) return;
    const auto way = of(sample);
    auto& all = sample.fate == roundtrip::Fate::on_time ? on_time : late;
    const auto known = has_server_times(sample) ? legs : senders_legs;
    for (std::size_t leg = 0; leg < known; ++leg) all[leg].add(way[leg].length_ns());
    all[legs].add(sample.received_ns - sample.sent_ns);
  });
  is_of_on_time_ = on_time[senders_legs].count() > 0;
  for (std::size_t leg = 0; leg <= legs; ++leg) {
    statistics::Ranks all(std::move(on_time[leg].count() == 0 ? late[leg] : on_time[leg]));
    if (all.count() > 0) medians_[leg] = all.at_rank(all.count() / 2 + 1);
  }
}

std::array<Leg, legs> Usual::of(const Sample& sample) const {
  const auto later_ns = server_later_ns(sample.sent_ns);
  const auto there_ns = sample.server_received_ns + later_ns, back_ns = sample.server_sent_ns + later_ns;
  return {{{awaited_since_ns(sample), sample.woke_ns},
           {sample.woke_ns, sample.sent_ns},
           {sample.sent_ns, there_ns},
           {there_ns, back_ns},
           {back_ns, sample.received_ns}}};
}

}  // namespace ontime::explain

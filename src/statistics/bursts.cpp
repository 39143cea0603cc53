// SPDX-License-Identifier: Apache-2.0
#include "statistics/bursts.hpp"

#include <algorithm>

#include "statistics/times.hpp"

namespace ontime::statistics {

using roundtrip::Fate;

void Misses::message(const roundtrip::Sample& sample) {
  late_.add(sample.fate == Fate::late);
  lost_.add(sample.fate == Fate::lost);
  missed_.add(sample.fate != Fate::on_time);
  if (sample.fate == Fate::on_time) return close();
  if (in_a_row_++ == 0) from_ns_ = sample.due_ns;
  to_ns_ = sample.fate == Fate::lost ? nth_after(sample.sent_ns, timeout_ns_, 1) : sample.received_ns;
  bursts_.longest = std::max(bursts_.longest, in_a_row_);
  bursts_.longest_ns = std::max(bursts_.longest_ns, between(from_ns_, to_ns_));
}

void Misses::close() {
  if (in_a_row_ > 1) ++bursts_.count;
  in_a_row_ = 0;
}

void Misses::into(Summary& summary, double effect) && {
  close();
  const bool late = knows_late(summary.run), loss = knows_loss(summary.run);
  if (late) summary.late_probability = probability(late_.all(), effect);
  if (loss) summary.lost_probability = probability(lost_.all(), effect);
  if (late || loss) summary.missed_probability = probability(missed_.all(), effect);
  summary.bursts = bursts_;
}

}  // namespace ontime::statistics

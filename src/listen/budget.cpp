// SPDX-License-Identifier: Apache-2.0
#include "listen/budget.hpp"

#include <algorithm>

namespace ontime::listen {

Budget::Step Budget::look(Time now, Time taken) {
  const auto elapsed = now - span_.begin;
  const auto within = [&](Time time) {
    return std::chrono::duration<double>(taken - span_.taken) <= share_ * std::chrono::duration<double>(time);
  };
  const auto begin_span = [&](Step step) {
    span_ = {now, taken};
    return step;
  };
  if (is_paused()) {
    if (!within(elapsed)) return Step::none;
    paused_for_ += now - paused_at_;
    paused_at_ = Time::max();
    return begin_span(Step::resume);
  }
  if (elapsed < shortest) return Step::none;
  if (within(std::max<Time>(elapsed, balanced_within))) {
    // Time that a span did not use is not saved for later spans.
    return elapsed < balanced_within ? Step::none : begin_span(Step::none);
  }
  if (records_kernel_events_) {
    records_kernel_events_ = false;
    return begin_span(Step::drop_kernel_events);
  }
  ++pauses_;
  paused_at_ = now;
  return Step::pause;
}

double Budget::listened_share(Time now) const {
  const auto paused = paused_for_ + (is_paused() ? now - paused_at_ : Time(0));
  const auto all = now - began_;
  return all <= Time(0) ? 1 : 1 - std::chrono::duration<double>(paused) / std::chrono::duration<double>(all);
}

}  // namespace ontime::listen

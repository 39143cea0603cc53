// SPDX-License-Identifier: Apache-2.0
// A flight recorder in a file of the test, and what it is given.
#pragma once

#include <memory>

#include "listen_results.hpp"
#include "record_fixture.hpp"

namespace ontime::app {

inline constexpr std::int64_t ms = 1'000'000;

class Recorder : public record::RecordTest {
 protected:
  static listen::Flow flow(std::uint64_t id, std::uint32_t reader = 2) {
    listen::Flow flow;
    flow.id = id;
    flow.topic = "/cmd_vel";
    flow.writer = {1, "controller"};
    flow.reader = {reader, "base"};
    return flow;
  }
  // Of the one that comes now, so long after the one before.
  void period(ListenResults& results, std::uint64_t flow, std::int64_t ns) {
    results.keep({.flow = flow,
                  .quantity = listen::Row::Quantity::period,
                  .index = index_++,
                  .from_ns = now_ns_,
                  .to_ns = now_ns_ + ns,
                  .is_late = limits_.is_gap(ns)});
    now_ns_ += ns;
  }
  // As an explainer leaves it, with so many events.
  listen::Miss miss(std::uint64_t flow, std::int64_t ns, int events = 200) const {
    listen::Miss miss;
    miss.kind = listen::Miss::Kind::gap;
    miss.value_ns = ns;
    miss.flow = flow;
    auto around = std::make_shared<listen::Surroundings>();
    around->window = {{0, now_ns_ - ns, now_ns_ + 100 * ms}, true, {}};
    for (int i = 0; i < events; ++i)
      around->window.events.push_back({.at_ns = now_ns_ - ns + i,
                                       .kind = trace::Kind::switched,
                                       .thread = {i, "a thread", 120},
                                       .other = {i + 1, "another", 120},
                                       .what = "S"});
    miss.surroundings = around;
    miss.course.taken_ns = now_ns_;
    miss.why = listen::Why{.is_seen = true, .cause = "cpu", .sentence = "the reader waited", .ns = 4 * ms};
    return miss;
  }

  const listen::Limits limits_{.deadline = std::chrono::milliseconds(60), .period = {}, .age = {}};
  std::uint64_t index_ = 0;
  std::int64_t now_ns_ = 1000 * ms;
};

}  // namespace ontime::app

// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <thread>

#include "listen/clock_steps.hpp"
#include "listen/listen.hpp"
#include "listen/wire.hpp"
#include "machine/machine.hpp"
#include "transport/transport.hpp"

namespace ontime::listen {
namespace {

class Reader final : public Sensor {
 public:
  Reader(std::unique_ptr<transport::Hearing> hearing, const Limits& limits)
      : hearing_(std::move(hearing)), limits_(limits), wire_(limits, false) {}

  bool listen_for(std::chrono::milliseconds most) override {
    const auto until = std::chrono::steady_clock::now() + most;
    do {
      const std::chrono::nanoseconds from = std::chrono::system_clock::now().time_since_epoch();
      const std::chrono::nanoseconds steady = std::chrono::steady_clock::now().time_since_epoch();
      // What is heard next may be of both times.
      const bool was_set =
          clock_.look((from - steady).count(), steady.count(), machine::realtime_offset_ns) != 0;
      hearing_->take([&](const transport::Heard& heard) {
        if (was_set) wire_.interrupt();
        add(heard);
      });
      read_ns_ = from.count();
      if (was_set) {
        const std::chrono::nanoseconds now = std::chrono::system_clock::now().time_since_epoch();
        wire_.set_clock(read_ns_, std::max(read_ns_, now.count()));
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    } while (std::chrono::steady_clock::now() < until);
    return true;
  }

  Findings findings() const override {
    auto findings = wire_.findings();
    judge_silence(findings.flows, limits_, read_ns_ - unread_ns);
    clock_.remark(findings.remarks, "Periods and losses");
    for (auto& remark : hearing_->remarks()) findings.remarks.push_back(std::move(remark));
    findings.remarks.emplace_back(
        "--reader is the last resort: each writer also sends to ontime's reader. ontime judges only what "
        "arrives there, not what the robot's own readers take");
    return findings;
  }

  std::vector<Miss> take_misses() override { return wire_.take_misses(); }

  void keep_rows(KeepRow keep) override { wire_.keep_rows(origin_.shifted(std::move(keep))); }

 private:
  void add(const transport::Heard& heard) {
    origin_.begin(heard.at_ns);
    rtps::Data data{};
    data.writer.bytes = heard.writer;
    data.sequence = heard.sequence;
    if (heard.stamp_ns > 0) data.stamp_ns = heard.stamp_ns;
    wire_.name_topic(data.writer, std::string(heard.topic));
    wire_.add(heard.at_ns,
              {.source = heard.is_one_host ? "this machine" : "another machine",
               .destination = "ontime's reader",
               .is_one_host = heard.is_one_host,
               .payload = {}},
              data);
  }

  const std::unique_ptr<transport::Hearing> hearing_;
  const Limits limits_;
  Origin origin_;
  Wire wire_;
  std::int64_t read_ns_ = 0;  // all until then was read
  ClockSteps clock_;
};

}  // namespace

std::unique_ptr<Sensor> as_reader(std::unique_ptr<transport::Hearing> hearing, const Limits& limits) {
  return std::make_unique<Reader>(std::move(hearing), limits);
}

}  // namespace ontime::listen

// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <random>
#include <thread>

#include <pthread.h>
#include <unistd.h>

#include "roundtrip/clock.hpp"
#include "roundtrip/ledger.hpp"
#include "roundtrip/receiver.hpp"

namespace ontime::roundtrip {
namespace {

constexpr std::int64_t ms = 1'000'000;

struct ScheduleWord {
  Schedule schedule;
  const char* word;
};
constexpr std::array<ScheduleWord, 3> schedules{{{Schedule::next_free, "next-free"},
                                                 {Schedule::fixed, "fixed"},
                                                 {Schedule::back_to_back, "back-to-back"}}};

// A message stays in the ledger until its time-out, and a sender that was kept from running for a while sends
// all that it missed at once. Samples wait for an ordinary thread, which a loaded machine may hold up for
// seconds.
Ledger::Size size_of(const ClientOptions& options) {
  if (options.schedule == Schedule::back_to_back) return {64, std::size_t{1} << 19};
  const auto period_ns = std::max<std::int64_t>(options.period.count(), 1);
  const bool several = options.schedule == Schedule::fixed;
  const auto in_flight = several ? static_cast<std::size_t>(2 * options.timeout.count() / period_ns) : 64;
  const auto samples = static_cast<std::size_t>(10'000 * ms / period_ns);
  return {std::max<std::size_t>(in_flight, 1024), std::max<std::size_t>(samples, 1 << 16)};
}

}  // namespace

const char* word_of(Schedule schedule) {
  return std::find_if(schedules.begin(), schedules.end(),
                      [&](const auto& s) { return s.schedule == schedule; })
      ->word;
}

std::optional<Schedule> schedule_of(const std::string& word) {
  for (const auto& schedule : schedules)
    if (word == schedule.word) return schedule.schedule;
  return {};
}

class Client::Measurement final : public transport::Sink {
 public:
  Measurement(const transport::Plugin& plugin, const transport::Config& config, const ClientOptions& options)
      : options_(options),
        ledger_(options.deadline.count(), options.timeout.count(), size_of(options)),
        payload_(options.payload_bytes),
        session_(std::random_device{}() >> 8),
        warm_up_session_((session_ + 1) & 0xffffff),
        endpoint_(plugin.open(config, *this)),
        receiver_(*endpoint_, config.receive),
        sender_([this] { send(); }) {
    sender_tid_.wait(0);
  }

  ~Measurement() {
    for (auto* alarm : {&stop_, &start_, &leave_}) alarm->ring();
    sender_.join();
  }

  // Real-time: on the transport's thread, or on the receiver's.
  void arrived(std::uint64_t sequence, std::span<std::byte> payload, std::int64_t at_ns) noexcept override {
    const auto session = message::session_of(sequence);
    if (session == session_) {
      const bool first = ledger_.arrived(message::index_of(sequence), at_ns, message::server_times(payload));
      if (first && options_.schedule == Schedule::back_to_back) follow(at_ns);
    } else if (session == warm_up_session_) {
      warm_up_answers_.fetch_add(1, std::memory_order_relaxed);
    } else if (state_.load(std::memory_order_relaxed) == State::measuring) {
      ledger_.stray();
    }
  }

  std::vector<Thread> threads() {
    auto threads = receiver_.threads();
    threads.insert(threads.begin(), {sender_tid_, "send", sender_name});
    for (auto& thread : endpoint_->threads()) threads.push_back(std::move(thread));
    return threads;
  }

  transport::Endpoint& endpoint() { return *endpoint_; }
  void start() { start_.ring(); }
  void stop() { stop_.ring(); }
  State state() const { return state_; }
  std::uint64_t warm_up_answers() const { return warm_up_answers_; }
  Counters counters() const { return ledger_.counters(); }
  std::size_t drain(std::span<Sample> samples) { return ledger_.drain(samples); }

 private:
  static constexpr const char* sender_name = "ontime-send";

  // The sending thread.
  void send() noexcept {
    pthread_setname_np(pthread_self(), sender_name);
    sender_tid_ = gettid();
    sender_tid_.notify_one();
    start_.wait();
    warm_up();
    state_ = State::measuring;
    switch (options_.schedule) {
      case Schedule::next_free:
        send_next_free();
        break;
      case Schedule::fixed:
        send_fixed();
        break;
      case Schedule::back_to_back:
        send_back_to_back();
        break;
    }
    while (!ledger_.idle()) {
      pause(std::min(options_.timeout.count(), ms));
      ledger_.settle(now_ns());
    }
    state_ = State::finished;
    leave_.wait();  // until then it is still there to be read: its policy, its faults
  }

  void warm_up() noexcept {
    state_ = State::warming_up;
    const auto pause_ns = std::min(options_.period.count(), 10 * ms);
    for (std::uint64_t index = 0; warm_up_answers() < options_.warm_up && !stop_.rung(); ++index) {
      endpoint_->send(message::sequence_of(warm_up_session_, index), payload_);
      stop_.sleep_until(now_ns() + pause_ns);
    }
  }

  void post(std::int64_t intended_ns, std::int64_t due_ns, std::int64_t woke_ns) noexcept {
    const auto skipped =
        static_cast<std::uint32_t>((due_ns - intended_ns) / std::max<std::int64_t>(period_ns_, 1));
    const auto index = ledger_.post({intended_ns, due_ns, woke_ns, now_ns(), skipped});
    last_posted_.store(index, std::memory_order_relaxed);
    if (!endpoint_->send(message::sequence_of(session_, index), payload_)) ledger_.refused();
  }

  void send_next_free() noexcept {
    const auto first_ns = now_ns() + period_ns_;
    const auto end_ns = first_ns + options_.duration.count();
    auto intended_ns = first_ns;
    for (auto due_ns = first_ns; due_ns < end_ns; due_ns += period_ns_) {
      const auto past = (now_ns() - due_ns) / period_ns_;
      if (past > 0)
        due_ns += past * period_ns_;  // cycles that went by while this thread was kept from running
      if (due_ns >= end_ns) return;
      stop_.sleep_until(due_ns);
      const auto woke_ns = now_ns();
      if (stop_.rung()) return;
      ledger_.settle(woke_ns);
      if (!ledger_.idle()) continue;
      post(intended_ns, due_ns, woke_ns);
      intended_ns = due_ns + period_ns_;
    }
  }

  void send_fixed() noexcept {
    const auto first_ns = now_ns() + period_ns_;
    const auto end_ns = first_ns + options_.duration.count();
    auto intended_ns = first_ns;
    for (auto due_ns = first_ns; due_ns < end_ns; due_ns += period_ns_) {
      stop_.sleep_until(due_ns);
      const auto woke_ns = now_ns();
      if (stop_.rung()) return;
      ledger_.settle(woke_ns);
      if (ledger_.full()) continue;  // only when a long stall and a long time-out meet
      post(intended_ns, due_ns, woke_ns);
      intended_ns = due_ns + period_ns_;
    }
  }

  // Here the receiving thread sends; this one starts it, and goes on where a message was lost.
  void send_back_to_back() noexcept {
    if (stop_.rung()) return;
    back_to_back_end_ns_ = now_ns() + options_.duration.count();
    const auto start_ns = now_ns();
    post(start_ns, start_ns, start_ns);
    while (!back_to_back_done_.load(std::memory_order_acquire)) {
      pause(std::min(options_.timeout.count(), 10 * ms));
      const auto at_ns = now_ns();
      if (ledger_.expire(last_posted_.load(std::memory_order_relaxed), at_ns)) follow(at_ns);
    }
  }

  // By whoever settled the last message, and so owns the ledger.
  void follow(std::int64_t at_ns) noexcept {
    ledger_.settle(at_ns);
    if (stop_.rung() || at_ns >= back_to_back_end_ns_)
      back_to_back_done_.store(true, std::memory_order_release);
    else
      post(at_ns, at_ns, at_ns);
  }

  static void pause(std::int64_t ns) noexcept {
    const timespec time{ns / 1'000'000'000, ns % 1'000'000'000};
    clock_nanosleep(CLOCK_MONOTONIC, 0, &time, nullptr);
  }

  const ClientOptions options_;
  const std::int64_t period_ns_ = options_.period.count();
  Ledger ledger_;
  std::vector<std::byte> payload_;
  const std::uint32_t session_, warm_up_session_;
  std::atomic<State> state_{State::waiting};
  std::atomic<std::uint64_t> warm_up_answers_{0};
  std::atomic<std::uint64_t> last_posted_{0};
  std::atomic<std::int64_t> back_to_back_end_ns_{0};
  std::atomic<bool> back_to_back_done_{false};
  Alarm start_, stop_, leave_;
  std::atomic<pid_t> sender_tid_{0};
  // Last, for they use all of the above from their first moment, and are gone before it.
  std::unique_ptr<transport::Endpoint> endpoint_;
  Receiver receiver_;
  std::thread sender_;
};

Client::Client(const transport::Plugin& plugin, const transport::Config& config, const ClientOptions& options)
    : measurement_(std::make_unique<Measurement>(plugin, config, options)) {}
Client::~Client() = default;
transport::Endpoint& Client::endpoint() { return measurement_->endpoint(); }
std::vector<Thread> Client::threads() { return measurement_->threads(); }
void Client::start() { measurement_->start(); }
void Client::stop() { measurement_->stop(); }
Client::State Client::state() const { return measurement_->state(); }
std::uint64_t Client::warm_up_answers() const { return measurement_->warm_up_answers(); }
Counters Client::counters() const { return measurement_->counters(); }
std::size_t Client::drain(std::span<Sample> samples) { return measurement_->drain(samples); }

}  // namespace ontime::roundtrip

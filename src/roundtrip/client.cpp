// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <limits>
#include <random>
#include <thread>

#include <pthread.h>
#include <unistd.h>

#include "roundtrip/alarm.hpp"
#include "roundtrip/cycles.hpp"
#include "roundtrip/ledger.hpp"
#include "roundtrip/receiver.hpp"
#include "transport/clock.hpp"

namespace ontime::roundtrip {
namespace {

using transport::now_ns;

constexpr std::int64_t ms = 1'000'000;

// A message stays in the ledger until its time-out, and then for as long again, should its answer have been
// held up on its way to the ledger. Samples wait for an ordinary thread, which a loaded machine may hold up
// for seconds, and which itself is to be seldom on the CPU.
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
  constexpr std::array words{"next-free", "fixed", "back-to-back"};  // in the order of the enumeration
  return words.at(static_cast<std::size_t>(schedule));
}

class Client::Measurement final : public transport::Sink {
  friend class Client;

 public:
  Measurement(const transport::Plugin& plugin, const transport::Config& config, const ClientOptions& options)
      : options_(options),
        launch_ns_(config.launch_ns),
        ledger_(options.deadline.count(), options.timeout.count(), size_of(options),
                options.schedule == Schedule::fixed ? Ledger::From::due : Ledger::From::sent),
        payload_(options.payload_bytes),
        session_(std::random_device{}() >> 8),
        warm_up_session_(message::warm_up_session_of(session_)),
        endpoint_(plugin.open(config, *this)),
        receiver_(*endpoint_, config.receive),
        sender_([this] { send(); }) {
    sender_tid_.wait(0);
  }

  ~Measurement() {
    stop();
    leave_.ring();
    sender_.join();
  }

  // Real-time: on the transport's thread, or on the receiver's.
  void arrived(std::uint64_t sequence, std::span<std::byte> payload, std::int64_t at_ns) noexcept override {
    const auto session = message::session_of(sequence);
    const bool ours = session == session_ || session == warm_up_session_;
    if (ours && payload.size() != payload_.size()) {
      ledger_.wrong_size();
    } else if (session == session_) {
      const bool first = ledger_.arrived(message::index_of(sequence), at_ns, message::server_times(payload));
      if (first && options_.schedule == Schedule::back_to_back) follow(at_ns);
    } else if (ours) {
      const auto index = message::index_of(sequence);
      if (index + 1 > warm_up_answered_) warm_up_answered_ = index + 1;
      ++warm_up_answers_;
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

  void stop() {
    auto not_yet = never_ns;
    stopped_ns_.compare_exchange_strong(not_yet, now_ns());
    for (auto* alarm : {&stop_, &start_, &go_, &look_}) alarm->ring();
  }

 private:
  static constexpr const char* sender_name = "ontime-send";
  static constexpr auto never_ns = std::numeric_limits<std::int64_t>::max();

  // The sending thread.
  void send() noexcept {
    pthread_setname_np(pthread_self(), sender_name);
    sender_tid_ = gettid();
    sender_tid_.notify_one();
    start_.wait();
    wake_as_precisely_as_the_policy_allows();
    state_ = State::warming_up;
    warm_up();
    state_ = State::ready;
    go_.wait();
    if (!stop_.rung()) measure();
    state_ = State::finished;
    leave_.wait();  // until then it is still there to be read: its policy, its faults
  }

  // One message at a time: where the link carries them more slowly than they come, they would be a queue that
  // delays the messages that count. The server may not be there yet, so until the first answer it does not
  // wait long for one.
  void warm_up() noexcept {
    const auto before_first_ns = std::min(options_.timeout.count(), 50 * ms);
    std::uint64_t sent = 0;
    for (auto patience_ns = warm_up_pause_ns_; warm_up_answers_ < options_.warm_up && !stop_.rung();) {
      const auto sent_ns = now_ns();
      endpoint_->send(message::sequence_of(warm_up_session_, sent++), payload_);
      patience_ns =
          await(sent, sent_ns + patience_ns)
              ? std::max(4 * (now_ns() - sent_ns), warm_up_pause_ns_)
              : std::min(2 * patience_ns, warm_up_answers_ == 0 ? before_first_ns : options_.timeout.count());
    }
    if (warm_up_answered_ < sent) await(sent, now_ns() + options_.timeout.count());
  }

  // For a pause at least. Returns whether the last of so many messages was answered by then.
  bool await(std::uint64_t sent, std::int64_t until_ns) noexcept {
    do stop_.sleep_until(now_ns() + warm_up_pause_ns_);
    while (warm_up_answered_ < sent && now_ns() < until_ns && !stop_.rung());
    return warm_up_answered_ >= sent;
  }

  void measure() noexcept {
    state_ = State::measuring;
    Rest rest;
    if (options_.schedule == Schedule::back_to_back) {
      send_back_to_back();
    } else {
      Sender sender{*this};
      const auto first_ns = now_ns() + period_ns_;
      rest = walk(sender, first_ns, period_ns_, first_ns + options_.duration.count());
    }
    while (!ledger_.idle()) {
      pause(std::min(options_.timeout.count(), ms));
      ledger_.settle(now_ns());
    }
    ledger_.close(rest);
  }

  // What walk() asks of a sender.
  struct Sender {
    Measurement& self;
    void sleep_until(std::int64_t due_ns) noexcept { self.stop_.sleep_until(due_ns); }
    std::int64_t now_ns() const noexcept { return transport::now_ns(); }
    // Not by the alarm: stop() sets the time first, and a cycle may come between the two.
    std::int64_t stopped_ns() const noexcept { return self.stopped_ns_.load(); }
    bool may_send(std::int64_t at_ns) noexcept {
      self.ledger_.settle(at_ns);
      return (self.options_.schedule == Schedule::fixed || self.ledger_.idle()) && self.ledger_.claim();
    }
    void post(const Turn& turn) noexcept { self.post(turn); }
  };

  void post(const Turn& turn) noexcept {
    const auto index = ledger_.post(turn, now_ns());
    last_posted_.store(index, std::memory_order_relaxed);
    const auto sequence = message::sequence_of(session_, index);
    const bool sent = launch_ns_ > 0 ? endpoint_->launch(sequence, payload_, turn.due_ns + launch_ns_)
                                     : endpoint_->send(sequence, payload_);
    if (!sent) ledger_.refused();
  }

  // Here the receiving thread sends; this one begins, looks for losses, and goes on where it finds one.
  void send_back_to_back() noexcept {
    const auto start_ns = now_ns();
    back_to_back_end_ns_ = start_ns + options_.duration.count();
    follow(start_ns);
    while (!back_to_back_done_.load(std::memory_order_acquire)) {
      rest_back_to_back();
      look_.reset();
      const auto at_ns = now_ns();
      if (no_room_.exchange(false, std::memory_order_acquire) ||
          ledger_.expire(last_posted_.load(std::memory_order_relaxed), at_ns))
        follow(at_ns);
    }
  }

  // Each time that this thread runs, a round trip is the longer for it: so it sleeps until the message that
  // is under way now would be lost. Should a later one be, it is in time for that as well.
  void rest_back_to_back() noexcept {
    const auto at_ns = now_ns();
    const auto soon_ns = std::min(options_.timeout.count(), 10 * ms);
    if (stop_.rung() || at_ns >= back_to_back_end_ns_ || no_room_.load(std::memory_order_relaxed))
      return pause(soon_ns);
    const auto lost_ns = ledger_.lost_from_ns(last_posted_.load(std::memory_order_relaxed));
    look_.sleep_until(std::min(std::max(lost_ns, at_ns + soon_ns), back_to_back_end_ns_));
  }

  // By the thread that settled the last message, and so owns the ledger. That may come to pass while another
  // thread is still sending that message, and a transport has one caller of send() at a time: then that
  // thread goes on. `turns_` is 1 while a thread sends, 2 when it is to go on; more it cannot be, for one
  // message is in flight.
  void follow(std::int64_t at_ns) noexcept {
    follows_ns_ = at_ns;
    if (turns_.fetch_add(1, std::memory_order_acq_rel) != 0) return;
    do {
      next(follows_ns_);
    } while (turns_.fetch_sub(1, std::memory_order_acq_rel) != 1);
  }

  void next(std::int64_t at_ns) noexcept {
    ledger_.settle(at_ns);
    if (stop_.rung() || at_ns >= back_to_back_end_ns_) {
      back_to_back_done_.store(true, std::memory_order_release);
    } else if (ledger_.claim()) {
      post({.intended_ns = at_ns, .due_ns = at_ns, .woke_ns = at_ns});
    } else {
      no_room_.store(true, std::memory_order_release);
      look_.ring();  // the sending thread is to try again, soon, whenever the last message would be lost
    }
  }

  static void pause(std::int64_t ns) noexcept {
    const timespec time{ns / 1'000'000'000, ns % 1'000'000'000};
    clock_nanosleep(CLOCK_MONOTONIC, 0, &time, nullptr);
  }

  const ClientOptions options_;
  const std::int64_t launch_ns_;  // after it was due, whenever it was written; 0: as it is written
  const std::int64_t period_ns_ = std::max<std::int64_t>(options_.period.count(), 1);
  Ledger ledger_;
  std::vector<std::byte> payload_;
  const std::uint32_t session_, warm_up_session_;
  std::atomic<State> state_{State::waiting};
  const std::int64_t warm_up_pause_ns_ = warm_up_pause(options_).count();
  std::atomic<std::uint64_t> warm_up_answers_{0};
  std::atomic<std::uint64_t> warm_up_answered_{0};  // so many messages, with those before the latest answered
  std::atomic<std::uint64_t> last_posted_{0};
  std::atomic<std::int64_t> stopped_ns_{never_ns};
  Alarm start_, go_, stop_, leave_, look_;
  // Of back-to-back. Those that are not atomic are the ledger's owner's.
  std::int64_t back_to_back_end_ns_ = 0, follows_ns_ = 0;
  std::atomic<unsigned> turns_{0};
  std::atomic<bool> no_room_{false}, back_to_back_done_{false};
  std::atomic<pid_t> sender_tid_{0};
  // Last, for they use all of the above from their first moment, and are gone before it.
  std::unique_ptr<transport::Endpoint> endpoint_;
  Receiver receiver_;
  std::thread sender_;
};

Client::Client(const transport::Plugin& plugin, const transport::Config& config, const ClientOptions& options)
    : measurement_(std::make_unique<Measurement>(plugin, config, options)) {}
Client::~Client() = default;
transport::Endpoint& Client::endpoint() { return *measurement_->endpoint_; }
std::vector<Thread> Client::threads() { return measurement_->threads(); }
void Client::start() { measurement_->start_.ring(); }
void Client::go() { measurement_->go_.ring(); }
void Client::stop() { measurement_->stop(); }
Client::State Client::state() const { return measurement_->state_; }
std::uint64_t Client::warm_up_answers() const { return measurement_->warm_up_answers_; }
Counters Client::counters() const { return measurement_->ledger_.counters(); }
std::size_t Client::drain(std::span<Sample> samples) { return measurement_->ledger_.drain(samples); }
std::size_t Client::undrained() const { return measurement_->ledger_.undrained(); }
std::size_t Client::capacity() const { return measurement_->ledger_.capacity(); }

}  // namespace ontime::roundtrip

// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <csignal>

#include <fmt/format.h>
#include <poll.h>

#include "orders/orders.hpp"
#include "orders/process.hpp"

namespace ontime::orders {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;

constexpr auto look = 500ms;              // for interruptions, and whether it is done
constexpr auto patience_for_hello = 60s;  // a machine under full load, a slow ssh
constexpr int reads_a_turn = 32;          // of 64 KiB each: more than a pipe holds

}  // namespace

Coordinator::Coordinator(Interrupts& interrupts)
    : interrupts_(interrupts), beating_([this](const std::stop_token& stop) { beat(stop); }) {}

Coordinator::Hand::Hand(Coordinator& coordinator, std::string name, const std::vector<std::string>& command,
                        const std::string& samples, Between between)
    : coordinator_(coordinator),
      name_(std::move(name)),
      samples_(samples),
      process_(std::make_unique<Process>(name_, command, std::move(between))),
      heard_(Clock::now()) {
  {
    const std::lock_guard lock(coordinator_.mutex_);
    coordinator_.hands_.push_back(this);
  }
  try {
    coordinator_.await(*this, "hello", patience_for_hello, 1);
    there_ = true;
  } catch (...) {
    coordinator_.lose(*this);
    throw;
  }
}

Coordinator::Hand::~Hand() { coordinator_.lose(*this); }

void Coordinator::Hand::check_build(const json& hello) const {
  const std::string version = hello.value("version", "unknown");
  if (version == ONTIME_VERSION && hello.value("samples", "") == samples_) return;
  throw Error(
      3, fmt::format("{} is ontime {}, this is ontime {}{}. Fix: install the same build on both machines",
                     name_, version, ONTIME_VERSION, version == ONTIME_VERSION ? " of another build" : ""));
}

Coordinator::Hand::Left Coordinator::Hand::leave(const std::function<bool()>& wait_on) {
  coordinator_.lose(*this);  // no beat goes into a broken pipe
  process_->break_pipe();
  auto& frames = process_->frames();
  auto heard = Clock::now();
  std::vector<std::string> notes;  // of an order that was under way
  const auto left = [&] {
    left_.notes.insert(left_.notes.begin(), notes.begin(), notes.end());
    return left_;
  };
  while (true) {
    bool more = true;
    try {
      while (frames.fill()) heard = Clock::now();
    } catch (const Broken&) {  // it has left
      more = false;
    }
    try {
      while (const auto frame = frames.take())
        if (!hear(frame->message))
          for (const auto& note : frame->message.value("notes", std::vector<std::string>()))
            notes.push_back(note);
    } catch (const std::exception&) {  // it sends something invalid
      more = false;
    }
    if (Clock::now() - heard > longest_silence) {
      process_->give_up();
      more = false;
    }
    if (!more) return left();
    if (!wait_on()) {
      process_->let_go();
      left_.waits = true;
      return left();
    }
    pollfd waiting{frames.in(), POLLIN, 0};
    poll(&waiting, 1, static_cast<int>(look.count()));
  }
}

bool Coordinator::Hand::hear(const json& message) {
  const std::string event = message.value("event", "");
  if (event == "beat") doing_ = message.value("doing", "");
  if (event == "left") left_ = {true, false, message.value("notes", std::vector<std::string>{})};
  return event == "beat" || event == "left";
}

void Coordinator::Hand::order(const std::string& order, json body) {
  body["order"] = order;
  try {
    process_->frames().send(body);
  } catch (const Broken&) {
    coordinator_.listen(*this);  // it may have said why
    coordinator_.lose(*this);
    process_->gone();
  }
}

json Coordinator::Hand::ask(const std::string& order, json body, const std::string& answer,
                            std::chrono::milliseconds patience, int tolerated) {
  this->order(order, std::move(body));
  return coordinator_.await(*this, answer, patience, tolerated);
}

void Coordinator::listen(Hand& hand) {
  auto& frames = hand.process_->frames();
  bool more = true, ended = false;
  // Limits the reads, so that a worker that sends all the time does not block others or interruptions.
  for (int reads = 0; more && reads < reads_a_turn; ++reads) {
    try {
      more = frames.fill();
    } catch (const Broken&) {
      more = false;
      ended = true;  // what it said before is heard first
    }
    if (more) hand.heard_ = Clock::now();
    // After each read, so that a large burst does not fill the memory.
    try {
      while (const auto frame = frames.take()) dispatch(hand, *frame);
    } catch (const Broken& broken) {
      lose(hand);
      hand.process_->foreign(broken.what());
    } catch (const json::exception& error) {
      lose(hand);
      throw Error(3,
                  fmt::format("{} sent an invalid event ({}). Fix: install the same build on both machines",
                              hand.name_, error.what()));
    }
  }
  if (!ended) return;
  lose(hand);
  hand.process_->gone();
}

void Coordinator::dispatch(Hand& hand, const Frame& frame) {
  if (hand.hear(frame.message)) return;
  const std::string event = frame.message.value("event", "");
  if (event == "failed") {
    lose(hand);
    const std::string why = frame.message.value("message", "it failed");
    if (frame.message.value("unanswered", false)) throw Unanswered(why);
    // A failed worker must not make ontime exit with 0 or another code of its choice.
    throw Error(frame.message.value("exit", 3) == 2 ? 2 : 3, why);
  }
  if (event == "terminated") return count_termination(interrupts_, SIGTERM);
  if (const auto owed = std::find(hand.owed_.begin(), hand.owed_.end(), event); owed != hand.owed_.end()) {
    hand.owed_.erase(owed);
    return;
  }
  // At once: what another build says next may be unknown to this one.
  if (event == "hello") hand.check_build(frame.message);
  if (&hand == awaited_ && event == awaited_event_ && !answer_) {
    answer_ = frame.message;
    return;
  }
  const auto handle = hand.handles_.find(event);
  if (handle == hand.handles_.end())
    throw Error(3, fmt::format("{} sent an unexpected event '{}' (a bug: please report)", hand.name_, event));
  handle->second(frame);
}

void Coordinator::turn() {
  const auto hands = hands_;
  std::vector<pollfd> waiting;
  waiting.reserve(hands.size());
  for (auto* hand : hands) waiting.push_back({hand->process_->frames().in(), POLLIN, 0});
  const int ready = poll(waiting.data(), waiting.size(), static_cast<int>(look.count()));
  for (std::size_t i = 0; ready > 0 && i < hands.size(); ++i)
    if (waiting[i].revents != 0) listen(*hands[i]);
  check_silence();
}

void Coordinator::check_silence() {
  for (auto* hand : std::vector(hands_)) {
    if (!hand->there_) continue;  // it is on its way: patience_for_hello
    if (Clock::now() - hand->heard_ <= longest_silence) continue;
    // This process may have been stopped itself: read what has arrived first.
    listen(*hand);
    if (Clock::now() - hand->heard_ <= longest_silence) continue;
    hand->process_->give_up();
    lose(*hand);
    throw Error(3, fmt::format("{} was silent for {} s: it is stopped, or the connection to it is lost",
                               hand->name_, longest_silence.count()));
  }
}

void Coordinator::lose(Hand& hand) {
  hand.lost_ = true;
  const std::lock_guard lock(mutex_);
  std::erase(hands_, &hand);
}

json Coordinator::await(Hand& hand, const std::string& event, std::chrono::milliseconds patience,
                        int tolerated) {
  const auto end = Clock::now() + patience;
  const auto check = [&] {
    if (Clock::now() <= end) return;
    const auto seconds = std::chrono::duration_cast<std::chrono::seconds>(patience).count();
    throw Error(
        3, event == "hello"
               ? fmt::format("{} said nothing for {} s. Its command may wait for input, such as a password "
                             "for sudo, or may not be ontime",
                             hand.name_, seconds)
               : fmt::format("{}: timed out waiting for '{}' ({} s)", hand.name_, event, seconds));
  };
  return await(hand, event, check, tolerated);
}

json Coordinator::await(Hand& hand, const std::string& event, const std::function<void()>& meanwhile,
                        int tolerated) {
  awaited_ = &hand;
  awaited_event_ = event;
  answer_.reset();
  struct NoLonger {
    Coordinator& self;
    ~NoLonger() {
      if (!self.answer_) self.awaited_->owed_.push_back(self.awaited_event_);
      self.awaited_ = nullptr;
    }
  } const no_longer{*this};
  while (!answer_) {
    if (interrupted(tolerated)) throw Interrupted{};
    meanwhile();
    turn();
  }
  return *answer_;
}

void Coordinator::until(const std::function<bool()>& done, int tolerated) {
  while (!done()) {
    if (interrupted(tolerated)) throw Interrupted{};
    turn();
  }
}

void Coordinator::drain() noexcept {
  for (auto* hand : std::vector(hands_)) try {
      listen(*hand);
    } catch (const std::exception&) {  // another error is already being reported
    }
}

void Coordinator::beat(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  while (!wake_.wait_for(lock, stop, beat_period, [&] { return stop.stop_requested(); }))
    for (auto* hand : hands_) try {
        hand->process_->frames().send({{"order", "beat"}});
      } catch (const Broken&) {  // the loop notices it too
      }
}

}  // namespace ontime::orders

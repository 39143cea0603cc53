// SPDX-License-Identifier: Apache-2.0
#include "message/message.hpp"
#include "roundtrip/receiver.hpp"
#include "roundtrip/roundtrip.hpp"
#include "transport/clock.hpp"

namespace ontime::roundtrip {
namespace {

// Any answering thread writes; answers not read in time are overwritten.
class Answers {
 public:
  void add(const Server::Answer& answer) noexcept {
    const auto number = next_.fetch_add(1, std::memory_order_relaxed);
    auto& slot = slots_[number % slots_.size()];
    slot.number.store(0, std::memory_order_release);  // of none, while it is written
    slot.sequence.store(answer.sequence, std::memory_order_release);
    slot.received_ns.store(answer.received_ns, std::memory_order_release);
    slot.sent_ns.store(answer.sent_ns, std::memory_order_release);
    slot.number.store(number + 1, std::memory_order_release);
  }
  std::size_t drain(std::span<Server::Answer> answers) {
    const auto end = next_.load(std::memory_order_relaxed);
    if (end - read_ > slots_.size()) read_ = end - slots_.size();
    std::size_t count = 0;
    for (; count < answers.size() && read_ < end; ++read_) {
      const auto& slot = slots_[read_ % slots_.size()];
      const auto number = slot.number.load(std::memory_order_acquire);
      if (number < read_ + 1) break;  // it is being written
      answers[count] = {slot.sequence.load(std::memory_order_acquire),
                        slot.received_ns.load(std::memory_order_acquire),
                        slot.sent_ns.load(std::memory_order_acquire)};
      if (number == read_ + 1 && slot.number.load(std::memory_order_relaxed) == number) ++count;
    }
    return count;
  }

 private:
  struct Slot {
    std::atomic<std::uint64_t> number{0}, sequence{0};
    std::atomic<std::int64_t> received_ns{0}, sent_ns{0};
  };
  std::vector<Slot> slots_ = std::vector<Slot>(std::size_t{1} << 16);
  std::atomic<std::uint64_t> next_{0};
  std::uint64_t read_ = 0;
};

}  // namespace

class Server::Echo final : public transport::Sink {
  friend class Server;

 public:
  Echo(const transport::Plugin& plugin, const transport::Config& config)
      : endpoint_(plugin.open(config, *this)), receiver_(*endpoint_, config.receive) {
    answerer_.store(endpoint_.get(), std::memory_order_release);
  }

  // Real-time: on the transport's thread, or on the receiver's.
  void arrived(std::uint64_t sequence, std::span<std::byte> payload, std::int64_t at_ns) noexcept override {
    auto* endpoint = answerer_.load(std::memory_order_acquire);
    if (endpoint == nullptr) return;  // a ping that came while the transport was still opening
    const auto sent_ns = transport::now_ns();
    message::put_server_times(payload, {at_ns, sent_ns});
    if (endpoint->send(sequence, payload)) answered_.fetch_add(1, std::memory_order_relaxed);
    if (auto* notes = notes_.load(std::memory_order_acquire)) notes->add({sequence, at_ns, sent_ns});
  }

  std::vector<Thread> threads() {
    auto threads = receiver_.threads();
    for (auto& thread : endpoint_->threads()) threads.push_back(std::move(thread));
    return threads;
  }

  void note_answers() {
    answers_ = std::make_unique<Answers>();
    notes_.store(answers_.get(), std::memory_order_release);
  }

 private:
  std::unique_ptr<Answers> answers_;
  std::atomic<Answers*> notes_{nullptr};  // nothing: they are not noted
  std::atomic<transport::Endpoint*> answerer_{nullptr};
  std::atomic<std::uint64_t> answered_{0};
  std::unique_ptr<transport::Endpoint> endpoint_;
  Receiver receiver_;
};

Server::Server(const transport::Plugin& plugin, const transport::Config& config)
    : echo_(std::make_unique<Echo>(plugin, config)) {}
Server::~Server() = default;
transport::Endpoint& Server::endpoint() { return *echo_->endpoint_; }
std::vector<Thread> Server::threads() { return echo_->threads(); }
std::uint64_t Server::answered() const { return echo_->answered_; }
void Server::note_answers() { echo_->note_answers(); }
std::size_t Server::drain(std::span<Answer> answers) { return echo_->answers_->drain(answers); }

}  // namespace ontime::roundtrip

// SPDX-License-Identifier: Apache-2.0
#include "message/message.hpp"
#include "roundtrip/receiver.hpp"
#include "roundtrip/roundtrip.hpp"
#include "transport/clock.hpp"

namespace ontime::roundtrip {

class Server::Echo final : public transport::Sink {
 public:
  Echo(const transport::Plugin& plugin, const transport::Config& config)
      : endpoint_(plugin.open(config, *this)), receiver_(*endpoint_, config.receive) {
    answerer_.store(endpoint_.get(), std::memory_order_release);
  }

  // Real-time: on the transport's thread, or on the receiver's.
  void arrived(std::uint64_t sequence, std::span<std::byte> payload, std::int64_t at_ns) noexcept override {
    auto* endpoint = answerer_.load(std::memory_order_acquire);
    if (endpoint == nullptr) return;  // a ping that came while the transport was still opening
    message::put_server_times(payload, {at_ns, transport::now_ns()});
    if (endpoint->send(sequence, payload)) answered_.fetch_add(1, std::memory_order_relaxed);
  }

  std::vector<Thread> threads() {
    auto threads = receiver_.threads();
    for (auto& thread : endpoint_->threads()) threads.push_back(std::move(thread));
    return threads;
  }

  transport::Endpoint& endpoint() { return *endpoint_; }
  std::uint64_t answered() const { return answered_; }

 private:
  std::atomic<transport::Endpoint*> answerer_{nullptr};
  std::atomic<std::uint64_t> answered_{0};
  std::unique_ptr<transport::Endpoint> endpoint_;
  Receiver receiver_;
};

Server::Server(const transport::Plugin& plugin, const transport::Config& config)
    : echo_(std::make_unique<Echo>(plugin, config)) {}
Server::~Server() = default;
transport::Endpoint& Server::endpoint() { return echo_->endpoint(); }
std::vector<Thread> Server::threads() { return echo_->threads(); }
std::uint64_t Server::answered() const { return echo_->answered(); }

}  // namespace ontime::roundtrip

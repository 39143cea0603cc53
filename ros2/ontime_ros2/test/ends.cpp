// SPDX-License-Identifier: Apache-2.0
#include "ends.hpp"

#include <chrono>
#include <cstdlib>
#include <random>
#include <stdexcept>

#include <gtest/gtest.h>
#include <net/if.h>
#include <unistd.h>

#include "message/message.hpp"

namespace ontime::transport {
namespace {

using namespace std::chrono_literals;

int domain = 0;
bool alone = false;

class Isolation : public testing::Environment {
  void SetUp() override {
    alone = two_ends::isolate();
    if (!alone) domain = 100 + getpid() % 100;     // the best chance to be alone
    set("ROS_DOMAIN_ID", std::to_string(domain));  // of nodes that are no transport of ours
  }
};
const auto* const isolation = testing::AddGlobalTestEnvironment(new Isolation);

}  // namespace

Config config_of(Role role, const Options& options) {
  Config config;
  config.role = role;
  const auto executor = options.find("executor");
  if (executor != options.end() && executor->second.starts_with("wait")) config.receive = Receive::waitset;
  config.max_payload_bytes = *std::max_element(std::begin(payload_sizes), std::end(payload_sizes));
  config.interface = "lo";
  config.address = "127.0.0.1";
  config.domain = domain;
  config.options = options;
  return config;
}

bool isolated() { return alone; }

void give_loopback_multicast(bool on) {
  require(two_ends::set_loopback(IFF_MULTICAST, on), "cannot change lo");
}

void set(const char* name, const std::string& value) {
  setenv(name, value.c_str(), 1);  // NOLINT(concurrency-mt-unsafe): before other threads are there
}

void require(bool condition, const std::string& what) {
  if (!condition) throw std::runtime_error(what);
}

std::string in_own_process(const std::function<void()>& run) {
  return two_ends::Child([&](int, int) {
           try {
             run();
           } catch (const WrongInput& error) {
             throw std::runtime_error(std::string("wrong input: ") + error.what());
           }
         })
      .result();
}

std::string error_of(const Config& config, const std::function<void()>& before) {
  return in_own_process([&] {
    before();
    Answers answers;
    two_ends::plugin().open(config, answers);
  });
}

void Answers::arrived(std::uint64_t sequence, std::span<std::byte> payload, std::int64_t) noexcept {
  const std::lock_guard lock(mutex_);
  sequence_ = sequence;
  payload_.assign(payload.begin(), payload.end());
  changed_.notify_one();
}

std::optional<std::vector<std::byte>> Answers::await(std::uint64_t sequence) {
  std::unique_lock lock(mutex_);
  if (!changed_.wait_for(lock, 500ms, [&] { return sequence_ == sequence; })) return {};
  return payload_;
}

void exchange(Endpoint& endpoint, Answers& answers, std::size_t others_bytes) {
  std::mt19937 random(1);
  std::uint64_t sequence = message::sequence_of(0xABCDEF, message::max_index - 10);
  for (const std::size_t bytes : payload_sizes) {
    std::vector<std::byte> payload(bytes);
    for (std::byte& byte : payload) byte = static_cast<std::byte>(random());
    std::optional<std::vector<std::byte>> answer;
    for (int i = 0; i < 20 && !answer; ++i) {  // best effort may lose some
      require(endpoint.send(++sequence, payload), "refused " + std::to_string(bytes) + " bytes");
      answer = answers.await(sequence);
    }
    require(answer.has_value(), "no answer to " + std::to_string(bytes) + " bytes");
    require(answer->size() == bytes, "another size came back");
    const auto skipped = static_cast<std::ptrdiff_t>(bytes < others_bytes ? 0 : others_bytes);
    require(std::equal(answer->begin() + skipped, answer->end(), payload.begin() + skipped),
            "other bytes came back");
  }
}

}  // namespace ontime::transport

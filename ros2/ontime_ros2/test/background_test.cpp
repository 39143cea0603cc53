// SPDX-License-Identifier: Apache-2.0
// Topics beside a critical one: what they share with it, they share; they end without it.
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <string>
#include <tuple>

#include <gtest/gtest.h>
#include <pthread.h>

#include "ends.hpp"

namespace ontime::transport {
namespace {

using namespace std::chrono_literals;

Config beside_config(Role role, const Options& options) {
  auto config = config_of(role, options);
  config.ping_topic = "/beside/ping";
  config.pong_topic = "/beside/pong";
  return config;
}

// Keeps the callback of a message until it is told to let it go.
class Held final : public Sink {
 public:
  void arrived(std::uint64_t, std::span<std::byte>, std::int64_t) noexcept override {
    std::unique_lock lock(mutex_);
    pthread_getname_np(pthread_self(), thread_, sizeof thread_);
    inside_ = true;
    changed_.notify_all();
    changed_.wait(lock, [this] { return free_; });
  }
  bool await(std::chrono::milliseconds time) {
    std::unique_lock lock(mutex_);
    return changed_.wait_for(lock, time, [this] { return inside_; });
  }
  std::string thread() {
    const std::lock_guard lock(mutex_);
    return thread_;
  }
  void let_go() {
    const std::lock_guard lock(mutex_);
    free_ = true;
    changed_.notify_all();
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  char thread_[16] = {};
  bool inside_ = false, free_ = false;
};

struct Place {
  const char* name;
  const char* executor;
  Where where;
  const char* thread;  // that runs their callbacks
  bool holds_critical;
};

constexpr const char* critical_thread = "ontime-executor";
constexpr const char* own_thread = "beside-executor";
constexpr Place places[] = {
    {"same_callback_group", "single", Where::same_callback_group, critical_thread, true},
    {"same_callback_group_multi", "multi", Where::same_callback_group, critical_thread, true},
    {"same_node", "single", Where::same_node, critical_thread, true},
    {"same_node_multi", "multi", Where::same_node, critical_thread, false},
    {"same_executor", "single", Where::same_executor, critical_thread, true},
    {"same_executor_multi", "multi", Where::same_executor, critical_thread, false},
    {"own_executor", "single", Where::own_executor, own_thread, false},
    {"same_participant", "single", Where::same_participant, own_thread, false},
    {"same_process", "single", Where::same_process, own_thread, false},
};

class BackgroundIn : public testing::TestWithParam<std::tuple<const char*, Place>> {
 protected:
  Options options() const {
    return {{"rmw", std::get<0>(GetParam())}, {"executor", std::get<1>(GetParam()).executor}};
  }
};

TEST_P(BackgroundIn, DelayTheCriticalTopicIfTheyShareItsThread) {
  const Place place = std::get<1>(GetParam());
  const two_ends::Child server(
      [&](int end, int) { two_ends::serve(config_of(Role::server, options()), end); });
  const two_ends::Child other(
      [&](int end, int) { two_ends::serve(beside_config(Role::server, options()), end); });
  EXPECT_EQ(in_own_process([&] {
              Answers answers;
              const auto critical = two_ends::plugin().open(config_of(Role::client, options()), answers);
              Held held;
              auto background = critical->beside(beside_config(Role::client, options()), held, place.where);
              require(two_ends::await_match(*critical), "no match; seen: " + critical->seen());
              require(two_ends::await_match(*background), "no match beside; seen: " + background->seen());
              exchange(*critical, answers);
              std::uint64_t sequence = 0;
              for (int i = 0; i < 20 && !held.await(100ms); ++i) background->send(++sequence, {});
              require(held.await(0ms), "no answer beside");
              require(held.thread() == place.thread, "called by " + held.thread());
              bool answered = false;
              for (int i = 0; i < (place.holds_critical ? 1 : 5) && !answered; ++i) {
                critical->send(++sequence, {});
                answered = answers.await(sequence).has_value();
              }
              require(answered != place.holds_critical, answered ? "it was not held" : "it was held");
              held.let_go();
              exchange(*critical, answers);
              background.reset();
              exchange(*critical, answers);
            }),
            "");
}

INSTANTIATE_TEST_SUITE_P(Every, BackgroundIn,
                         testing::Combine(testing::ValuesIn(rmws), testing::ValuesIn(places)),
                         [](const auto& each) {
                           return std::string(std::get<0>(each.param)) + "_" + std::get<1>(each.param).name;
                         });

std::string names_of(const std::vector<Thread>& threads) {
  std::string names;
  for (const auto& thread : threads) names += thread.name + " ";
  return names;
}

TEST(BackgroundTopics, ShareTheNodeOfTheFirstOfThemAndItsThread) {
  for (const std::string rmw : rmws) {
    const Options options{{"rmw", rmw}};
    EXPECT_EQ(in_own_process([&] {
                Answers answers;
                Held held;
                const auto critical = two_ends::plugin().open(config_of(Role::client, options), answers);
                const auto before = names_of(critical->threads());
                const auto first =
                    critical->beside(beside_config(Role::client, options), held, Where::same_participant);
                auto config = beside_config(Role::client, options);
                config.ping_topic = "/beside_2/ping";
                config.pong_topic = "/beside_2/pong";
                const auto second = first->beside(config, held, Where::same_callback_group);
                require(first->facts().at("node") == "/beside/ontime_ping", first->facts().at("node"));
                require(second->facts().at("node") == first->facts().at("node"), "a node of its own");
                require(names_of(critical->threads()) == before,
                        "the critical one's were " + before + ", and are " + names_of(critical->threads()));
                const auto threads = second->threads();
                const auto own = std::count_if(threads.begin(), threads.end(), [](const auto& thread) {
                  return thread.name == own_thread && thread.role == "receive";
                });
                require(own == 1, std::to_string(own) + " threads of their own");
              }),
              "")
        << rmw;
  }
}

TEST(BackgroundTopics, UseTheirOwnWaitsetWhereTheCriticalTopicDoes) {
  for (const std::string rmw : rmws) {
    const Options options{{"rmw", rmw}, {"executor", "waitset"}};
    const two_ends::Child server(
        [&](int end, int) { two_ends::serve(beside_config(Role::server, options), end); });
    EXPECT_EQ(in_own_process([&] {
                Answers answers, beside_answers;
                const auto critical = two_ends::plugin().open(config_of(Role::client, options), answers);
                for (const auto where : {Where::same_participant, Where::same_process}) {
                  const auto background =
                      critical->beside(beside_config(Role::client, options), beside_answers, where);
                  const Receiving receiving(*background, Receive::waitset);
                  require(two_ends::await_match(*background), "no match; seen: " + background->seen());
                  exchange(*background, beside_answers);
                }
              }),
              "")
        << rmw;
  }
}

}  // namespace
}  // namespace ontime::transport

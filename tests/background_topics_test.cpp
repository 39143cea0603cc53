// SPDX-License-Identifier: Apache-2.0
// Ordinary topics beside a critical one, over each DDS: what they send is counted at both ends, wherever they
// are, and the critical one goes on.
#include <thread>

#include "dds_ends.hpp"
#include "roundtrip/roundtrip.hpp"

namespace ontime::roundtrip {
namespace {

using namespace std::chrono_literals;
using transport::Role;
using transport::test::config_of;
using transport::test::eventually;
using transport::test::require;

struct Case {
  const char* transport;
  Where where;
  transport::Receive receive;
};
std::string name_of(const testing::TestParamInfo<Case>& info) {
  auto name = std::string(info.param.transport) + "_" + word_of(info.param.where) +
              (info.param.receive == transport::Receive::listener ? "_listener" : "_waitset");
  std::replace(name.begin(), name.end(), '-', '_');
  return name;
}
std::vector<Case> cases() {
  std::vector<Case> all;
  for (const auto* transport : {"cyclonedds", "fastdds", "opendds"})
    for (const auto where : {Where::same_participant, Where::same_process, Where::other_process})
      for (const auto receive : {transport::Receive::listener, transport::Receive::waitset})
        all.push_back({transport, where, receive});
  return all;
}

constexpr auto duration = 200ms;
// Larger than the critical one's messages, so that they have room of their own.
BackgroundOptions options_of(const Case& value) {
  return {.topics = 3,
          .where = value.where,
          .payload_bytes = 40'000,
          .period = 20ms,
          .reliability = transport::Reliability::reliable};
}

transport::Config ends_config(const Case& value, Role role) {
  auto config = config_of(role, transport::Reliability::best_effort, value.receive);
  config.max_payload_bytes = 500;
  return config;
}

std::unique_ptr<BackgroundTopics> open(const Case& value, Role role, transport::Endpoint* critical) {
  return std::make_unique<BackgroundTopics>(transport::load(value.transport), critical,
                                            ends_config(value, role), options_of(value), duration);
}

// Sent, received, and passed over by the one sender in all.
void check(BackgroundTopics& background) {
  require(eventually([&] {
            const auto counted = background.counters();
            return counted.sent + counted.refused + counted.skipped_cycles >= 30;
          }),
          "every cycle of the three is counted");
  std::this_thread::sleep_for(duration);
  const auto counted = background.counters();
  require(counted.sent + counted.refused + counted.skipped_cycles == 30, "and none twice");
  require(counted.strays == 0, "no others came");
}

void run_background(BackgroundTopics& background) {
  require(eventually([&] { return background.matched(); }), "they match");
  background.start();
  std::this_thread::sleep_for(1s);  // the peer may match later, and does not get earlier messages
  background.go();
  std::this_thread::sleep_for(2 * duration);
  require(eventually([&] { return background.counters().received > 0; }), "messages of the peer arrived");
  check(background);
}

class BackgroundOf : public testing::TestWithParam<Case> {
  void SetUp() override {
    if (!transport::test::have(GetParam().transport)) GTEST_SKIP() << GetParam().transport << " is not built";
  }
};
INSTANTIATE_TEST_SUITE_P(, BackgroundOf, testing::ValuesIn(cases()), name_of);

TEST_P(BackgroundOf, AreCountedBesideACriticalOneThatGoesOn) {
  const auto& value = GetParam();
  const bool alone = value.where == Where::other_process;
  transport::test::Process serving([&](const auto&) {
    std::optional<Server> server;
    if (!alone) server.emplace(transport::load(value.transport), ends_config(value, Role::server));
    auto background = open(value, Role::server, server ? &server->endpoint() : nullptr);
    run_background(*background);
    background.reset();
    if (!server) return;
    const auto answered = server->answered();
    require(answered > 0, "the critical one answered");
    require(eventually([&] { return server->answered() > answered; }), "and does so without them");
  });
  transport::test::Process asking([&](const auto& await_end) {
    std::optional<Client> client;
    if (!alone) {
      ClientOptions options;
      options.period = 1ms;
      options.duration = 60s;
      client.emplace(transport::load(value.transport), ends_config(value, Role::client), options);
    }
    auto background = open(value, Role::client, client ? &client->endpoint() : nullptr);
    if (client) {
      require(eventually([&] { return client->endpoint().matched().both(); }), "the critical one matches");
      client->start();
      require(eventually([&] { return client->state() == Client::State::ready; }), "it warms up");
      client->go();
    }
    run_background(*background);
    background.reset();
    if (client) {
      const auto sent = client->counters().sent;
      require(eventually([&] { return client->counters().sent > sent; }), "it goes on without them");
    }
    await_end();
  });
  EXPECT_EQ(serving.finish(), "");
  EXPECT_EQ(asking.finish(), "");
}

TEST_P(BackgroundOf, WithACallbackOverrunTheirPeriodAndTellSo) {
  const auto& value = GetParam();
  const auto open_and_go = [&](Role role) {
    auto options = options_of(value);
    options.where = Where::other_process;
    options.callback = 2 * options.period;
    auto background = std::make_unique<BackgroundTopics>(transport::load(value.transport), nullptr,
                                                         ends_config(value, role), options, 60s);
    require(eventually([&] { return background->matched(); }), "they match");
    background->start();
    background->go();
    return background;
  };
  transport::test::Process other([&](const auto& await_end) {
    const auto background = open_and_go(Role::server);
    await_end();
  });
  EXPECT_EQ(transport::test::in_own_process([&] {
              const auto background = open_and_go(Role::client);
              require(eventually([&] { return background->counters().overruns > 0; }), "a callback overruns");
              const auto counted = background->counters();
              require(counted.overruns <= counted.received, "each is counted once");
            }),
            "");
  EXPECT_EQ(other.finish(), "");
}

TEST(BackgroundTopics, OfATransportThatHasNoneAreRefusedByName) {
  transport::test::Process serving([](const auto&) {
    auto config = config_of(Role::server);
    config.max_payload_bytes = 500;
    Server server(transport::load("udp"), config);
    try {
      const BackgroundTopics background(transport::load("udp"), &server.endpoint(), config, {.topics = 1},
                                        duration);
      require(false, "it is refused");
    } catch (const transport::WrongInput& wrong) {
      require(std::string(wrong.what()).find("transport udp has no background topics") == 0, wrong.what());
    }
  });
  EXPECT_EQ(serving.finish(), "");
}

}  // namespace
}  // namespace ontime::roundtrip

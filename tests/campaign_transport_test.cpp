// SPDX-License-Identifier: Apache-2.0
// What a third party's transport (modest_transport.cpp) declares is respected, whatever its name.
#include "campaign_scenario.hpp"

namespace ontime::campaign {
namespace {

using testing::AllOf;
using testing::HasSubstr;

class ForeignTransport : public ScenarioFile {
 protected:
  ForeignTransport() {
    const char* const found = std::getenv(path);  // NOLINT(concurrency-mt-unsafe): there is one thread
    before_ = found != nullptr ? found : "";
  }
  ~ForeignTransport() override { set(before_); }
  void install() { set(ONTIME_TEST_TRANSPORTS); }
  std::string refusal(const std::string& keys) { return error(of(keys)); }
  static std::string of(const std::string& keys) {
    return "hosts: {component: {ssh: robot, address: 10.0.0.2}}\nruns: [{id: a, transport: modest, " + keys +
           "}]\n";
  }

 private:
  static constexpr const char* path = "ONTIME_TRANSPORT_PATH";
  static void set(const std::string& folders) { setenv(path, folders.c_str(), 1); }  // NOLINT: as above
  std::string before_;
};

constexpr const char* impossible[][2] = {
    {"explain: on", "explain cannot follow modest"},
    {"link: {loss: 1 %}", "modest bypasses the packet filter"},
    {"payload: 501 B", "at most 500"},
    {"security: sign", "transport modest has no DDS Security"},
    {"qos: {depth: [1, 2]}", "modest has no QoS"},
    {"component: {transport: udp}",
     "modest cannot reach udp on the component: modest has no IP header. Fix: leave out component.transport"},
    {"background: {topics: 1}", "transport modest has no topics"}};

TEST_F(ForeignTransport, WhatItCannotDoIsRefusedWhereItIsInstalled) {
  install();
  EXPECT_EQ(refusal("duration: 1 s"), "no error");
  for (const auto& [keys, why] : impossible) EXPECT_THAT(refusal(keys), HasSubstr(why));
  EXPECT_THAT(error("wire: {rate: 10 Mbit/s}\nruns: [{id: a, transport: modest}]\n"),
              AllOf(HasSubstr("modest bypasses"), HasSubstr("wire.rate")));
  EXPECT_THAT(error("components: [arm, base]\nruns: [{id: a, transport: modest}]\n"),
              HasSubstr("over modest, arm and base need a queue each"));
}

TEST_F(ForeignTransport, IsLeftToTheMachineThatHasIt) {
  for (const auto& [keys, why] : impossible) EXPECT_EQ(refusal(keys), "no error") << why;
  const auto run = read(of("link: {message-priority: 6}")).runs.at(0);
  EXPECT_EQ(run.task.config.priority, 6) << "it may be below IP";
  EXPECT_THAT(why_not_by("modest", {.past_the_kernel = true}, run, {}), HasSubstr("modest bypasses"));
  EXPECT_EQ(why_not_by("modest", {.below_ip = true}, run, {}), "");
}

}  // namespace
}  // namespace ontime::campaign

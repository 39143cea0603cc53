// SPDX-License-Identifier: Apache-2.0
#include "report_fixture.hpp"

namespace ontime::report {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

TEST(Remarks, TellWhatNobodyElseIsToBlameFor) {
  auto facts = outcome();
  facts["conditions"]["component"]["cpu_stolen"] = 0.0213;
  facts["conditions"]["controller"]["cpu_stolen"] = 0.0001;
  facts["hosts"]["controller"]["machine"]["rt_runtime_us"] = 950'000;
  facts["hosts"]["controller"]["machine"]["rt_period_us"] = 1'000'000;
  auto as_asked = asked("a", "udp");
  as_asked["realtime"] = true;
  auto one = summary(as_asked, facts);
  one.wake_up.max = 50'500'000;
  statistics::Worst worst;
  worst.took_ns = 60'000'000;
  worst.message.due_ns = 1'000'000'000;
  worst.message.woke_ns = 1'050'500'000;
  one.shape.worst = {worst};
  auto text = render({one}, Format::markdown);
  EXPECT_THAT(text, HasSubstr("the hypervisor took 2.1 % of the time of the component's CPUs"));
  EXPECT_THAT(text, Not(HasSubstr("of the controller's CPUs")));
  EXPECT_THAT(text, HasSubstr("of the longest wait, 60000 µs, our own sending thread overslept 50500"));
  EXPECT_THAT(text, HasSubstr("woke up to 50500 µs late, as RT throttling would make it"));
  const auto document = json::parse(render({one}, Format::json));
  EXPECT_THAT(document.at("runs").at(0).at("remarks").get<std::string>(), HasSubstr("RT throttling"));
  one.shape.worst[0].message.woke_ns = 1'020'000'000;
  one.wake_up.max = 20'000'000;
  text = render({one}, Format::markdown);
  EXPECT_THAT(text, Not(HasSubstr("overslept")));
  EXPECT_THAT(text, Not(HasSubstr("throttling")));
}

TEST(Remarks, TellLossesApart) {
  auto lossy = outcome();
  lossy["hosts"]["controller"]["losses"] = {{"on_the_way", 9}, {"overwritten", 0}};
  lossy["hosts"]["component"]["losses"] = {{"on_the_way", nullptr}, {"overwritten", 12}};
  const auto text = render({summary(asked("a", "udp"), lossy)}, Format::markdown);
  EXPECT_THAT(text, AllOf(HasSubstr("overwritten before they were read: 12 at the component;"),
                          HasSubstr("lost on the way: 9 to the controller")));
  EXPECT_EQ(row_by_name(render({summary(asked("a", "udp"), lossy)}, Format::csv), 0)
                .at("component_lost_overwritten"),
            "12");
}

TEST(Remarks, TellOfOtherTrafficOnTheLink) {
  const auto with = [](const char* interface, std::uint64_t bytes) {
    auto linked = outcome();
    for (auto& host : linked["hosts"]) {
      host["machine"]["boot_id"] = "b";
      host["link"] = {{"interface", interface}, {"sent_bytes", bytes}, {"received_bytes", bytes}};
    }
    linked["hosts"]["component"]["link"]["interface"] = "lo";
    return render({summary(asked("a", "udp"), linked)}, Format::markdown);
  };
  EXPECT_THAT(with("lo", 1'300'000), Not(HasSubstr("other traffic")));
  const auto text = with("lo", 80'000'000);
  EXPECT_THAT(text, HasSubstr("other traffic on lo of the controller: 160 MB in all"));
  EXPECT_THAT(text, Not(HasSubstr("of the component"))) << "it is the same";
  EXPECT_THAT(with("eth1", 80'000'000),
              AllOf(HasSubstr("eth1 of the controller"), HasSubstr("lo of the component")));
}

TEST(Remarks, TellNotesWithTheirMoment) {
  auto one = summary(asked("a", "udp"), outcome());
  one.start_ns = 1'000'000'000;
  one.notes = {{"peer-left", "the pong left", 4'200'000'000, {}},
               {"second-pong", "two pongs answer", {}, 17}};
  EXPECT_THAT(render({one}, Format::markdown),
              HasSubstr("udp: at 3.2 s: the pong left; two pongs answer (message 17)"));
  const auto notes = json::parse(render({one}, Format::json)).at("runs").at(0).at("notes");
  EXPECT_EQ(notes.at(0),
            json({{"kind", "peer-left"}, {"text", "the pong left"}, {"at_s", 3.2}, {"message", nullptr}}));
  EXPECT_EQ(notes.at(1).at("message"), 17);
  EXPECT_EQ(notes.at(1).at("at_s"), nullptr);
  one.notes.assign(30, {"peer-left", "gone", {}, {}});
  EXPECT_THAT(render({one}, Format::markdown), HasSubstr("gone; 25 further notes"));
}

}  // namespace
}  // namespace ontime::report

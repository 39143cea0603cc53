// SPDX-License-Identifier: Apache-2.0
// What else differs between the runs that are compared.
#include "conditions/conditions.hpp"
#include "json.hpp"
#include "report/comparison.hpp"
#include "report_comparison.hpp"

namespace ontime::report {
namespace {

using record::amend;
using ::testing::HasSubstr;
using ::testing::Not;

TEST(Compare, ShowsWhatElseDiffers) {
  const std::vector a{run("x", "k", 1)};
  std::vector b{run("x", "k", 1)};
  amend(b[0].run.outcome, "/hosts/controller/machine/kernel", "6.6\x1b[31m");
  amend(b[0].run.outcome, "/hosts/controller/machine/boot_id", "another each time");
  amend(b[0].run.outcome, "/hosts/component/transport/version", "0.2.0");
  const auto found =
      parsed_json(render(compare(a, b), {}, Format::json)).at("pairs").at(0).at("not_the_same");
  const auto difference = [](const char* what, const char* from, const char* to) {
    return json{{"what", what}, {"from", from}, {"to", to}};
  };
  EXPECT_EQ(found, (json{difference("component transport version", "0.1.0", "0.2.0"),
                         difference("controller kernel", "6.1", "6.6?[31m")}));
  EXPECT_THAT(render(compare(a, b), {}, Format::table), HasSubstr("also different (A → B)"));
  EXPECT_THAT(render(compare(a, a), {}, Format::table), Not(HasSubstr("also different")));
}

TEST(Compare, ConfigurationThatDiffersAtItsEndIsNamed) {
  const std::string path = "ontime, /home/me/workspace/install/share/robot/config/cyclonedds_profile.xml";
  std::vector a{run("x", "k", 1)}, b{run("x", "k", 1)};
  const auto set = [](std::vector<Summary>& runs, const std::string& value) {
    for (const auto* host : {"controller", "component"})
      amend(runs[0].run.outcome, fmt::format("/hosts/{}/transport/facts/configuration", host), value);
  };
  const auto found = [&] {
    return parsed_json(render(compare(a, b), {}, Format::json)).at("pairs").at(0).at("not_the_same");
  };
  set(a, path + " (content 000000000001)");
  set(b, path + " (content 000000000001)");
  EXPECT_EQ(found(), json::array());
  set(b, path + " (content 000000000002)");
  ASSERT_EQ(found().size(), 2U);
  EXPECT_EQ(found()[0].at("what"), "component configuration");
  EXPECT_THAT(found()[0].at("from").get<std::string>(), HasSubstr("000000000001"));
  EXPECT_THAT(found()[0].at("to").get<std::string>(), HasSubstr("000000000002"));
}

TEST(Compare, SettingsOfAMachineThatNoneRequestedAreNamedIfBothRunsKnowThem) {
  std::vector a{run("x", "k", 1)}, b{run("x", "k", 1)};
  const auto text = [&] { return render_answer(compare(a, b), {}, Format::table, "", 1000); };
  const auto set = [](std::vector<Summary>& runs, const char* name, const char* value) {
    for (const auto* host : {"controller", "component"})
      amend(runs[0].run.outcome, fmt::format("/hosts/{}/settings/{}", host, name), value);
  };
  set(b, "rmem-max", "8000 B");
  EXPECT_THAT(text(), Not(HasSubstr("rmem-max"))) << "an older ontime noted none";
  set(a, "rmem-max", "4000 B");
  EXPECT_THAT(text(), HasSubstr("Also different: kernel.rmem-max: 4000 B → 8000 B\n"));
  amend(b[0].run.asked, "/kernel", {{"rmem-max", "8000"}});
  EXPECT_THAT(text(), AllOf(HasSubstr("rmem-max: "), Not(HasSubstr("4000 B"))));
}

TEST(Compare, SettingsThatFollowFromRealtimeAreNotListed) {
  const auto settings = [](const char* realtime) {
    conditions::Run with;
    conditions::key_named("realtime")->set(with, realtime);
    return conditions::to_json(with).at("realtime_settings");
  };
  const std::vector a{run("x", "k", 1)};
  std::vector b{run("x", "k", 1)};
  const auto found = [&] {
    std::string text;
    const auto document = parsed_json(render(compare(a, b), {}, Format::json));
    for (const auto& one : document.at("pairs").at(0).at("not_the_same"))
      text += one.at("what").get<std::string>() + "; ";
    return text;
  };
  amend(b[0].run.asked, {{"realtime", true}, {"realtime_settings", settings("on")}});
  EXPECT_EQ(found(), "realtime; ");
  amend(b[0].run.asked, "/realtime_settings/threads/send/priority", 95);
  EXPECT_EQ(found(), "realtime; realtime_settings threads send priority; ");
}

TEST(Compare, RealtimeSettingsThatDifferHaveBothTheirValues) {
  const auto with = [](const char* realtime) {
    conditions::Run usual;
    conditions::key_named("realtime")->set(usual, realtime);
    std::vector runs{run("x", "k", 1)};
    amend(runs[0].run.asked, {{"realtime", usual.task.realtime.on},
                              {"realtime_settings", conditions::to_json(usual).at("realtime_settings")}});
    return runs;
  };
  const auto off = with("off"), on = with("on");
  auto own = on;
  amend(own[0].run.asked, "/realtime_settings/lock_memory", false);
  amend(own[0].run.asked, "/realtime_settings/threads/send/priority", 95);
  const auto shown = [](const std::vector<Summary>& a, const std::vector<Summary>& b) {
    return render(compare(a, b), {}, Format::table);
  };
  const auto text = shown(on, own);
  EXPECT_THAT(text, HasSubstr("realtime_settings lock_memory: true → false"));
  EXPECT_THAT(text, ::testing::ContainsRegex("threads\\s+send\\s+priority:\\s+80\\s+→\\s+95"));
  EXPECT_THAT(shown(off, own), Not(HasSubstr("lock_memory"))) << "memory is locked in neither";
}

TEST(Compare, DifferencesOfKeysAreInTheirWords) {
  std::vector a{run("x", "k", 1)}, b{run("x", "k", 1)};
  amend(b[0].run.asked, {{"realtime", true}, {"payload_bytes", 1024}, {"period_us", 20000}});
  amend(b[0].run.asked, "/qos/reliability", "reliable");
  const std::string words =
      "payload: 500 B → 1 KiB; period: 10 ms → 20 ms; qos.reliability: best-effort → reliable; realtime: off "
      "→ on";
  const auto comparison = compare(a, b);
  EXPECT_THAT(render(comparison, {}, Format::markdown), HasSubstr(words));
  EXPECT_THAT(render_answer(comparison, {}, Format::table, "", 1000), HasSubstr(words));
  const auto found = parsed_json(render(comparison, {}, Format::json)).at("pairs").at(0).at("not_the_same");
  EXPECT_EQ(found.at(0), (json{{"what", "payload_bytes"}, {"from", "500"}, {"to", "1024"}}));
}

TEST(Compare, DifferencesThatWouldReadTheSameStayAsTheyAre) {
  std::vector a{run("x", "k", 1)}, b{run("x", "k", 1)};
  amend(b[0].run.asked, "/period_us", 10000.04);
  EXPECT_THAT(render(compare(a, b), {}, Format::markdown), HasSubstr("period\\_us: 10000 → 10000.04"));
}

TEST(Compare, DifferencesOfRatesHaveTheirUnits) {
  std::vector a{run("x", "k", 1)}, b{run("x", "k", 1)};
  amend(a[0].run.asked, {{"traffic", {{"bit_s", 1'000}}}, {"neighbours", {{"rate_hz", 50}}}});
  amend(b[0].run.asked, {{"traffic", {{"bit_s", 80'000'000}}}, {"neighbours", {{"rate_hz", 100}}}});
  EXPECT_THAT(render(compare(a, b), {}, Format::markdown),
              AllOf(HasSubstr("background.rate: 50 Hz → 100 Hz"),
                    HasSubstr("traffic.rate: 0.001 Mbit/s → 80 Mbit/s")));
}

TEST(Compare, FirstScreenNamesTheMostImportantDifferencesAndThoseOfBothHostsOnce) {
  const std::vector a{run("x", "k", 1)};
  std::vector b{run("x", "k", 1)};
  amend(b[0].run.asked, {{"period_us", 20000}, {"ontime", "0.3.0"}});
  for (const auto* host : {"controller", "component"}) {
    const auto of = std::string("/hosts/") + host;
    for (const auto* key :
         {"clocksource", "cpu_count", "cpu_model", "governor", "hostname", "kernel_release", "preemption"})
      amend(b[0].run.outcome, of + "/machine/" + key, std::string("new ") + key);
    amend(b[0].run.outcome, of + "/machine/kernel_command_line", std::string(200, 'x'));
    amend(b[0].run.outcome, of + "/transport/version", "9.9.9");
  }
  amend(b[0].run.outcome, "/hosts/component/machine/hostname", "arm");
  const auto text = render_answer(compare(a, b), {}, Format::table, "", 1000);
  EXPECT_THAT(found_in(text, "(period|(?:\\w+ )?hostname|\\w+|udp version): [^;:\n]* → [^;\n]*[;\n]"),
              ::testing::ElementsAre("period", "component hostname", "controller hostname", "kernel_release",
                                     "preemption", "cpu_model", "cpu_count", "udp version", "ontime",
                                     "governor", "clocksource", "kernel_command_line"));
  EXPECT_THAT(render(compare(a, b), {}, Format::markdown),
              HasSubstr("period: 10 ms → 20 ms; component hostname"));
  const auto document = parsed_json(render(compare(a, b), {}, Format::json));
  EXPECT_EQ(document.at("pairs").at(0).at("not_the_same").size(), 20u) << "of each host";
}

TEST(Compare, ImportsOfOtherCommandLinesNameThem) {
  const auto imported = [](const char* command) {
    std::vector runs{run("x", "k", 1)};
    amend(
        runs[0].run.asked, "/imported",
        {{"from", "cyclictest-json"}, {"file", "a.json"}, {"cmdline", command}, {"rt_test_version", "2.40"}});
    runs[0].imported = statistics::Imported{"cyclictest-json", "a.json"};
    return runs;
  };
  const auto usual = imported("cyclictest -t1 -i1000 -q --json=a.json");
  const auto shown = [&](const char* command) {
    return render(compare(usual, imported(command)), {}, Format::markdown);
  };
  EXPECT_THAT(shown("cyclictest -t1 -i200 -p80 --json b.json"),
              HasSubstr("command line: cyclictest -t1 -i1000 → cyclictest -t1 -i200 -p80"));
  EXPECT_THAT(shown("cyclictest -t1 -i1000 --json=b.json --quiet"), Not(HasSubstr("command line")));
}

TEST(Compare, RequestedAndAchievedDifferencesAreListed) {
  const std::vector a{run("x", "k", 1)};
  std::vector b{run("x", "k", 1, 7)};
  amend(b[0].run.asked, {{"traffic", {{"bit_s", 80'000'000}}},
                         {"link", {{"loss", 0.1}}},
                         {"kernel", {{"irq-threads", 90}}},
                         {"repetition", 3},
                         {"payload_bytes", 500.0}});
  auto& outcome = b[0].run.outcome;
  amend(outcome, "/traffic/to_component/short", true);
  amend(outcome, "/link_unproved", "it is not proved");
  amend(outcome, "/hosts/controller/load_running", false);
  amend(outcome, "/hosts/component/refusals", {{{"asked", "fifo 80"}, {"found", "EPERM"}, {"remedy", "y"}}});
  std::vector<std::string> found;
  const auto document = parsed_json(render(compare(a, b), {}, Format::json));
  for (const auto& one : document.at("pairs").at(0).at("not_the_same"))
    found.push_back(one.at("what").get<std::string>() + ": " + one.at("from").get<std::string>() + ", " +
                    one.at("to").get<std::string>());
  EXPECT_THAT(found,
              ::testing::UnorderedElementsAre(
                  "component refused fifo 80: -, EPERM", "controller load_running: -, false",
                  "kernel irq-threads: -, 90", "link loss: -, 0.1", "link_unproved: -, it is not proved",
                  "traffic bit_s: -, 80000000", "traffic to_component short: -, true"));
  EXPECT_THAT(render(compare(a, b), {}, Format::table),
              AllOf(HasSubstr("x udp #3 (run 7) of B: "), HasSubstr("load on the controller")));
}

}  // namespace
}  // namespace ontime::report

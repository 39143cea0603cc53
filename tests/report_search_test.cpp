// SPDX-License-Identifier: Apache-2.0
// What became of background topics, and what searches found.
#include "json.hpp"
#include "plot/plot.hpp"
#include "report/answer.hpp"
#include "report/runs.hpp"
#include "report_fixture.hpp"

namespace ontime::report {
namespace {

using plot::gnuplot_of, plot::Plot;
using ::testing::AllOf;
using ::testing::ContainsRegex;
using ::testing::HasSubstr;
using ::testing::Not;

json with_background(double rate_hz = 100) {
  auto with = asked("a", "cyclonedds");
  with["neighbours"] = {{"topics", 4},
                        {"where", "same-process"},
                        {"payload_bytes", 32768},
                        {"rate_hz", rate_hz},
                        {"reliability", "reliable"},
                        {"there", true},
                        {"back", false},
                        {"priority", 0}};
  return with;
}

json way(int sent, int received, int skipped = 0) {
  return {{"sent", sent},
          {"received", received},
          {"lost", sent - received},
          {"refused", 0},
          {"skipped_cycles", skipped},
          {"strays", 0},
          {"short", skipped > sent / 19}};
}

TEST(TableFormat, TellsTheBackgroundAndLoudlyWhereTheyWereNotThere) {
  auto came = outcome();
  came["neighbours"]["to_component"] = way(8000, 7990);
  auto text = render({summary(with_background(), came)}, Format::markdown);
  EXPECT_THAT(
      text,
      HasSubstr(
          "4 background topics of 32 KiB to the component, reliable, at 100 Hz, in another participant"));
  EXPECT_THAT(text, HasSubstr("background topics: 7,990 of 8,000 arrived at the component (10 lost)"));
  EXPECT_THAT(render({summary(with_background(20'000), came)}, Format::markdown),
              HasSubstr(", at 20 kHz, in"));
  came["neighbours"]["to_component"] = way(5000, 5000, 3000);
  text = render({summary(with_background(), came)}, Format::markdown);
  EXPECT_THAT(text, HasSubstr("BACKGROUND TOPICS SHORTFALL: 5,000 of 8,000 arrived at the component "
                              "(3,000 not sent because their sender overran its period)"));
  EXPECT_THAT(render({summary(asked("a", "udp"), outcome())}, Format::markdown), Not(HasSubstr("eighbours")));
}

Summary step(int number, const char* value, std::uint64_t late, int repetition = 1) {
  auto of = with_background(100.0 * (number + 1));
  of["repetition"] = repetition;
  of["search"] = {
      {"key", "background.rate"}, {"value", value}, {"step", number}, {"steps", 4}, {"among", ""}};
  auto one = summary(of, outcome());
  amend(one.run.outcome, "/late", one.late = late);
  one.on_time -= late;
  return one;
}

TEST(Searches, AreBetweenTheLastValueWithoutAMissAndTheFirstWithOne) {
  const Summaries summaries = {step(0, "100 Hz", 0),    step(1, "200 Hz", 0), step(1, "200 Hz", 0, 2),
                               step(3, "800 Hz", 7, 1), step(2, "400 Hz", 0), step(2, "400 Hz", 3, 2)};
  const auto text = render(summaries, Format::markdown);
  EXPECT_THAT(text, HasSubstr("highest background.rate without a miss"));
  const auto searches = parsed_json(render(summaries, Format::json)).at("searches");
  ASSERT_EQ(searches.size(), 1U);
  EXPECT_EQ(searches[0].at("passed").at("value"), "200 Hz");
  auto bound = step(0, "100 Hz", 0);
  bound.missed_probability.effect = 1e5;
  EXPECT_THAT(render({bound}, Format::markdown), HasSubstr("< 100 %"));
  bound.sent = 3'600'000;  // an hour of 1 kHz
  bound.missed_probability.effect = 1;
  EXPECT_THAT(render({bound}, Format::markdown), HasSubstr("< 0.000084 %"));
  EXPECT_EQ(searches[0].at("passed").at("messages"), 4000) << "of both repetitions";
  EXPECT_EQ(searches[0].at("ended").at("value"), "400 Hz") << "in one of its repetitions";
  EXPECT_EQ(searches[0].at("ended").at("late"), 3);
  EXPECT_NEAR(searches[0].at("missed_below").get<double>(), std::log(4 / 0.05) / 4000, 1e-5)
      << "of four tried values";
}

TEST(Searches, EndWhereARowIsLateByResponseTimeAlone) {
  Summaries summaries = {step(0, "100 Hz", 0), step(1, "200 Hz", 0)};
  amend(summaries[1].run.outcome, "/late_by_response_only", 2);
  EXPECT_THAT(report::answer_of(summaries, {}).sentence,
              HasSubstr("Highest background.rate without a miss: 100 Hz."));
  const auto ended = parsed_json(render(summaries, Format::json)).at("searches").at(0).at("ended");
  EXPECT_EQ(ended.at("late_by_response_only"), 2);
  EXPECT_THAT(render(summaries, Format::markdown), HasSubstr("2 late by response time of 2,000 messages"));
}

TEST(Searches, TheFirstScreenHasTheirResult) {
  const Summaries summaries = {step(0, "100 Hz", 0), step(1, "200 Hz", 0), step(2, "400 Hz", 3)};
  EXPECT_THAT(report::answer_of(summaries, {}).sentence,
              HasSubstr("Highest background.rate without a miss: 200 Hz."));
  EXPECT_THAT(report::answer_of({summaries[2]}, {}).sentence, HasSubstr(": none (search not finished)."));
  EXPECT_THAT(report::answer_of({summary(asked("a", "udp"), outcome())}, {}).sentence,
              Not(HasSubstr("Highest")));
}

TEST(Searches, OfSeveralComponentsAreToldApartOnTheFirstScreen) {
  auto arm = step(0, "100 Hz", 0), base = step(0, "100 Hz", 1);
  amend(arm.run.asked, "/component", "arm");
  amend(base.run.asked, "/component", "base");
  EXPECT_THAT(report::answer_of({arm, base}, {}).sentence,
              AllOf(HasSubstr("cyclonedds arm 100 Hz"), HasSubstr("cyclonedds base none")));
}

TEST(Searches, EndForAllComponentsWhereOneMisses) {
  Summaries summaries;
  const auto add = [&](int number, const char* value, std::uint64_t late_of_base) {
    for (const auto& [component, late] : {std::pair("arm", std::uint64_t{0}), {"base", late_of_base}}) {
      summaries.push_back(step(number, value, late));
      amend(summaries.back().run.asked, "/component", component);
    }
  };
  const auto searches = [&] { return parsed_json(render(summaries, Format::json)).at("searches"); };
  add(0, "100 Hz", 0);
  add(2, "400 Hz", 5);
  EXPECT_FALSE(searches()[0].at("finished"));
  add(1, "200 Hz", 0);
  const auto arm = searches()[0];
  EXPECT_EQ(arm.at("passed").at("value"), "400 Hz");
  EXPECT_TRUE(arm.at("ended").is_null()) << "it had no miss";
  EXPECT_TRUE(arm.at("finished"));
  EXPECT_TRUE(searches()[1].at("finished"));
  EXPECT_THAT(render(summaries, Format::markdown), HasSubstr("| 400 Hz | another component |"));
}

TEST(Searches, SayWhereNothingMissedAndWhereTheGentlestDid) {
  auto found = parsed_json(render({step(0, "100 Hz", 0)}, Format::json)).at("searches").at(0);
  EXPECT_TRUE(found.at("ended").is_null());
  EXPECT_EQ(found.at("passed").at("value"), "100 Hz");
  found = parsed_json(render({step(0, "100 Hz", 1)}, Format::json)).at("searches").at(0);
  EXPECT_TRUE(found.at("passed").is_null());
  EXPECT_TRUE(found.at("missed_below").is_null());
  EXPECT_EQ(parsed_json(render({summary(asked("a", "udp"), outcome())}, Format::json)).at("searches"),
            json::array());
}

TEST(Searches, UnfinishedSearchIsMarked) {
  auto found = parsed_json(render({step(0, "100 Hz", 0)}, Format::json)).at("searches").at(0);
  EXPECT_FALSE(found.at("finished"));
  EXPECT_THAT(render({step(0, "100 Hz", 0)}, Format::markdown), HasSubstr("search not finished"));
  found =
      parsed_json(render({step(1, "200 Hz", 0), step(3, "800 Hz", 7)}, Format::json)).at("searches").at(0);
  EXPECT_FALSE(found.at("finished"));
  found = parsed_json(render({step(3, "800 Hz", 0)}, Format::json)).at("searches").at(0);
  EXPECT_TRUE(found.at("finished")) << "nothing is beyond";
}

TEST(Searches, AreNotMixedWithLaterOnesOfTheSameFile) {
  const auto text = render(
      {step(0, "100 Hz", 0), step(1, "200 Hz", 3), step(0, "100 Hz", 0), step(1, "200 Hz", 0)}, Format::json);
  const auto searches = parsed_json(text).at("searches");
  ASSERT_EQ(searches.size(), 2U);
  EXPECT_EQ(searches[0].at("ended").at("value"), "200 Hz");
  EXPECT_TRUE(searches[1].at("ended").is_null());
}

TEST(Searches, OfOneFileAreToldApartInTheTableToo) {
  const auto text =
      render({step(0, "100 Hz", 0), step(1, "200 Hz", 0), step(3, "800 Hz", 7), step(2, "400 Hz", 3),
              step(0, "100 Hz", 0), step(1, "200 Hz", 0), step(3, "800 Hz", 0)},
             Format::markdown);
  EXPECT_THAT(text, ContainsRegex("200 Hz \\| 2,000 \\| .* \\| 400 Hz \\| 3 late of 2,000 messages"));
  EXPECT_THAT(text, ContainsRegex("800 Hz \\| 2,000 \\| .* \\| none \\| -"));
}

TEST(Searches, EndAtAFailedRunOrALoadShortfall) {
  auto failed = step(1, "200 Hz", 0);
  amend(failed.run.outcome, "/error", "no answer");
  auto found = parsed_json(render({step(0, "100 Hz", 0), failed}, Format::json)).at("searches").at(0);
  EXPECT_TRUE(found.at("ended").is_null()) << "the connection was lost, say";
  EXPECT_FALSE(found.at("finished"));
  amend(failed.run.outcome, "/unanswered", true);
  found = parsed_json(render({step(0, "100 Hz", 0), failed}, Format::json)).at("searches").at(0);
  EXPECT_TRUE(found.at("ended").at("failed"));
  EXPECT_TRUE(found.at("finished"));
  auto overran = step(1, "200 Hz", 0);
  amend(overran.run.outcome, "/neighbours/to_component", way(100, 100, 100));
  found = parsed_json(render({step(0, "100 Hz", 0), overran}, Format::json)).at("searches").at(0);
  EXPECT_TRUE(found.at("ended").at("short"));
  EXPECT_EQ(found.at("passed").at("value"), "100 Hz");
}

TEST(Searches, NameEachOfTheirKeys) {
  auto one = step(0, "1 ms", 0), other = step(0, "1 ms", 0);
  amend(one.run.asked, "/search/key", "arm.period");
  amend(other.run.asked, "/search/key", "period");
  EXPECT_THAT(render({one, other}, Format::markdown), HasSubstr("highest arm.period, period without a miss"));
}

TEST(Plots, DrawTheRoundTripAgainstTheBackgroundRate) {
  const auto text = gnuplot_of({step(0, "100 Hz", 0), step(1, "200 Hz", 5)}, {Plot::Figure::background});
  EXPECT_THAT(text, AllOf(HasSubstr("messages/s"), HasSubstr("\n100 1.98 1.98 1.98\n200 1.98 1.98 1.98\n"),
                          HasSubstr("$missed0 << END\n200 1.98 1.98 1.98\nEND")));
  EXPECT_THAT(gnuplot_of({step(0, "100 Hz", 0)}, {Plot::Figure::background}), Not(HasSubstr("$missed")));
}

Summary all_lost(Summary run) {
  amend(run.run.outcome, "/lost", run.lost = run.sent);
  run.on_time = 0;
  run.round_trip = {};
  return run;
}

TEST(Plots, MarkAStepOfWhichAllMessagesWereLost) {
  const auto good = step(0, "100 Hz", 0), bad = all_lost(step(1, "200 Hz", 0));
  auto text = gnuplot_of({good, bad}, {Plot::Figure::background});
  EXPECT_THAT(text, AllOf(HasSubstr("$missed0 << END\n200 10\nEND"), HasSubstr("set yrange [0.7")))
      << "at the deadline of 10 ms";
  EXPECT_THAT(text, HasSubstr(":14]\n")) << "which is within the axes";
  EXPECT_THAT(gnuplot_of({bad}, {Plot::Figure::background}), Not(HasSubstr("$run0")));
  auto without = good, open_end = bad;
  for (auto* run : {&without, &open_end}) amend(run->run.asked, "/deadline_us", 0);
  text = gnuplot_of({without, open_end}, {Plot::Figure::background});
  EXPECT_THAT(text, HasSubstr("$missed0 << END\n200 2.772\nEND")) << "at the top";
  EXPECT_THAT(text, HasSubstr(":2.772]\n"));
  text =
      gnuplot_of({good, step(1, "200 Hz", 0), all_lost(step(1, "200 Hz", 0, 2))}, {Plot::Figure::background});
  EXPECT_THAT(text, HasSubstr("$missed0 << END\n200 1.98 1.98 1.98\nEND")) << "one of two repetitions";
}

TEST(Plots, MarkAStepThatIsLateByResponseTimeAlone) {
  auto late = step(1, "200 Hz", 0);
  late.late_by_response = 2;
  EXPECT_THAT(gnuplot_of({step(0, "100 Hz", 0), late}, {Plot::Figure::background}),
              HasSubstr("$missed0 << END\n200 1.98 1.98 1.98\nEND"));
}

TEST(Plots, PayloadFigureMarksMisses) {
  auto run = step(0, "100 Hz", 5);
  EXPECT_THAT(gnuplot_of({run}, {Plot::Figure::payload}), HasSubstr("$missed0 << END\n500 1.98 "));
}

TEST(Plots, DrawEachSearchAsALineOfItsOwn) {
  auto single = step(0, "100 Hz", 0), multi = step(0, "100 Hz", 0);
  amend(single.run.asked, "/options/executor", "single");
  amend(multi.run.asked, "/options/executor", "multi");
  auto arms = multi;
  amend(arms.run.asked, "/component", "arm");
  amend(multi.run.outcome, "/error", "no answer");
  auto sizes = multi;
  amend(sizes.run.asked, "/neighbours/payload_bytes", 1000);
  EXPECT_THAT(gnuplot_of({single, sizes}, {Plot::Figure::background, Plot::Form::svg, true}),
              HasSubstr("executor multi, 4 background topics of 1000 B"));
  const auto text = gnuplot_of({single, multi, arms}, {Plot::Figure::background});
  EXPECT_THAT(text, AllOf(HasSubstr("cyclonedds executor single'"), HasSubstr("cyclonedds executor multi'"),
                          HasSubstr("cyclonedds component arm, executor multi'")));
  EXPECT_THAT(text, AllOf(HasSubstr("$missed1 << END\n100 1.98 1.98 1.98\nEND"), Not(HasSubstr("$missed0"))))
      << "a run that failed is no good one";
}

TEST(Plots, PayloadFigureDrawsALineForEachVariant) {
  auto one = step(0, "", 0), other = step(0, "", 0);
  amend(one.run.asked,
        {{"search", nullptr}, {"variant", "payload 1 KiB, receive waitset"}, {"receive", "waitset"}});
  amend(other.run.asked,
        {{"search", nullptr}, {"variant", "payload 1 KiB, receive listener"}, {"receive", "listener"}});
  EXPECT_THAT(gnuplot_of({one, other}, {Plot::Figure::payload}),
              AllOf(HasSubstr("cyclonedds waitset'"), HasSubstr("cyclonedds listener'")));
}

}  // namespace
}  // namespace ontime::report

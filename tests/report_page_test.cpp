// SPDX-License-Identifier: Apache-2.0
// The page, and what is packed into it. That a browser draws it is tested by page_test.py.
#include <algorithm>
#include <random>

#include <fmt/format.h>
#include <sodium.h>
#include <zlib.h>

#include "gate/gate.hpp"
#include "page/course.hpp"
#include "page/page.hpp"
#include "page/parts.hpp"
#include "record/record.hpp"
#include "report/runs.hpp"
#include "report_fixture.hpp"
#include "table/table.hpp"

namespace ontime::report {
namespace {

using page::code_of, page::code_of_lost, page::Course;
using roundtrip::Fate;
using roundtrip::Sample;
using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

// As a browser does it, in other words.
std::vector<std::uint8_t> unpacked(const nlohmann::json& base64) {
  const auto text = base64.get<std::string>();
  std::vector<std::uint8_t> deflated(text.size()), bytes(1 << 22);
  std::size_t size = 0;
  EXPECT_EQ(sodium_base642bin(deflated.data(), deflated.size(), text.data(), text.size(), nullptr, &size,
                              nullptr, sodium_base64_VARIANT_ORIGINAL),
            0);
  auto length = static_cast<uLongf>(bytes.size());
  EXPECT_EQ(uncompress(bytes.data(), &length, deflated.data(), static_cast<uLong>(size)), Z_OK);
  bytes.resize(length);
  return bytes;
}

std::vector<std::uint64_t> numbers_in(const std::vector<std::uint8_t>& bytes) {
  std::vector<std::uint64_t> numbers;
  std::uint64_t value = 0;
  int place = 0;
  for (const auto byte : bytes) {
    value |= std::uint64_t{byte & 0x7fu} << place;
    place += 7;
    if ((byte & 0x80) != 0) continue;
    numbers.push_back(std::exchange(value, 0));
    place = 0;
  }
  return numbers;
}

struct Unpacked {
  std::uint64_t index;
  std::int64_t due_us;
  std::uint16_t code;
  Fate fate;
};

std::vector<Unpacked> unpacked(Course& course) {
  const auto packed = course.packed();
  const auto high = unpacked(packed["high"]), low = unpacked(packed["low"]);
  const auto steps = numbers_in(unpacked(packed["steps"])),
             messages = numbers_in(unpacked(packed["messages"]));
  const auto count = packed["count"].get<std::size_t>();
  EXPECT_EQ(high.size(), count);
  EXPECT_EQ(low.size(), count);
  EXPECT_EQ(steps.size(), count);
  EXPECT_EQ(messages.size(), count);
  std::vector<Unpacked> all;
  std::uint64_t next = 0;
  const auto period_us = packed["period_us"].get<std::int64_t>();
  std::int64_t due_us = -period_us;
  for (std::size_t i = 0; i < count; ++i) {
    const auto half = static_cast<std::int64_t>(steps[i] / 2);
    due_us += period_us + (steps[i] % 2 == 0 ? half : -half - 1);
    next += messages[i] / 4;
    all.push_back({next++, due_us, static_cast<std::uint16_t>(high[i] << 8 | low[i]),
                   static_cast<Fate>(messages[i] % 4)});
  }
  return all;
}

TEST(Code, keeps_the_order_of_times_and_one_part_in_4096) {
  std::uint16_t last = 0;
  for (std::int64_t ns = 0; ns < 4'000'000'000'000; ns += 1 + ns / 9000) {
    const auto code = code_of(ns);
    ASSERT_GE(code, last) << ns;
    ASSERT_LT(code, code_of_lost);
    last = code;
    const std::int64_t shift = std::max((code >> 11) - 1, 0);
    const std::int64_t least = (code - (shift << 11)) << shift, after = least + (std::int64_t{1} << shift);
    ASSERT_LE(least, ns);
    ASSERT_GT(after, ns);
    ASSERT_LE((after - least - 1) * 2048, std::max<std::int64_t>(ns, 1)) << ns;
  }
  EXPECT_EQ(code_of(4095), 4095);
}

TEST(Code, of_what_no_clock_says_is_no_lost_one) {
  EXPECT_EQ(code_of(-5), 0);
  EXPECT_EQ(code_of(std::numeric_limits<std::int64_t>::max()), code_of_lost - 1);
}

TEST(Course, has_every_message_with_its_time_and_fate) {
  Course course(1'000 * ms, 10 * ms, 1);
  course.message(sample(0, 700'000));
  course.message(sample(1, 12 * ms, Fate::late));
  course.message(sample(4, 0, Fate::lost));  // what lies between was not recorded
  course.message(sample(5, 5));
  const auto all = unpacked(course);
  ASSERT_EQ(all.size(), 4u);
  EXPECT_EQ(all[1].index, 1u);
  EXPECT_EQ(all[1].due_us, 10'000);
  EXPECT_EQ(all[1].code, code_of(12 * ms));
  EXPECT_EQ(all[1].fate, Fate::late);
  EXPECT_EQ(all[2].index, 4u);
  EXPECT_EQ(all[2].due_us, 40'000);
  EXPECT_EQ(all[2].code, code_of_lost);
  EXPECT_EQ(all[3].index, 5u);
  EXPECT_EQ(all[3].code, 5);
}

TEST(Course, of_more_messages_than_a_page_holds_keeps_the_extremes_of_any_stretch) {
  std::mt19937 chance(7);
  std::lognormal_distribution<double> times(13, 1.5);
  constexpr std::uint64_t of = 5, messages = 10'007;
  Course course(1'000 * ms, 10 * ms, of);
  std::vector<std::uint16_t> codes;
  for (std::uint64_t i = 0; i < messages; ++i) {
    const bool lost = chance() % 500 == 0;
    const auto ns = static_cast<std::int64_t>(times(chance));
    course.message(sample(i, ns, lost ? Fate::lost : Fate::on_time));
    codes.push_back(lost ? code_of_lost : code_of(ns));
  }
  const auto kept = unpacked(course);
  EXPECT_LE(kept.size(), messages / of + 2 + std::count(codes.begin(), codes.end(), code_of_lost));
  for (std::uint64_t from = 0; from < messages; from += 2 * of) {
    const auto to = std::min<std::uint64_t>(from + 2 * of * (1 + chance() % 20), messages);
    const auto begin = codes.begin() + static_cast<std::ptrdiff_t>(from),
               end = to == messages ? codes.end()
                                    : begin + static_cast<std::ptrdiff_t>((to - from) / (2 * of) * (2 * of));
    const auto slower = [](std::uint16_t one, std::uint16_t other) {  // a lost one is none that was slow
      return other != code_of_lost && (one == code_of_lost || one < other);
    };
    std::uint16_t least = code_of_lost, greatest = 0, slowest = code_of_lost;
    for (const auto& point : kept) {
      if (point.index < from || point.index >= from + static_cast<std::uint64_t>(end - begin)) continue;
      least = std::min(least, point.code);
      greatest = std::max(greatest, point.code);
      slowest = std::max(slowest, point.code, slower);
      ASSERT_EQ(point.code, codes[point.index]);
    }
    ASSERT_EQ(least, *std::min_element(begin, end)) << from;
    ASSERT_EQ(greatest, *std::max_element(begin, end)) << from;
    ASSERT_EQ(slowest, *std::max_element(begin, end, slower)) << from;
  }
}

TEST(Course, of_times_that_cannot_be_is_packed_all_the_same) {
  Course course(std::numeric_limits<std::int64_t>::min(), 10 * ms, 1);
  auto wild = sample(0, 0);
  wild.due_ns = std::numeric_limits<std::int64_t>::max();
  course.message(wild);
  course.message(sample(1, 0));
  EXPECT_EQ(unpacked(course).size(), 2u);
}

TEST(Html, text_stays_text) {
  EXPECT_EQ(table::escaped("<b a='1' c=\"2\">&\n\u2028\x1b"),
            "&lt;b a=&#39;1&#39; c=&quot;2&quot;&gt;&amp;  ?");
}

class Page : public ::testing::Test {
 protected:
  void add_run(const json& asked, json outcome, const std::vector<Sample>& samples) {
    const auto run = writer_.begin_run(asked);
    writer_.append(run, samples);
    for (const auto& note : notes_) writer_.note(run, note);
    if (outcome.contains("sent")) outcome["sent"] = samples.size();
    writer_.end_run(run, outcome);
  }
  std::string page(const std::string& name = "results.ontime") {
    const auto reader = writer_.reader();
    Summaries summaries;
    for (const auto& run : reader.runs()) summaries.push_back(statistics::summarise(reader, run));
    return page::page_of(reader, summaries, {.file = name});
  }
  record::Writer writer_{""};
  std::vector<record::Note> notes_;
};

TEST_F(Page, shows_hostile_names_and_runs_none_of_them) {
  const std::string hostile = "</script><script>alert(1)</script><!--<img src=x onerror=alert(2)>\"'\u2028";
  auto request = asked(hostile, hostile);
  for (const auto* key : {"title", "variant", "schedule", "receive", "hosts"}) request[key] = hostile;
  request["options"] = {{hostile, hostile}};
  auto came = outcome();
  came["hosts"]["controller"]["threads"][0]["name"] = hostile;
  came["hosts"]["controller"]["machine"][hostile] = hostile;
  came["hosts"]["controller"]["refusals"] = {{{"asked", hostile}, {"found", hostile}, {"remedy", hostile}}};
  came["hosts"][hostile] = came["hosts"]["controller"];
  came["error"] = hostile;
  notes_ = {{hostile, hostile, 1'000 * ms, 0}};
  add_run(request, came, {sample(0, ms), sample(1, 20 * ms, Fate::late)});
  const auto html = page(hostile);
  EXPECT_THAT(html, Not(HasSubstr("<script>alert")));
  EXPECT_THAT(html, Not(HasSubstr("<img")));
  EXPECT_THAT(html, Not(HasSubstr("\u2028")));
  EXPECT_THAT(html, HasSubstr("&lt;script&gt;alert(1)&lt;/script&gt;"));
  // Its own elements, and no end of one but theirs. (D3's licence is a comment, which none of them can
  // begin.)
  EXPECT_EQ(found_in(html, "(<script)").size(), 6u);
  EXPECT_EQ(found_in(html, "(</script)").size(), 6u);
  EXPECT_EQ(found_in(html, "(<!--)").size(), 1u);
}

TEST_F(Page, lets_no_script_run_but_its_own) {
  add_run(asked("a", "udp"), outcome(), {sample(0, ms)});
  const auto html = page();
  const auto policy = found_in(html, "http-equiv=\"Content-Security-Policy\" content=\"([^\"]*)\"");
  ASSERT_EQ(policy.size(), 1u);
  EXPECT_THAT(policy[0], HasSubstr("default-src 'none'"));
  EXPECT_THAT(policy[0], Not(HasSubstr("unsafe")));
  EXPECT_EQ(found_in(policy[0], "(sha256-)").size(), 6u);  // five scripts and a style
  EXPECT_TRUE(found_in(html, "( (?:src|href)=\"[^#\"])").empty()) << "nothing is fetched";
  EXPECT_TRUE(found_in(html, "(<[a-z]+ [^<>]*style=)").empty()) << "no style but that of the page";
}

TEST_F(Page, of_a_file_without_runs_says_so) {
  const auto html = page();
  EXPECT_THAT(html, HasSubstr("Nothing was measured."));
}

TEST_F(Page, has_each_figure_as_json_has_it) {
  add_run(asked("a", "udp"), outcome(),
          {sample(0, 1'234'567), sample(1, 20 * ms, Fate::late), sample(2, 0, Fate::lost)});
  const auto html = page();
  for (const auto* cell :
       {"data-figure=\"sent\" value=\"3\"", "data-figure=\"late\" value=\"1\"",
        "data-figure=\"lost\" value=\"1\"", "data-figure=\"min\" value=\"1234.567\"",
        "data-figure=\"mean\" value=\"10617.284\"", "data-figure=\"max\" value=\"20000.000\""})
    EXPECT_THAT(html, HasSubstr(cell));
}

TEST_F(Page, says_of_a_quantile_and_of_the_worst_case_what_the_table_says) {
  std::mt19937_64 random(5);
  std::vector<Sample> samples;
  for (std::uint64_t i = 0; i < 3000; ++i)
    samples.push_back(sample(i, 400'000 + static_cast<std::int64_t>(random() % 100'000)));
  add_run(asked("a", "udp"), outcome(), samples);
  const auto reader = writer_.reader();
  const auto table = render({statistics::summarise(reader, reader.runs().front())}, Format::table);
  const auto html = page();
  const auto shown = found_in(html, "data-figure=\"p99.9\"[^>]*>([^<]*)<");
  ASSERT_EQ(shown.size(), 1u);
  EXPECT_EQ(row_of(table, "udp").at(6), shown[0]);
  const auto seen = found_in(table, "Slowest \\(µs\\).*\nudp +([0-9]+) ");
  ASSERT_EQ(seen.size(), 1u);
  EXPECT_THAT(html, HasSubstr("Extrapolated worst case"));
  EXPECT_THAT(html, HasSubstr("<th scope=\"row\">udp</th><td class=\"number\">" + seen[0] + "</td>"));
}

TEST_F(Page, shows_no_messages_of_what_was_imported) {
  json request = {{"id", "cyclictest"},
                  {"variant", "thread 0"},
                  {"imported", {{"from", "cyclictest-json"}, {"file", "c.json"}}}};
  const json histogram = {{"unit_ns", 1000},   {"values", {{9'000, 90}, {12'000, 9}}},
                          {"beyond", 1},       {"beyond_from_ns", 100'000},
                          {"max_ns", 400'000}, {"mean_ns", 12'000.0}};
  add_run(request, {{"interrupted", false}, {"histogram", histogram}}, {});
  const auto alone = page();
  EXPECT_THAT(alone, HasSubstr("No messages were measured"));
  EXPECT_THAT(alone, HasSubstr("thread 0 (c.json)"));
  EXPECT_THAT(alone, Not(HasSubstr("<figure")));
  EXPECT_THAT(alone, Not(HasSubstr("data-run=")));
  add_run(asked("a", "udp"), outcome(), {sample(0, ms)});
  const auto beside = page();
  EXPECT_THAT(beside, HasSubstr("The only cycle had an answer within 10 ms."));
  EXPECT_THAT(beside, HasSubstr(">10 %<")) << "of the deadline";
  add_run(asked("a", "udp"), outcome(), {sample(0, 9'970'000)});
  EXPECT_THAT(page(), HasSubstr(">99.7 %<"));
  EXPECT_THAT(beside, HasSubstr("thread 0 (c.json)"));
  EXPECT_EQ(found_in(beside, "(data-run=)").size(), 1u);
}

Summary judged(std::uint64_t on_time, std::uint64_t late, std::uint64_t lost) {
  auto run = summary(asked("Test1.B", "udp"), outcome(), 0);
  run.on_time = on_time;
  run.late = late;
  run.lost = lost;
  run.sent = on_time + late + lost;
  run.round_trip = statistics::distribution({300'000, 12 * ms});
  return run;
}

TEST(Drawing, DeadlineThatWasMissedStandsBeforeTheAnswer) {
  explain::Message message{.sample = sample(0, 9'800'000)};
  auto& of = message.sample;
  for (auto* time : {&of.woke_ns, &of.sent_ns, &of.received_ns}) *time += ms;
  explain::Scene scene;
  scene.legs = {{"sender wake-up", of.due_ns, of.woke_ns}, {"both legs", of.sent_ns, of.received_ns}};
  const auto after_due = [&](const char* name) {
    std::map<std::string, std::int64_t> at;
    const auto drawing = page::drawing_of(message, scene, 10 * ms);
    for (const auto& mark : drawing.at("marks")) at[mark.at(0)] = mark.at(1);
    return at.contains(name) ? at.at(name) - at.at("due") : -1;
  };
  EXPECT_EQ(after_due("back"), 10'800'000);
  EXPECT_EQ(after_due("deadline"), 11 * ms);
  message.late_by_response = true;
  EXPECT_EQ(after_due("deadline"), 10 * ms);
}

TEST(Verdict, BoundIsNeverRoundedBelowItself) {
  for (const auto& [messages, says] : {std::pair(6'100'000u, "fewer than 0.5 times in a million messages"),
                                       {2'100'000u, "fewer than 1.5 times in a million messages"}}) {
    auto run = judged(messages, 0, 0);
    run.missed_probability.messages = messages;
    run.missed_probability.bound = 2.9957 / messages;
    EXPECT_THAT(verdict_of({run}).further, HasSubstr(says));
  }
}

TEST(Verdict, says_whether_messages_were_on_time) {
  const auto fine = verdict_of({judged(24'000, 0, 0)});
  EXPECT_EQ(fine.word, Verdict::Word::yes);
  EXPECT_EQ(fine.sentence, "All 24,000 messages came back within the deadline of 10 ms.");
  EXPECT_EQ(verdict_of({judged(1, 0, 0)}).sentence,
            "The only message came back within the deadline of 10 ms.");
  const auto bad = verdict_of({judged(100, 2, 1), judged(97, 0, 0)});
  EXPECT_EQ(bad.word, Verdict::Word::no);
  EXPECT_EQ(bad.sentence, "2 of 200 messages missed the deadline of 10 ms, and 1 was lost.");
  EXPECT_THAT(bad.further, HasSubstr("1 of 2 runs"));
  EXPECT_THAT(bad.further, HasSubstr("12 ms (Test1.B, udp)"));
  EXPECT_EQ(verdict_of({judged(99, 0, 1)}).sentence, "1 of 100 messages was lost.");
}

TEST(Verdict, NamesRequirementsThatWereMissedOrAreOpen) {
  std::vector runs{judged(24'000, 0, 0), judged(24'000, 0, 0)};
  runs[0].notes.push_back({gate::open_note, "open: p99 <= 5 ms", {}, {}});
  EXPECT_EQ(verdict_of(runs).word, Verdict::Word::partly);
  EXPECT_THAT(verdict_of(runs).further, HasSubstr("requirement of 1 run is open"));
  runs[1].notes.push_back({gate::missed_note, "FAIL: p50 <= 1 us", {}, {}});
  EXPECT_EQ(verdict_of(runs).word, Verdict::Word::no);
  EXPECT_THAT(verdict_of(runs).further, HasSubstr("1 run missed a requirement"));
}

TEST(Verdict, IsNoYesWithoutALimit) {
  auto run = judged(5000, 0, 0);
  amend(run.run.asked, {{"measures", "age"}, {"deadline_us", nullptr}});
  auto verdict = verdict_of({run});
  EXPECT_EQ(verdict.word, Verdict::Word::partly);
  EXPECT_EQ(verdict.sentence, "None of 5,000 messages was lost.");
  EXPECT_THAT(verdict.further, HasSubstr("1 run had no limit"));
  amend(run.run.outcome, "/loss_unknown", true);
  run.notes.push_back({gate::open_note, "open: --age", {}, {}});
  verdict = verdict_of({run});
  EXPECT_EQ(verdict.word, Verdict::Word::nothing);
  EXPECT_THAT(verdict.sentence, HasSubstr("Nothing tells"));
  EXPECT_THAT(verdict.further, HasSubstr("requirement of 1 run is open"));
  EXPECT_EQ(verdict_of({run, judged(100, 0, 0)}).word, Verdict::Word::partly);
}

TEST(Verdict, does_not_praise_what_hides_a_stall_or_was_cut_off) {
  auto stalled = judged(100, 0, 0);
  stalled.late_by_response = 300;  // cycles that passed without a message
  EXPECT_EQ(verdict_of({stalled}).word, Verdict::Word::no);
  EXPECT_THAT(verdict_of({stalled}).sentence, HasSubstr("300 cycles had no answer within the deadline"));
  stalled.late_by_response = 1;
  EXPECT_THAT(verdict_of({stalled}).sentence, HasSubstr("but 1 cycle had no answer"));
  stalled = judged(100, 1, 0);
  stalled.late_by_response = 300;
  EXPECT_THAT(verdict_of({stalled}).sentence, HasSubstr("1 of 101 messages missed the deadline of 10 ms"));
  EXPECT_THAT(verdict_of({stalled}).sentence, HasSubstr("300 cycles"));
  EXPECT_THAT(verdict_of({stalled}).further, Not(HasSubstr("95 % confidence")));
  auto cut = judged(100, 0, 0);
  cut.run.outcome = {};
  EXPECT_EQ(verdict_of({cut}).word, Verdict::Word::partly);
  EXPECT_THAT(verdict_of({cut}).further, HasSubstr("1 run did not"));
  EXPECT_EQ(verdict_of({}).word, Verdict::Word::nothing);
}

TEST(Verdict, TellsCyclesWithoutAMessageFromLateOnesByResponseTime) {
  auto late = judged(100, 1, 0);
  amend(late.run.outcome, "/late_by_response_only", 2);
  late.late_by_response = 3;
  EXPECT_THAT(verdict_of({late}).sentence,
              ::testing::AllOf(HasSubstr("3 cycles had no answer"), Not(HasSubstr("without a message"))));
  late.late_by_response = 4;
  EXPECT_THAT(verdict_of({late}).sentence, HasSubstr("including cycles without a message"));
}

TEST(Verdict, never_says_yes_where_samples_are_missing) {
  auto run = judged(5000, 0, 0);
  amend(run.run.outcome, {{"dropped_records", 1500}, {"sent", 6500}, {"late", 0}, {"lost", 0}});
  EXPECT_EQ(verdict_of({run}).word, Verdict::Word::partly);
  EXPECT_THAT(verdict_of({run}).further, HasSubstr("1 run: 1,500 "));
  amend(run.run.outcome, {{"late", 700}, {"lost", 200}});
  EXPECT_EQ(verdict_of({run}).word, Verdict::Word::no);
  EXPECT_THAT(verdict_of({run}).sentence, HasSubstr("700 of 6,500 messages missed the deadline"));
}

TEST(Verdict, is_no_yes_to_what_was_not_asked) {
  auto run = judged(5000, 0, 0);
  run.missed_probability = statistics::Probability{};
  run.missed_probability.messages = 5000;
  amend(run.run.outcome, "/hosts/controller/load_running", false);
  const auto verdict = verdict_of({run});
  EXPECT_EQ(verdict.word, Verdict::Word::partly);
  EXPECT_THAT(verdict.further, HasSubstr("1 run: the load on the controller "));
  EXPECT_THAT(verdict.further, Not(HasSubstr("95 % confidence")));
}

TEST(Settings, show_what_differs_and_name_the_rest_once) {
  auto other = asked("b", "udp");
  other["payload_bytes"] = 32768;
  const auto table = differences_of({summary(asked("a", "udp"), outcome()),
                                     summary(asked("a", "udp", 2), outcome()), summary(other, outcome())});
  EXPECT_THAT(names_of(table), ElementsAre("Run", "payload"));
  EXPECT_THAT(table.rows, ElementsAre(ElementsAre("a: udp ×2", "500 B"), ElementsAre("b: udp", "32 KiB")));
  EXPECT_THAT(table.conditions, HasSubstr("every 10 ms"));
}

TEST(Settings, DeadlineThatIsThePeriodOfOneRunIsNoDifference) {
  auto faster = asked("b", "udp"), strict = asked("c", "udp");
  faster["period_us"] = 5000;
  const auto runs = [](const json& other) {
    return Summaries{summary(asked("a", "udp"), outcome()), summary(other, outcome())};
  };
  const auto same = differences_of(runs(faster));
  EXPECT_THAT(names_of(same), ElementsAre("Run", "period"));
  EXPECT_THAT(same.conditions, HasSubstr("deadline 10 ms"));
  strict["deadline_us"] = 5000;
  const auto other = differences_of(runs(strict));
  EXPECT_THAT(names_of(other), ElementsAre("Run", "deadline"));
  EXPECT_EQ(other.rows.at(0).at(1), "deadline 10 ms") << "its period";
  EXPECT_EQ(other.rows.at(1).at(1), "deadline 5 ms");
  faster["deadline_us"] = 5000;
  EXPECT_THAT(names_of(differences_of(runs(faster))), ElementsAre("Run", "period"));
}

TEST(Settings, of_machines_have_a_value_once_or_with_its_runs) {
  auto later = outcome();
  later["hosts"]["controller"]["machine"]["kernel"] = "6.2";
  auto second = summary(asked("a", "udp"), later);
  second.run.number = 2;
  const auto table = machines_of({summary(asked("a", "udp"), outcome()), second});
  EXPECT_THAT(table.rows, ElementsAre(ElementsAre("kernel", "6.1 (run 1); 6.2 (run 2)", "6.1")));
}

TEST_F(Page, HeadlineDoesNotPoolOppositeConditions) {
  auto idle = asked("Test1.A", "udp"), loaded = asked("Test1.B", "udp");
  loaded["title"] = "System under load";
  add_run(idle, outcome(), {sample(0, ms), sample(1, ms)});
  add_run(loaded, outcome(), {sample(0, 20 * ms, Fate::late), sample(1, ms)});
  const auto html = page();
  EXPECT_THAT(html, HasSubstr("0 to 50 % of the cycles had no answer within 10 ms; worst: Test1.B udp."));
  EXPECT_THAT(html, Not(HasSubstr("of 4 messages")));
  EXPECT_EQ(found_in(html, "<li class=\"(yes|no)\">").size(), 2u);
  EXPECT_THAT(html, HasSubstr("<b>Test1.B · System under load</b> 1 of 2 messages"));
}

TEST_F(Page, LongestWaitsSayWhereAWorstWaitIsLonger) {
  const auto is_told = [&] {
    return page().find("Wait: from when the message before was answered") != std::string::npos;
  };
  add_run(asked("a", "udp"), outcome(), {sample(0, 15 * ms, Fate::late), sample(1, ms)});
  EXPECT_FALSE(is_told());
  // Two cycles have no message while the first is under way, and are answered by the second.
  auto second = sample(3, 12 * ms, Fate::late);
  second.index = 1;
  second.intended_ns -= 20 * ms;
  second.skipped_cycles = 2;
  add_run(asked("b", "udp"), outcome(), {sample(0, 25 * ms, Fate::late), second});
  EXPECT_TRUE(is_told());
}

TEST_F(Page, LegendSpeaksOfTheColumnsThatThePageHas) {
  add_run(asked("a", "udp"), outcome(), {sample(0, ms)});
  const auto html = page();
  EXPECT_THAT(html, HasSubstr("Late: answered after the deadline of 10 ms."));
  EXPECT_THAT(html, Not(HasSubstr("Missed deadlines:")));
}

}  // namespace
}  // namespace ontime::report

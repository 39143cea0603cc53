// SPDX-License-Identifier: Apache-2.0
// Why messages were late or lost: on the page, and for Perfetto.
#include <algorithm>
#include <regex>
#include <set>

#include <fmt/format.h>

#include "json.hpp"
#include "page/page.hpp"
#include "page/parts.hpp"
#include "report/explained.hpp"
#include "report_fixture.hpp"
#include "table/table.hpp"

namespace ontime::report {
namespace {

using page::Why, page::why_of, page::most_of_a_drawing;
using roundtrip::Fate;
using roundtrip::Sample;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::SizeIs;
using trace::Kind;

std::size_t count_of(const std::string& what, const std::string& text) {
  std::size_t count = 0;
  for (auto at = text.find(what); at != std::string::npos; at = text.find(what, at + 1)) ++count;
  return count;
}

constexpr std::int32_t sends = 10, answers = 20, culprit = 99;

// Between two ends of one machine. Of messages 40, 41 … the component's thread waited 20 ms for CPU 1, which
// another had; what was seen around each overlaps with what was seen around the next.
class Traced : public ::testing::Test {
 protected:
  static std::int64_t due(std::uint64_t index) {
    return static_cast<std::int64_t>(index) * 10 * ms + 1'000 * ms;
  }
  static Sample answered(std::uint64_t index, std::int64_t held_ns) {
    return {.index = index,
            .intended_ns = due(index),
            .due_ns = due(index),
            .woke_ns = due(index) + 10 * us,
            .passed_wake_ns = 0,
            .sent_ns = due(index) + 12 * us,
            .received_ns = due(index) + 105 * us + held_ns,
            .server_received_ns = due(index) + 62 * us + held_ns,
            .server_sent_ns = due(index) + 65 * us + held_ns,
            .skipped_cycles = 0,
            .fate = held_ns > 0 ? Fate::late : Fate::on_time};
  }
  trace::Thread thread(std::int32_t id) const {
    if (id == 0) return {0, "swapper", 120};
    return {id, id == sends ? "ping-send" : id == answers ? "pong-receive" : name_, 120};
  }
  trace::Window around(std::uint64_t index) const {
    const auto at = due(index);
    trace::Window window{{index, at - ms, at + 40 * ms}, true, {}};
    const auto event = [&](std::int64_t after, int cpu, Kind kind, std::int32_t of, std::int32_t other,
                           const std::string& what, std::int32_t packet = 0) {
      window.events.push_back(
          {at + after, cpu, kind, thread(of), thread(other), what, packet, packet == 0 ? 0 : 550});
    };
    event(-ms / 2, 1, Kind::switched, 0, culprit, "R");
    event(5 * us, 0, Kind::waking, sends, 0, "0");
    event(8 * us, 0, Kind::switched, 0, sends, "R");
    event(17 * us, 0, Kind::queued, sends, 0, "veth", 1);
    event(18 * us, 0, Kind::sent, sends, 0, "veth", 1);
    event(20 * us, 0, Kind::soft_interrupt, sends, 0, "NET_RX");
    event(21 * us, 0, Kind::received, sends, 0, "veth", 1);
    event(22 * us, 0, Kind::waking, answers, sends, "1");
    event(23 * us, 0, Kind::soft_interrupt_end, sends, 0, "NET_RX");
    event(30 * us, 0, Kind::switched, sends, 0, "S");
    event(20 * ms, 1, Kind::switched, culprit, answers, "R");
    event(20 * ms + 70 * us, 1, Kind::switched, answers, culprit, "S");
    return window;
  }

  record::Reader recorded(std::size_t late) {
    auto request = asked("x", "udp");
    const auto run = writer_.begin_run(request);
    std::vector<Sample> samples;
    for (std::uint64_t i = 0; i < 100; ++i)
      samples.push_back(answered(i, i >= 40 && i < 40 + late ? 20 * ms : 0));
    writer_.append(run, samples);
    for (std::uint64_t i = 40; i < 40 + late; ++i) writer_.trace(run, {"controller", around(i)});
    auto came = outcome();
    came["trace"] = {{"controller", json::object()}};
    for (const auto* host : {"controller", "component"}) came["hosts"][host]["machine"]["boot_id"] = "b";
    came["hosts"]["controller"]["threads"] = {{{"tid", sends}, {"role", "send"}}};
    came["hosts"]["component"]["threads"] = {{{"tid", answers}, {"role", "receive"}}};
    writer_.end_run(run, came);
    return writer_.reader();
  }
  // Of one late message, around which this was seen as well.
  Why why_with(const std::vector<trace::Event>& more) {
    auto window = around(40);
    window.events.insert(window.events.end() - 2, more.begin(), more.end());
    std::stable_sort(window.events.begin(), window.events.end(),
                     [](const auto& one, const auto& other) { return one.at_ns < other.at_ns; });
    recorded(1);
    writer_.trace(1, {"controller", window});
    const auto reader = writer_.reader();
    return why_of(reader, reader.runs().at(0), "a.ontime", 0, 6);
  }
  std::string page(const record::Reader& reader) {
    return page::page_of(reader, statistics::summarise(reader), {.file = "r.ontime"});
  }

  record::Writer writer_{""};
  std::string name_ = "hog";
};

// The bars of all lanes that are of something, by the name on them.
std::vector<json> bars_of(const json& drawing, const std::string& of) {
  std::vector<json> bars;
  for (const auto& lane : drawing.at("lanes"))
    if (lane.at("of") == of)
      for (const auto& bar : lane.at("bars")) {
        bars.push_back(bar);
        bars.back()[3] = drawing.at("names").at(bar.at(3).get<std::size_t>());
      }
  return bars;
}

TEST_F(Traced, ACulpritStandsOutOfWhatIsDrawn) {
  const auto reader = recorded(1);
  const auto why = why_of(reader, reader.runs().at(0), "a.ontime", 0, 6);
  EXPECT_THAT(why.html, HasSubstr("1 late, 0 lost. "));
  EXPECT_THAT(why.html,
              HasSubstr("<b>1 of 1</b> pong&#39;s receive thread waited for a CPU while hog ran: 20.0 ms"));
  ASSERT_THAT(why.drawings, SizeIs(1));
  const auto& drawing = why.drawings[0];
  std::set<std::string> accused;
  std::int64_t held_ns = 0;
  for (const auto& bar : bars_of(drawing, "cpu")) {
    if (bar.at(4) != 1) continue;
    accused.insert(bar.at(3).get<std::string>());
    held_ns += bar.at(1).get<std::int64_t>() - bar.at(0).get<std::int64_t>();
  }
  EXPECT_EQ(accused, std::set<std::string>{"hog"});
  EXPECT_GE(held_ns, 19 * ms);
  EXPECT_THAT(
      bars_of(drawing, "thread"),
      Contains(testing::ResultOf(
          [](const json& bar) { return bar.at(3) == "ready, waits for a CPU" && bar.at(4) == 1; }, true)));
  EXPECT_THAT(drawing.at("stages"),
              Contains(testing::ResultOf(
                  [](const json& stage) { return stage.at(0) == "request leg" && stage.at(3) == 1; }, true)));
  for (const auto& mark : drawing.at("marks")) EXPECT_LE(mark.at(1), drawing.at("span_ns"));
}

TEST_F(Traced, ADrawingIsBoundedAndHasTheCulpritAllTheSame) {
  std::vector<trace::Event> more;
  for (std::int64_t i = 0; i < 4'900; ++i)
    for (const auto& [from, to] : {std::pair{0, 7}, std::pair{7, 0}})
      more.push_back({due(40) + 100 * us + i * 900 + (from == 0 ? 0 : 400),
                      0,
                      Kind::switched,
                      {from, from == 0 ? "swapper" : "busy", 120},
                      {to, to == 0 ? "swapper" : "busy", 120},
                      "S",
                      0,
                      0});
  const auto why = why_with(more);
  ASSERT_THAT(why.drawings, SizeIs(1));
  EXPECT_LE(why.drawings[0].dump().size(), most_of_a_drawing);
  EXPECT_THAT(bars_of(why.drawings[0], "cpu"),
              Contains(testing::ResultOf([](const json& bar) { return bar.at(3) == "hog" && bar.at(4) == 1; },
                                         true)));
}

// As a foreign file may have it: the culprit comes and goes, each time another thread between.
TEST_F(Traced, ADrawingIsBoundedHoweverManyEventsThereAre) {
  std::vector<trace::Event> more;
  const auto at = [&](std::int64_t step) { return due(40) + 100 * us + step; };
  for (std::int64_t i = 0; i < 6'000; ++i) {
    const bool comes = i % 2 == 0;
    const trace::Thread other{static_cast<std::int32_t>(1'000 + i / 2), fmt::format("other {}", i / 2), 120};
    for (const int cpu : {1, 2, 3, 4, 5})
      more.push_back({at(i * 3'200), cpu, Kind::switched, comes ? thread(culprit) : other,
                      comes ? other : thread(culprit), "R", 0, 0});
  }
  const auto why = why_with(more);
  ASSERT_THAT(why.drawings, SizeIs(1));
  EXPECT_LE(why.drawings[0].dump().size(), most_of_a_drawing);
  EXPECT_EQ(count_of("<tr>", why.html), 1u + 20);
  EXPECT_THAT(why.html, HasSubstr("more parts: see `ontime explain a.ontime --only 1 --message "));
}

// As a foreign file may have it, too: on each CPU one of a long name after another.
TEST_F(Traced, TooManyEventsAreListedInsteadOfDrawn) {
  std::string long_name;
  for (int i = 0; i < 55; ++i) long_name += "𝄞";
  std::vector<trace::Event> more;
  std::int32_t before = 0;
  for (std::int64_t i = 0; i < 8; ++i)
    for (const int cpu : {1, 2, 3, 4, 5, 6}) {
      const auto at = due(40) + 100 * us + i * 2'450 * us;
      const trace::Thread from{1'000 + before, fmt::format("{} {}", before, long_name), 120};
      ++before;
      const trace::Thread to{1'000 + before, fmt::format("{} {}", before, long_name), 120};
      more.push_back({at, cpu, Kind::switched, from, to, "R", 0, 0});
      const trace::Thread between{2'000 + before, fmt::format("{}b {}", before, long_name), 120};
      more.push_back({at + 2'444 * us, cpu, Kind::switched, to, between, "R", 0, 0});
      const auto interrupt = fmt::format("{}i {}", before, long_name);
      more.push_back({at + us, cpu, Kind::soft_interrupt, to, thread(0), interrupt, 0, 0});
      more.push_back({at + 2'440 * us, cpu, Kind::soft_interrupt_end, to, thread(0), interrupt, 0, 0});
    }
  const auto why = why_with(more);
  EXPECT_THAT(why.drawings, IsEmpty());
  EXPECT_THAT(why.html, Not(HasSubstr("class=\"way\"")));
  EXPECT_THAT(why.html, HasSubstr("Too many events to draw"));
  EXPECT_THAT(why.html, HasSubstr("Part by part"));
}

// Five million messages take 13 MB of the 15 that a page is to have at most.
TEST_F(Traced, PageHasAtMostSixtyDrawings) {
  for (int i = 0; i < 70; ++i) recorded(1);
  const auto html = page(writer_.reader());
  const auto figures = count_of("class=\"way\"", html);
  EXPECT_EQ(figures, 60u);
  EXPECT_LE(figures * most_of_a_drawing, 1'500'000u);
  EXPECT_EQ(count_of("Its messages are not drawn", html), 10u);
  EXPECT_THAT(html, HasSubstr("`ontime explain r.ontime --only 70`"));
}

TEST_F(Traced, NoNameIsMarkup) {
  name_ = "</script><b>";
  const auto html = page(recorded(1));
  EXPECT_THAT(html, HasSubstr("while &lt;/script&gt;&lt;b&gt; ran"));
  EXPECT_THAT(html, Not(HasSubstr("</script><b>")));
}

TEST_F(Traced, APageShowsTheWorstOfEachCulpritAndNoMore) {
  const auto html = page(recorded(20));
  const auto figures = count_of("class=\"way\"", html);
  EXPECT_EQ(figures, 2u) << "of one culprit";
  EXPECT_THAT(html, HasSubstr("<b>20 of 20</b>"));
}

TEST_F(Traced, UntracedRunHasNoWhySection) {
  const auto run = writer_.begin_run(asked("x", "udp"));
  writer_.append(run, std::vector{answered(0, 0)});
  writer_.end_run(run, outcome());
  const auto html = page(writer_.reader());
  EXPECT_THAT(html, Not(HasSubstr("class=\"why\"")));
}

class Perfetto : public Traced {
 protected:
  json written(std::size_t late) {
    const auto reader = recorded(late);
    const auto run = reader.runs().at(0);
    return parsed_json(perfetto_of(reader, run, explain::account_of(reader, run).messages));
  }
  static std::vector<json> named(const json& file, const std::string& name, const std::string& phase) {
    std::vector<json> found;
    for (const auto& event : file.at("traceEvents"))
      if (event.at("name") == name && event.at("ph") == phase) found.push_back(event);
    return found;
  }
  struct Slice {
    json begin;
    double us;
  };
  // In the order of their ends. One of a track ends before the next begins.
  static std::vector<Slice> slices(const json& file) {
    std::vector<Slice> all;
    std::map<json, json> open;  // by track
    for (const auto& event : file.at("traceEvents")) {
      const json track = {event.at("pid"), event.at("tid")};
      if (event.at("ph") == "B") {
        EXPECT_TRUE(open.emplace(track, event).second) << "within another: " << event;
      } else if (event.at("ph") == "E") {
        EXPECT_TRUE(open.contains(track)) << event;
        all.push_back({open[track], event.at("ts").get<double>() - open[track].at("ts").get<double>()});
        open.erase(track);
      }
    }
    EXPECT_THAT(open, IsEmpty());
    return all;
  }
  static std::vector<Slice> slices_named(const json& file, const std::string& name) {
    auto all = slices(file);
    std::erase_if(all, [&](const Slice& one) { return one.begin.at("name") != name; });
    return all;
  }
};

// From where a packet was queued to where it was received, and to the thread that it woke.
TEST_F(Perfetto, AnArrowFollowsAPacketToTheThreadThatItWoke) {
  const auto file = written(1);
  const auto from = named(file, "packet", "s"), over = named(file, "packet", "t"),
             to = named(file, "packet", "f");
  ASSERT_THAT(from, SizeIs(1));
  ASSERT_THAT(over, SizeIs(1));
  ASSERT_THAT(to, SizeIs(1));
  EXPECT_EQ(from[0].at("id"), to[0].at("id"));
  EXPECT_LT(from[0].at("ts"), over[0].at("ts"));
  EXPECT_LT(over[0].at("ts"), to[0].at("ts"));
  EXPECT_EQ(to[0].at("bp"), "e");
  const auto threads = slices_named(file, "ready, waits for a CPU");
  EXPECT_THAT(threads, Contains(testing::ResultOf(
                           [&](const Slice& slice) {
                             return slice.begin.at("ts") == to[0].at("ts") &&
                                    slice.begin.at("tid") == to[0].at("tid");
                           },
                           true)));
}

TEST_F(Perfetto, HasWhatIsInTheWindow) {
  const auto file = written(1);
  const auto hogs = slices_named(file, "hog");
  ASSERT_THAT(hogs, SizeIs(2));
  EXPECT_EQ(hogs[0].begin.at("tid"), 1);
  EXPECT_DOUBLE_EQ(hogs[0].us, 20'500);
  EXPECT_EQ(hogs[0].begin.at("args").at("thread"), culprit);
  ASSERT_THAT(slices_named(file, "NET_RX"), SizeIs(1));
  EXPECT_DOUBLE_EQ(slices_named(file, "NET_RX")[0].us, 3);
  for (const auto* packet : {"queued", "sent", "received"})
    EXPECT_THAT(named(file, std::string("packet of 550 bytes ") + packet + ": veth", "i"), SizeIs(1));
  ASSERT_THAT(named(file, "message 40", "b"), SizeIs(1));
  const auto due_us = named(file, "message 40 due", "i").at(0).at("ts").get<double>();
  EXPECT_DOUBLE_EQ(named(file, "message 40", "b")[0].at("ts"), due_us);
  EXPECT_DOUBLE_EQ(named(file, "message 40", "e")[0].at("ts").get<double>() - due_us, 20'105);
  EXPECT_DOUBLE_EQ(named(file, "message 40 late", "i").at(0).at("ts").get<double>() - due_us, 10'012);
  EXPECT_DOUBLE_EQ(named(file, "request leg", "b").at(0).at("ts").get<double>() - due_us, 12);
  EXPECT_DOUBLE_EQ(named(file, "request leg", "e").at(0).at("ts").get<double>() - due_us, 20'062);
  EXPECT_EQ(file.at("otherData").at("clock_uncertainty_ns"), 0);
  EXPECT_THAT(file.at("otherData").at("machines").get<std::string>(), HasSubstr("both ends are on one"));
}

TEST_F(Perfetto, IsInOrderAndNothingOverlapsOnATrack) {
  const auto file = written(5);
  double last = 0;
  for (const auto& event : file.at("traceEvents")) {
    if (event.at("ph") == "M") continue;
    ASSERT_GE(event.at("ts").get<double>(), last);
    last = event.at("ts");
  }
  EXPECT_THAT(slices(file), Not(IsEmpty()));
  EXPECT_THAT(named(file, "message 44", "b"), SizeIs(1));
}

// What Chromium's "Trace Event Format" asks of a file in the JSON Object Format, of the phases that are used.
TEST_F(Perfetto, IsInTheTraceEventFormat) {
  const auto file = written(5);
  EXPECT_THAT((std::vector<std::string>{"ms", "ns"}), Contains(file.at("displayTimeUnit")));
  EXPECT_TRUE(file.at("otherData").is_object());
  std::set<std::string> phases;
  std::set<json> named_tracks, tracks;
  std::map<std::pair<json, json>, std::vector<std::string>> open;  // by category and id
  for (const auto& event : file.at("traceEvents")) {
    SCOPED_TRACE(event.dump());
    const std::string phase = event.at("ph");
    phases.insert(phase);
    ASSERT_TRUE(event.at("name").is_string() && event.at("pid").is_number_integer() &&
                event.at("tid").is_number_integer());
    if (event.contains("args")) {
      ASSERT_TRUE(event.at("args").is_object());
    }
    const json process = {event.at("pid"), nullptr}, track = {event.at("pid"), event.at("tid")};
    if (phase == "M") {
      ASSERT_TRUE(event.at("args").at("name").is_string());
      ASSERT_TRUE(event.at("name") == "process_name" || event.at("name") == "thread_name");
      ASSERT_TRUE(named_tracks.insert(event.at("name") == "process_name" ? process : track).second) << "once";
      continue;
    }
    ASSERT_TRUE(event.at("ts").is_number());  // in µs
    ASSERT_GE(event.at("ts").get<double>(), 0);
    tracks.insert(process);
    if (phase == "B" || phase == "E") {
      tracks.insert(track);
    } else if (phase == "s" || phase == "t" || phase == "f") {
      ASSERT_TRUE(event.contains("id") && event.contains("cat"));
      tracks.insert(track);
    } else if (phase == "i") {
      ASSERT_THAT((std::vector<std::string>{"g", "p", "t"}), Contains(event.at("s")));
    } else {
      // Those of a category and an id are nested within one another.
      auto& names = open[{event.at("cat"), event.at("id")}];
      if (phase == "b") {
        names.push_back(event.at("name"));
      } else {
        ASSERT_EQ(phase, "e");
        ASSERT_FALSE(names.empty());
        ASSERT_EQ(event.at("name"), names.back());
        names.pop_back();
      }
    }
  }
  for (const auto& [id, names] : open) EXPECT_THAT(names, IsEmpty()) << id.second;
  EXPECT_EQ(phases, (std::set<std::string>{"M", "B", "E", "b", "e", "i", "s", "t", "f"}));
  for (const auto& track : tracks) EXPECT_TRUE(named_tracks.contains(track)) << track;
}

TEST_F(Perfetto, NamesAreText) {
  name_ = "\"},{\x1b[2J";
  EXPECT_THAT(slices_named(written(1), "\"},{?[2J"), Not(IsEmpty()));
}

}  // namespace
}  // namespace ontime::report

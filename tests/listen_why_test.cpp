// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "json.hpp"
#include "listen/why.hpp"
#include "listen_times.hpp"

namespace ontime::listen {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;
using trace::Kind;

constexpr std::int32_t publishes = 11, takes = 21, receives = 22, hog = 30, worker = 33, liar = 34;
constexpr std::int64_t published = 100 * ms;

Party owner_of(std::int32_t thread) {
  if (thread == publishes) return {1, "controller"};
  if (thread == takes || thread == receives) return {2, "base"};
  if (thread == hog) return {30, "recorder"};
  if (thread == worker) return {33, "kworker/1:2-events"};
  if (thread == liar) return {34, "x; fix: y"};
  return {};
}

// The publisher runs on CPU 0, the reader on CPU 1, and the hog has a real-time priority.
class LateMessage : public testing::Test {
 protected:
  static trace::Thread named(std::int32_t thread) {
    if (thread == hog) return {hog, "recorder", 49};
    const auto* const name = thread == publishes  ? "controller"
                             : thread == takes    ? "base"
                             : thread == receives ? "recv"
                             : thread == 31       ? "one"
                             : thread == 32       ? "two"
                             : thread == worker   ? "kworker/1:2-events"
                             : thread == liar     ? "x; fix: y"
                                                  : "";
    return {thread, name, 120};
  }
  void event(std::int64_t at, int cpu, Kind kind, std::int32_t thread, std::int32_t other = 0,
             const std::string& what = "") {
    window.events.push_back({.at_ns = at,
                             .cpu = cpu,
                             .kind = kind,
                             .thread = named(thread),
                             .other = named(other),
                             .what = what});
  }
  void switched(std::int64_t at, int cpu, std::int32_t from, const char* state, std::int32_t to) {
    event(at, cpu, Kind::switched, from, to, state);
  }
  // Usually 100 µs old.
  static Miss old(std::int64_t taken_ns) {
    Miss miss{.kind = Miss::Kind::age,
              .at_ns = taken_ns,
              .value_ns = taken_ns - published,
              .topic = "/cmd_vel",
              .writer = {1, "controller"},
              .reader = {2, "base"}};
    miss.course = {.since_ns = published,
                   .published_ns = published,
                   .taken_before_ns = published - 10 * ms,
                   .taken_ns = taken_ns,
                   .publisher = publishes,
                   .taker = takes,
                   .usual_ns = 100 * us};
    return miss;
  }
  // Usually every 10 ms.
  static Miss after_gap(std::int64_t published_ns, std::int64_t taken_ns) {
    auto miss = old(taken_ns);
    miss.kind = Miss::Kind::gap;
    miss.value_ns = taken_ns - published;
    miss.course.before_ns = published;
    miss.course.since_ns = miss.course.published_ns = published_ns;
    miss.course.taken_before_ns = published + 100 * us;
    miss.course.usual_ns = 10 * ms;
    return miss;
  }
  Why why(const Miss& miss) {
    window.span = span_of(miss);
    return listen::why(miss, window, owner_of);
  }
  // The reader is ready 20 µs after the publish, and waits 21 ms for the CPU that another thread has.
  Why behind(std::int32_t other) {
    switched(90 * ms, 0, 0, "R", publishes);
    switched(91 * ms, 1, 0, "R", other);
    event(published + 20 * us, 0, Kind::waking, takes, publishes, "1");
    switched(published + 21 * ms, 1, other, "S", takes);
    return why(old(published + 21 * ms + 50 * us));
  }

  trace::Window window;
};

TEST_F(LateMessage, ReaderBehindAnotherThreadNamesIt) {
  const auto found = behind(hog);
  ASSERT_TRUE(found.is_seen) << found.sentence;
  EXPECT_EQ(found.cause, "cpu");
  EXPECT_EQ(found.victim, (Party{2, "base"}));
  EXPECT_EQ(found.culprit, (Party{30, "recorder"}));
  EXPECT_EQ(found.thread, takes);
  EXPECT_EQ(found.ns, 21 * ms - 20 * us);
  EXPECT_EQ(found.cpu, 1);
  EXPECT_THAT(found.fix, HasSubstr("chrt -a -f -p 51 2)")) << "above the real-time priority of the other";
  EXPECT_THAT(found.fix, HasSubstr("other CPUs for recorder [30] (taskset)"));
  EXPECT_THAT(found.sentence, testing::EndsWith("while recorder [30] ran"));
  EXPECT_EQ(found.alike, "base [2], SCHED_OTHER, waited for a CPU while recorder ran")
      << "of each recorder that starts";
  EXPECT_THAT(found.alike_fix, HasSubstr("other CPUs for recorder (taskset)"));
}

TEST_F(LateMessage, TopicThatIsSlowerThanItsLimitAccusesNothing) {
  switched(published + 40 * ms - 100 * us, 0, 0, "R", publishes);
  event(published + 40 * ms + 100 * us, 0, Kind::waking, takes, publishes, "1");
  auto miss = after_gap(published + 40 * ms + 50 * us, published + 40 * ms + 150 * us);
  miss.course.usual_ns = 40 * ms;
  const auto found = why(miss);
  EXPECT_FALSE(found.is_seen);
  EXPECT_THAT(found.sentence, HasSubstr("40.0 ms"));
  EXPECT_EQ(found.fix, "");
}

TEST_F(LateMessage, ThreadOfTheKernelIsNotToBeMoved) {
  const auto found = behind(worker);
  EXPECT_EQ(found.culprit, (Party{33, "kworker/1:2-events"}));
  EXPECT_THAT(found.fix, HasSubstr("SCHED_FIFO for base"));
  EXPECT_THAT(found.fix, testing::Not(HasSubstr("taskset"))) << "the kernel refuses";
}

TEST_F(LateMessage, NameOfAProcessIsNoAdvice) {
  const auto found = behind(liar);
  EXPECT_EQ(found.culprit.process, 34U);
  for (const auto& text : {found.sentence, found.alike, found.fix, found.alike_fix})
    EXPECT_THAT(text, testing::Not(HasSubstr(";"))) << text;
}

TEST_F(LateMessage, ReceivingThreadBehindAnotherNamesIt) {
  switched(90 * ms, 0, 0, "R", publishes);
  switched(91 * ms, 1, 0, "R", hog);
  event(published + 20 * us, 0, Kind::waking, receives, publishes, "1");
  switched(published + 21 * ms, 1, hog, "S", receives);
  event(published + 21 * ms + 30 * us, 1, Kind::waking, takes, receives, "1");
  switched(published + 21 * ms + 40 * us, 1, receives, "S", takes);
  const auto found = why(old(published + 21 * ms + 80 * us));
  ASSERT_TRUE(found.is_seen) << found.sentence;
  EXPECT_EQ(found.thread, receives);
  EXPECT_EQ(found.culprit, (Party{30, "recorder"}));
}

TEST_F(LateMessage, ReaderThatItsTimerWakesIsLateByItsReceivingThread) {
  switched(90 * ms, 0, 0, "R", publishes);
  switched(91 * ms, 1, takes, "S", hog);
  event(published + 20 * us, 0, Kind::waking, receives, publishes, "1");
  event(published + 70 * ms, 1, Kind::timer, hog);
  event(published + 70 * ms + 2 * us, 1, Kind::waking, takes, hog, "1");
  event(published + 70 * ms + 4 * us, 1, Kind::timer_end, hog);
  switched(published + 100 * ms, 1, hog, "S", receives);
  switched(published + 100 * ms + 40 * us, 1, receives, "S", takes);
  const auto found = why(old(published + 100 * ms + 80 * us));
  ASSERT_TRUE(found.is_seen) << found.sentence;
  EXPECT_GT(found.ns, 99 * ms) << "of both threads";
  EXPECT_EQ(found.culprit, (Party{30, "recorder"}));
}

TEST_F(LateMessage, PublisherPreemptedWhileItPublishesNamesTheThreadThatRan) {
  switched(90 * ms, 0, 0, "R", publishes);
  switched(published + 10 * us, 0, publishes, "R", hog);
  switched(published + 15 * ms, 0, hog, "S", publishes);
  event(published + 15 * ms + 10 * us, 0, Kind::waking, takes, publishes, "1");
  switched(published + 15 * ms + 20 * us, 1, 0, "R", takes);
  const auto found = why(old(published + 15 * ms + 60 * us));
  ASSERT_TRUE(found.is_seen) << found.sentence;
  EXPECT_EQ(found.victim, (Party{1, "controller"}));
  EXPECT_EQ(found.culprit, (Party{30, "recorder"}));
}

TEST_F(LateMessage, PublisherThatIsWokenInTimeAndWaitsNamesTheThreadThatRan) {
  switched(published + 50 * us, 0, publishes, "S", hog);
  event(published + 10 * ms, 0, Kind::waking, publishes, hog, "0");
  switched(published + 40 * ms, 0, hog, "S", publishes);
  event(published + 40 * ms + 100 * us, 0, Kind::waking, takes, publishes, "1");
  const auto found = why(after_gap(published + 40 * ms + 50 * us, published + 40 * ms + 150 * us));
  ASSERT_TRUE(found.is_seen) << found.sentence;
  EXPECT_EQ(found.victim, (Party{1, "controller"}));
  EXPECT_EQ(found.culprit, (Party{30, "recorder"}));
  EXPECT_EQ(found.ns, 30 * ms);
}

TEST_F(LateMessage, PublisherThatSleepsAccusesNothing) {
  switched(published + 50 * us, 0, publishes, "S", hog);
  event(published + 40 * ms, 0, Kind::waking, publishes, hog, "0");  // its timer, while another runs
  switched(published + 40 * ms + 20 * us, 0, hog, "R", publishes);
  const auto found = why(after_gap(published + 40 * ms + 50 * us, published + 40 * ms + 150 * us));
  EXPECT_FALSE(found.is_seen);
  EXPECT_EQ(found.culprit, Party{});
  EXPECT_EQ(found.cause, "unknown");
}

TEST_F(LateMessage, ReaderThatPollsAccusesNothing) {
  switched(90 * ms, 1, takes, "S", hog);
  event(published + 20 * ms, 1, Kind::timer, hog);
  event(published + 20 * ms + 2 * us, 1, Kind::waking, takes, hog, "1");
  event(published + 20 * ms + 4 * us, 1, Kind::timer_end, hog);
  switched(published + 20 * ms + 9 * us, 1, hog, "R", takes);
  EXPECT_FALSE(why(old(published + 20 * ms + 50 * us)).is_seen);
}

TEST_F(LateMessage, ThreadThatHadTheCpuForLessThanHalfIsNotAccused) {
  switched(90 * ms, 1, 0, "R", hog);
  event(published + 12 * ms, 0, Kind::waking, takes, 0, "1");
  switched(published + 21 * ms, 1, hog, "S", takes);
  EXPECT_FALSE(why(old(published + 21 * ms + 50 * us)).is_seen);
}

TEST_F(LateMessage, SeveralThreadsThatHadTheCpuTogetherNameNoCulprit) {
  constexpr std::int32_t other = 31, third = 32;
  switched(90 * ms, 1, 0, "R", other);
  event(published + 4 * ms, 0, Kind::waking, takes, 0, "1");
  switched(published + 8 * ms, 1, other, "R", third);
  switched(published + 12 * ms, 1, third, "R", takes);
  auto miss = old(published + 14 * ms);
  const auto found = why(miss);
  ASSERT_TRUE(found.is_seen) << found.sentence;
  EXPECT_EQ(found.cause, "cpu");
  EXPECT_EQ(found.culprit, Party{});
  EXPECT_EQ(found.ns, 8 * ms);
  // Another number of them is no other cause.
  EXPECT_THAT(found.sentence, HasSubstr("2 others (longest: "));
  EXPECT_THAT(found.alike, AllOf(HasSubstr("others (longest: "), Not(HasSubstr("2 others"))));
}

TEST_F(LateMessage, ReaderThatWorksIsItsOwnCause) {
  switched(90 * ms, 1, 0, "R", takes);
  event(published + 10 * ms, 1, Kind::timer, takes);
  event(published + 10 * ms + 2 * us, 1, Kind::timer_end, takes);
  const auto found = why(old(published + 30 * ms));
  ASSERT_TRUE(found.is_seen);
  EXPECT_EQ(found.cause, "busy");
  EXPECT_EQ(found.victim, (Party{2, "base"}));
  EXPECT_EQ(found.culprit, Party{});
}

TEST_F(LateMessage, InterruptsOfTheReadersCpuAreNamed) {
  switched(90 * ms, 1, 0, "R", takes);
  event(published + ms, 1, Kind::soft_interrupt, takes, 0, "NET_RX");
  event(published + 28 * ms, 1, Kind::soft_interrupt_end, takes, 0, "NET_RX");
  const auto found = why(old(published + 30 * ms));
  ASSERT_TRUE(found.is_seen);
  EXPECT_EQ(found.cause, "interrupts");
  EXPECT_EQ(found.sentence, "NET_RX took the CPU of base [2], SCHED_OTHER");
  EXPECT_EQ(found.alike, found.sentence);
}

TEST_F(LateMessage, MessagesThatWereNotTakenAreCounted) {
  auto miss = after_gap(published + 30 * ms, published + 30 * ms + 100 * us);
  miss.course.since_ns = published + 10 * ms;
  miss.course.missing = 2;
  switched(published + 200 * us, 1, takes, "S", 0);
  const auto found = why(miss);
  EXPECT_FALSE(found.is_seen);
  EXPECT_THAT(found.sentence, HasSubstr("2 messages"));
}

TEST_F(LateMessage, WriterMayBeLocalAndNotRecognizedYet) {
  auto miss = after_gap(0, published + 30 * ms);
  miss.writer = {};
  miss.course.before_ns = miss.course.since_ns = miss.course.published_ns = 0;
  const auto found = why(miss);
  EXPECT_FALSE(found.is_seen);
  for (const auto& text : {found.sentence, found.alike})
    EXPECT_THAT(text, HasSubstr("not recognized yet or runs on another machine"));
}

TEST_F(LateMessage, EventsThatWereLostExplainNothing) {
  switched(90 * ms, 1, 0, "R", takes);
  window.whole = false;
  EXPECT_FALSE(why(old(published + 30 * ms)).is_seen);
}

TEST_F(LateMessage, MissIsExplainedAgainFromItsFileAndAWiderWindow) {
  switched(10 * ms, 0, 0, "R", publishes);
  switched(11 * ms, 1, 0, "R", hog);
  event(published + 20 * us, 0, Kind::waking, takes, publishes, "1");
  switched(published + 21 * ms, 1, hog, "S", takes);
  switched(published + 22 * ms, 1, takes, "S", hog);
  auto miss = old(published + 21 * ms + 50 * us);
  const auto at_once = why(miss);
  window.span = {7, published - 100 * ms, published + 121 * ms};
  auto around = std::make_shared<Surroundings>();
  for (const auto thread : {publishes, takes, hog}) around->owners[thread] = owner_of(thread);
  miss.surroundings = around;
  miss.at_ns = 1'795'000'000'000 * ms;
  const auto text = way_of(miss).dump();
  const auto again = explained_again(parsed_json(text), trace::window_of(to_json(window)));
  ASSERT_TRUE(again && again->why);
  EXPECT_EQ(again->why->sentence, at_once.sentence);
  EXPECT_EQ(again->why->culprit, (Party{30, "recorder"}));
  EXPECT_EQ(again->at_ns, miss.at_ns);

  window.whole = false;
  EXPECT_FALSE(explained_again(parsed_json(text), window)) << "what was said at once stands";
  window.whole = true;
  for (const auto* name : {"taken_ns", "publisher", "limit", "reader", "threads"})
    for (const nlohmann::json& value : {nlohmann::json(), nlohmann::json(-1), nlohmann::json("x"),
                                        nlohmann::json(INT64_MAX), nlohmann::json::array({1})}) {
      auto foreign = parsed_json(text);
      foreign[name] = value;
      EXPECT_FALSE(explained_again(foreign, window)) << name << " " << value;
    }
  EXPECT_FALSE(explained_again(nullptr, window));
}

TEST_F(LateMessage, LongSilenceIsLookedAtInItsLastSecond) {
  const auto span = span_of(old(published + 3600'000 * ms));
  EXPECT_EQ(span.to_ns - span.from_ns, 1000 * ms);
}

}  // namespace
}  // namespace ontime::listen

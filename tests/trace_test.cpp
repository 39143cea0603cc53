// SPDX-License-Identifier: Apache-2.0
#include "trace/trace.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <csignal>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spawn.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "json.hpp"
#include "trace/ring.hpp"
#include "trace/tracefs.hpp"

namespace ontime::trace {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;
using testing::HasSubstr;
using testing::IsEmpty;

std::int64_t now_ns() { return std::chrono::steady_clock::now().time_since_epoch().count(); }

// --- in words ---

Window some_window() {
  return {{7, 1'000, 2'000},
          false,
          {{.at_ns = 900,
            .cpu = 1,
            .kind = Kind::switched,
            .thread = {12, "ping", 19},
            .other = {0, "swapper/1", 120},
            .what = "S"},
           {.at_ns = 1'500,
            .cpu = 0,
            .kind = Kind::received,
            .thread = {3},
            .what = "eth0",
            .packet = 2,
            .bytes = 542}}};
}

TEST(Words, WindowIsReadBack) {
  const auto window = some_window();
  const auto again = window_of(parsed_json(to_json(window).dump()));
  EXPECT_EQ(again.span.message, 7u);
  EXPECT_EQ(again.span.from_ns, 1'000);
  EXPECT_EQ(again.span.to_ns, 2'000);
  EXPECT_FALSE(again.whole);
  EXPECT_EQ(again.events, window.events);
  EXPECT_EQ(to_json(window).at("events").at(0).at("at"), -100);
}

TEST(Words, EachKindIsReadBack) {
  for (int i = 0; i <= static_cast<int>(Kind::no_neighbour); ++i) {
    const auto kind = static_cast<Kind>(i);
    EXPECT_EQ(kind_of(word_of(kind)), kind);
  }
  EXPECT_FALSE(kind_of("nothing"));
}

TEST(Words, ImpossibleValuesAreRefused) {
  const auto refused = [](const char* where, const json& value) {
    auto window = to_json(some_window());
    window[json::json_pointer(where)] = value;
    try {
      window_of(window);
    } catch (const Error&) {
      return true;
    } catch (const json::exception&) {
      return true;
    }
    return false;
  };
  EXPECT_TRUE(refused("/events/0/at", 1e300));
  EXPECT_TRUE(refused("/events/0/at", std::uint64_t{1} << 63));
  EXPECT_TRUE(refused("/events/0/at", 5'000)) << "it is after the next";
  EXPECT_TRUE(refused("/events/0/kind", "none"));
  EXPECT_TRUE(refused("/events/0/cpu", std::int64_t{1} << 40));
  EXPECT_TRUE(refused("/events/0/cpu", -1));
  EXPECT_TRUE(refused("/events/0/cpu", 8192));
  EXPECT_FALSE(refused("/events/0/cpu", 8191));
  EXPECT_TRUE(refused("/events/0/thread", "x"));
  EXPECT_TRUE(refused("/events/0", json::array()));
  EXPECT_TRUE(refused("/events", 7));
  EXPECT_TRUE(refused("/message", -1));
  EXPECT_TRUE(refused("/to_ns", INT64_MAX));
  EXPECT_FALSE(refused("/whole", true));
  const json any{{"at", 0}, {"cpu", 0}, {"kind", "timer"}};
  EXPECT_FALSE(refused("/events", json(50'000, any)));
  EXPECT_TRUE(refused("/events", json(50'001, any)));
}

// --- of this machine ---

class Traced : public testing::Test {
 protected:
  void SetUp() override {
    if (geteuid() != 0) GTEST_SKIP() << "tracing needs root";
    try {
      tracefs_.emplace();
    } catch (const Error& error) {
      GTEST_SKIP() << error.what();
    }
  }
  bool is_there() const { return tracefs_->has("instances/ontime-trace"); }
  static Window cut(Recorder& recorder, std::int64_t from_ns, std::int64_t to_ns) {
    auto windows = recorder.cut({{1, from_ns, to_ns}});
    EXPECT_EQ(windows.size(), 1u);
    return windows.at(0);
  }
  std::optional<Tracefs> tracefs_;
};

TEST_F(Traced, AnInstanceOfOurOwnIsMadeAndRemoved) {
  journal::Journal journal(kinds());
  {
    const Recorder recorder(journal);
    EXPECT_TRUE(is_there());
    EXPECT_NE(tracefs_->read("instances/ontime-trace/trace_clock").find("[mono]"), std::string::npos);
    EXPECT_EQ(tracefs_->read("events/sched/sched_switch/enable"), "0\n") << "no other tracing is touched";
  }
  EXPECT_FALSE(is_there());
}

TEST_F(Traced, ASecondOneIsRefused) {
  journal::Journal journal(kinds());
  const Recorder recorder(journal);
  try {
    const Recorder second(journal);
    FAIL() << "there are two";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("another ontime"));
  }
  EXPECT_TRUE(is_there());
}

TEST_F(Traced, AnInstanceThatNobodyReadsAndNoJournalKnowsIsReplaced) {
  tracefs_->make("instances/ontime-trace");
  journal::Journal journal(kinds());
  {
    const Recorder recorder(journal);
    EXPECT_NE(tracefs_->read("instances/ontime-trace/trace_clock").find("[mono]"), std::string::npos);
  }
  EXPECT_FALSE(is_there());
}

TEST_F(Traced, IsGivenBackAfterAKill) {
  const pid_t child = fork();
  if (child == 0) {
    journal::Journal journal(kinds());
    const Recorder recorder(journal);
    kill(getpid(), SIGKILL);
  }
  int status = 0;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  ASSERT_TRUE(WIFSIGNALED(status));
  EXPECT_TRUE(is_there());
  EXPECT_THAT(journal::revert_abandoned(kinds()), testing::Not(IsEmpty()));
  EXPECT_FALSE(is_there());
}

TEST_F(Traced, SaysWhenAThreadSleptAndWasWoken) {
  journal::Journal journal(kinds());
  Recorder recorder(journal, {.events = 10'000'000});  // the whole machine's
  const auto from_ns = now_ns();
  std::this_thread::sleep_for(20ms);
  std::this_thread::sleep_for(1ms);  // by which it is seen to have run
  const auto window = cut(recorder, from_ns, now_ns());
  EXPECT_TRUE(window.whole);
  // One after the other: before it sleeps it may have been pre-empted.
  auto event = window.events.begin();
  const auto next = [&](auto is_it) {
    return event = std::find_if(event, window.events.end(),
                                [&](const Event& one) { return one.at_ns >= from_ns && is_it(one); });
  };
  const auto left = next([](const Event& one) {
    return one.kind == Kind::switched && one.thread.id == gettid() && one.what == "S";
  });
  const auto woken =
      next([](const Event& one) { return one.kind == Kind::waking && one.thread.id == gettid(); });
  // Not every kernel says how a CPU leaves its idle thread: then the first thing that it does shows it.
  const auto ran = next([](const Event& one) {
    return running_at(one) == gettid() || (one.kind == Kind::switched && one.other.id == gettid());
  });
  ASSERT_NE(ran, window.events.end());
  EXPECT_EQ(left->thread.name, "trace_test");
  EXPECT_GE(woken->at_ns - left->at_ns, 19'000'000);
}

TEST_F(Traced, SaysThatAThreadWasStoppedBeforeTheWindow) {
  const pid_t child = fork();
  if (child == 0) {
    prctl(PR_SET_PDEATHSIG, SIGKILL);  // also where this test ends sooner
    while (true) pause();
  }
  journal::Journal journal(kinds());
  Recorder recorder(journal);
  kill(child, SIGSTOP);
  int status = 0;
  ASSERT_EQ(waitpid(child, &status, WUNTRACED), child);
  std::this_thread::sleep_for(5ms);
  const auto from_ns = now_ns();
  std::this_thread::sleep_for(5ms);
  const auto window = cut(recorder, from_ns, now_ns());
  const auto stopped = std::find_if(window.events.begin(), window.events.end(), [&](const Event& event) {
    return event.kind == Kind::switched && event.thread.id == child;
  });
  ASSERT_NE(stopped, window.events.end());
  EXPECT_LT(stopped->at_ns, from_ns);
  EXPECT_EQ(stopped->what, "T");
  kill(child, SIGKILL);
  waitpid(child, &status, 0);
}

TEST_F(Traced, SaysInWhichFunctionsOfTheKernelAThreadWaits) {
  if (tracefs_->read("events/sched/sched_switch/trigger").find("stacktrace") == std::string::npos)
    GTEST_SKIP() << "this kernel cannot";
  journal::Journal journal(kinds());
  Recorder recorder(journal);
  const auto from_ns = now_ns();
  pid_t child = 0;  // until its program has begun this thread waits in the kernel
  std::array<char, 10> program{"/bin/true"};
  const std::array<char*, 2> arguments{program.data(), nullptr};
  ASSERT_EQ(posix_spawn(&child, program.data(), nullptr, nullptr, arguments.data(), nullptr), 0);
  waitpid(child, nullptr, 0);
  std::this_thread::sleep_for(1ms);
  const auto window = cut(recorder, from_ns, now_ns());
  const auto waits = std::find_if(window.events.begin(), window.events.end(), [&](const Event& event) {
    return event.kind == Kind::waits && event.thread.id == gettid() && event.at_ns >= from_ns;
  });
  ASSERT_NE(waits, window.events.end());
  EXPECT_THAT(waits->what, HasSubstr("wait_for_completion"));
  EXPECT_THAT(waits->what, testing::Not(HasSubstr("__schedule")));
}

TEST_F(Traced, WindowBeforeTheStartIsIncomplete) {
  const auto from_ns = now_ns() - 1'000'000'000;
  journal::Journal journal(kinds());
  Recorder recorder(journal);
  EXPECT_FALSE(cut(recorder, from_ns, from_ns + 1'000'000).whole);
}

// As the kernel gives them: when, how much and whether some before were lost, and one event.
std::vector<std::byte> page_of_one(std::uint64_t at_ns, bool lost_before) {
  const std::uint64_t size = 8 | (lost_before ? std::uint64_t{1} << 31 : 0);
  const std::array<std::uint32_t, 2> event{1, 0};
  std::vector<std::byte> page(24);
  std::memcpy(page.data(), &at_ns, sizeof at_ns);
  std::memcpy(page.data() + 8, &size, sizeof size);
  std::memcpy(page.data() + 16, event.data(), sizeof event);
  return page;
}

TEST(Ring, ReportsTheTimeOfLostEvents) {
  Ring ring(1, Room{}.bytes);
  ring.add(0, page_of_one(1000, false));
  ring.add(0, page_of_one(5000, true));
  EXPECT_THAT(ring.between(0, INT64_MAX), testing::SizeIs(2));
  EXPECT_TRUE(ring.has_all(500, 900));
  EXPECT_FALSE(ring.has_all(2000, 3000));
  EXPECT_FALSE(ring.has_all(500, 6000));
  EXPECT_TRUE(ring.has_all(5001, 6000));
}

TEST(Ring, TakesNoPageThatIsNone) {
  Ring ring(1, Room{}.bytes);
  std::vector<std::byte> page(24);
  ring.add(0, page);
  EXPECT_THAT(ring.between(0, INT64_MAX), IsEmpty());
}

}  // namespace
}  // namespace ontime::trace

// SPDX-License-Identifier: Apache-2.0
#include "orders/orders.hpp"

#include <csignal>
#include <cstdio>
#include <filesystem>
#include <string_view>
#include <thread>

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "orders/frames.hpp"
#include "orders/process.hpp"

namespace ontime::orders {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;

// ── Frames ──

class FramesTest : public testing::Test {
 protected:
  FramesTest() { EXPECT_EQ(socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends_), 0); }
  ~FramesTest() override {
    close(ends_[0]);
    if (ends_[1] >= 0) close(ends_[1]);
  }
  int ends_[2] = {-1, -1};
};

TEST_F(FramesTest, SentFramesAreReceived) {
  Frames here(ends_[0], ends_[0]), there(ends_[1], ends_[1]);
  const std::vector<std::uint8_t> bytes{1, 2, 3};
  here.send({{"a", 1}});
  here.send({{"b", "text"}}, bytes);
  here.send(json::object());
  EXPECT_TRUE(there.fill());
  EXPECT_EQ(there.take()->message, json({{"a", 1}}));
  const auto second = there.take();
  EXPECT_EQ(second->message, json({{"b", "text"}}));
  EXPECT_EQ(second->bytes, bytes);
  EXPECT_EQ(there.take()->message, json::object());
  EXPECT_FALSE(there.take());
  EXPECT_FALSE(there.fill());
}

TEST_F(FramesTest, ClosedPipeThrowsBroken) {
  Frames here(ends_[0], ends_[0]);
  close(std::exchange(ends_[1], -1));
  EXPECT_THROW(here.fill(), Broken);
}

std::vector<std::uint8_t> frame_of(std::vector<std::uint8_t> cbor, std::size_t stated) {
  std::vector<std::uint8_t> bytes;
  for (const std::size_t length : {stated, std::size_t{0}})
    for (int shift = 0; shift < 32; shift += 8) bytes.push_back(static_cast<std::uint8_t>(length >> shift));
  bytes.insert(bytes.end(), cbor.begin(), cbor.end());
  return bytes;
}

TEST(Decoder, TakesFramesHoweverTheyAreCut) {
  const auto cbor = json::to_cbor({{"order", "beat"}});
  const auto bytes = frame_of(cbor, cbor.size());
  Decoder decoder;
  int frames = 0;
  for (int round = 0; round < 3; ++round)
    for (const auto byte : bytes) {
      decoder.add({&byte, 1});
      if (decoder.take()) ++frames;
    }
  EXPECT_EQ(frames, 3);
}

TEST(Decoder, InvalidFramesAreRefused) {
  const std::string noise = "bash: ontime: command not found\n";
  const auto refuses = [](const std::vector<std::uint8_t>& bytes) {
    Decoder decoder;
    decoder.add(bytes);
    EXPECT_THROW(decoder.take(), Broken);
  };
  refuses({noise.begin(), noise.end()});
  refuses(frame_of({0xff}, 1));
  refuses(frame_of(json::to_cbor(7), json::to_cbor(7).size()));  // no object
  refuses(frame_of({}, 0));                                      // nothing at all
  refuses(
      frame_of(std::vector<std::uint8_t>(1'000'000, 0x81), 1'000'000));  // a million arrays in one another
}

TEST(Decoder, TextInPlaceOfAFrameIsReturned) {
  const auto text_of = [](const std::vector<std::uint8_t>& bytes) {
    Decoder decoder;
    decoder.add(bytes);
    return decoder.text();
  };
  const auto frame = frame_of(json::to_cbor({{"event", "hello"}}), 14);
  std::string welcome = "Grüezi!\n\tTwo lines\n";
  std::vector<std::uint8_t> bytes(welcome.begin(), welcome.end());
  EXPECT_EQ(text_of(bytes), "Gr??ezi!\n\tTwo lines");
  bytes.insert(bytes.end(), frame.begin(), frame.end());
  EXPECT_THAT(text_of(bytes), testing::StartsWith("Gr??ezi!\n\tTwo lines"));
  EXPECT_EQ(text_of(frame), "");
  EXPECT_EQ(text_of({frame.begin(), frame.begin() + 3}), "");
  EXPECT_EQ(text_of({}), "");
}

// ── A coordinator and its workers ──

constexpr int chatter = 2'000;
const std::vector<std::uint8_t> much(60'000);

std::vector<std::string> worker(const std::string& kind) { return {this_program(), kind}; }

std::string failure(const std::function<void()>& doing) {
  try {
    doing();
  } catch (const Error& error) {
    return std::to_string(error.exit) + " " + error.what();
  } catch (const Interrupted&) {
    return "interrupted";
  }
  return "none";
}

class CoordinatorTest : public testing::Test {
 protected:
  pid_t pid_of(Coordinator::Hand& hand) {
    hand.order("answer");
    return coordinator_.await(hand, "answered", 60s).at("pid");
  }

  Interrupts interrupts_{0};
  Coordinator coordinator_{interrupts_};
};

TEST_F(CoordinatorTest, AwaitsOneAndHandlesTheOthers) {
  Coordinator::Hand first(coordinator_, "the first", worker("obedient"), "s"),
      second(coordinator_, "the second", worker("obedient"), "s");
  std::vector<std::string> said;
  for (auto* hand : {&first, &second})
    hand->on("said", [&, hand](const Frame& frame) {
      said.push_back(hand->name() + " " + frame.message.at("what").get<std::string>());
    });
  second.order("say", {{"what", "x"}});
  second.order("answer");
  coordinator_.await(second, "answered", 60s);
  first.order("say", {{"what", "y"}});
  first.order("answer");
  coordinator_.await(first, "answered", 60s);
  EXPECT_THAT(said, testing::ElementsAre("the second x", "the first y"));
}

TEST_F(CoordinatorTest, EventWithoutHandlerIsAnError) {
  Coordinator::Hand hand(coordinator_, "the worker", worker("obedient"), "s");
  hand.order("say", {{"what", "x"}});
  hand.order("answer");
  EXPECT_THAT(failure([&] { coordinator_.await(hand, "answered", 60s); }),
              AllOf(HasSubstr("the worker"), HasSubstr("'said'")));
}

// Another's end broke the wait; who is well owes an answer still, and gives it.
TEST_F(CoordinatorTest, LateAnswerIsNotUnexpected) {
  Coordinator::Hand well(coordinator_, "the one that is well", worker("obedient"), "s");
  {
    Coordinator::Hand killed(coordinator_, "the one that is killed", worker("obedient"), "s");
    kill(pid_of(killed), SIGKILL);
    EXPECT_THAT(failure([&] { coordinator_.await(well, "answered", 60s); }), HasSubstr("signal 9"));
  }
  well.order("answer");
  well.order("answer");
  coordinator_.await(well, "answered", 60s);  // the second
  EXPECT_THAT(failure([&] {
                well.order("answer");
                coordinator_.until([] { return false; });
              }),
              AllOf(HasSubstr("unexpected"), HasSubstr("'answered'")));
}

TEST_F(CoordinatorTest, EventHandledForOneWorkerIsUnexpectedFromAnother) {
  Coordinator::Hand first(coordinator_, "the first", worker("obedient"), "s"),
      second(coordinator_, "the second", worker("obedient"), "s");
  int said = 0;
  first.on("said", [&](auto&) { ++said; });
  second.order("say", {{"what", "x"}});
  second.order("answer");
  EXPECT_THAT(failure([&] { coordinator_.await(second, "answered", 60s); }),
              AllOf(HasSubstr("the second"), HasSubstr("'said'")));
  EXPECT_EQ(said, 0);
}

TEST_F(CoordinatorTest, WhatAMiddlewarePrintsIsNoEventAlsoWithoutStandardError) {
  Coordinator::Hand hand(coordinator_, "the worker",
                         {"sh", "-c", "exec \"$0\" obedient 2>&-", this_program()}, "s");
  hand.order("print");
  EXPECT_GT(pid_of(hand), 0);
}

TEST_F(CoordinatorTest, MalformedEventNamesItsWorker) {
  Coordinator::Hand hand(coordinator_, "the worker", worker("obedient"), "s");
  hand.on("said", [](const Frame& frame) { static_cast<void>(frame.message.at("what").get<std::string>()); });
  hand.order("say", {{"what", 7}});
  EXPECT_THAT(failure([&] { coordinator_.await(hand, "answered", 60s); }),
              AllOf(HasSubstr("3 the worker"), HasSubstr("type must be string")));
  EXPECT_TRUE(hand.lost());
}

TEST_F(CoordinatorTest, FailedOrLostWorkerIsReportedWithReason) {
  {
    Coordinator::Hand hand(coordinator_, "the worker", worker("obedient"), "s");
    hand.order("fail");
    EXPECT_EQ(failure([&] { coordinator_.await(hand, "answered", 60s); }), "2 it was wrong");
    EXPECT_TRUE(hand.lost());
  }
  for (const int exit : {0, 1, 130, 256}) {  // a failed process cannot report success
    Coordinator::Hand hand(coordinator_, "the worker", worker("obedient"), "s");
    hand.order("fail", {{"exit", exit}});
    EXPECT_EQ(failure([&] { coordinator_.await(hand, "answered", 60s); }), "3 it was wrong");
  }
  {
    Coordinator::Hand hand(coordinator_, "the worker", worker("obedient"), "s");
    hand.order("ask in vain");
    EXPECT_THROW(coordinator_.await(hand, "answered", 60s), Unanswered);
  }
  {
    Coordinator::Hand hand(coordinator_, "the worker", worker("obedient"), "s");
    kill(pid_of(hand), SIGKILL);
    EXPECT_THAT(failure([&] { coordinator_.await(hand, "answered", 60s); }),
                AllOf(HasSubstr("3 the worker"), HasSubstr("signal 9")));
    EXPECT_TRUE(hand.lost());
  }
  EXPECT_THAT(failure([&] { Coordinator::Hand(coordinator_, "the worker", {"/no/such/program"}, "s"); }),
              HasSubstr("could not be started"));
  EXPECT_THAT(failure([&] { Coordinator::Hand(coordinator_, "the worker", {"false"}, "s"); }),
              HasSubstr("exit code 1"));
  EXPECT_THAT(failure([&] { Coordinator::Hand(coordinator_, "the worker", {"yes"}, "s"); }),
              AllOf(HasSubstr("3 the worker"), testing::EndsWith(": y")));
}

TEST_F(CoordinatorTest, AWorkerOfAnotherBuildIsRefused) {
  EXPECT_THAT(failure([&] { Coordinator::Hand(coordinator_, "the worker", worker("obedient"), "other"); }),
              AllOf(HasSubstr("another build"), HasSubstr("install the same")));
}

TEST_F(CoordinatorTest, StoppedWorkerIsNamedAndGivenUp) {
  Coordinator::Hand stuck(coordinator_, "the stuck one", worker("obedient"), "s"),
      well(coordinator_, "the other", worker("obedient"), "s");
  kill(pid_of(stuck), SIGSTOP);
  EXPECT_THAT(failure([&] { coordinator_.until([] { return false; }); }),
              AllOf(HasSubstr("3 the stuck one"), HasSubstr("10 s")));
  EXPECT_TRUE(stuck.lost());
  well.order("answer");
  coordinator_.await(well, "answered", 60s);  // the loop goes on without it
}

// A slow ssh, a machine under full load: it is silent, for it is not there yet.
TEST_F(CoordinatorTest, SlowStartIsAwaited) {
  Coordinator::Hand hand(coordinator_, "the slow one",
                         {"sh", "-c", "sleep 12; exec " + this_program() + " obedient"}, "s");
  hand.order("answer");
  coordinator_.await(hand, "answered", 60s);
}

// A keeper that begins to trace, on a machine under full load: what its coordinator said meanwhile is not
// read yet.
TEST_F(CoordinatorTest, LongOrderDoesNotMakeTheCoordinatorSilent) {
  Coordinator::Hand hand(coordinator_, "the busy one", worker("obedient"), "s");
  hand.order("take long");
  hand.order("answer");
  coordinator_.await(hand, "answered", 30s);
}

TEST_F(CoordinatorTest, EndlessEventsDoNotBlockAnInterruption) {
  Coordinator::Hand hand(coordinator_, "the talkative one", worker("obedient"), "s");
  int said = 0;
  hand.on("said", [&](auto&) {
    ++said;
    interrupts_ = 1;
    usleep(1'000);  // so that the pipe is never empty
  });
  hand.order("chatter");
  EXPECT_EQ(failure([&] { coordinator_.until([] { return false; }); }), "interrupted");
  EXPECT_LT(said, chatter);
}

TEST_F(CoordinatorTest, TerminatedWorkerIsAnInterruption) {
  Coordinator::Hand hand(coordinator_, "the worker", worker("obedient"), "s");
  const auto pid = pid_of(hand);
  for (const int signal : {SIGTERM, SIGHUP}) kill(pid, signal);  // as a session's end does
  EXPECT_EQ(failure([&] { coordinator_.until([] { return false; }); }), "interrupted");
  EXPECT_EQ(interrupts_, 1);
  // What is under way may take longer than a peer may be silent, and is its coordinator's to end.
  const auto later = std::chrono::steady_clock::now() + longest_silence + 2s;
  coordinator_.until([&] { return std::chrono::steady_clock::now() > later; }, 1);
  hand.order("answer");
  coordinator_.await(hand, "answered", 10s, 1);
}

// A person is, and need not wait for what a coordinator still has to do.
TEST_F(CoordinatorTest, WorkerInterruptedAfterTerminationLeavesAtOnce) {
  Coordinator::Hand hand(coordinator_, "the worker", worker("obedient"), "s");
  const auto pid = pid_of(hand);
  kill(pid, SIGTERM);
  EXPECT_EQ(failure([&] { coordinator_.until([] { return false; }); }), "interrupted");
  kill(pid, SIGINT);
  EXPECT_THAT(failure([&] { coordinator_.until([] { return false; }, 1); }), HasSubstr("3 the worker"));
  EXPECT_TRUE(hand.lost());
}

TEST_F(CoordinatorTest, SlowRestoreIsAwaitedAndReportsWhatRemains) {
  Coordinator::Hand hand(coordinator_, "the worker", worker("obedient"), "s");
  hand.order("be slow at the end");
  pid_of(hand);
  std::string doing;
  const auto left = hand.leave([&] {
    if (!hand.doing().empty()) doing = hand.doing();
    return true;
  });
  EXPECT_TRUE(left.gave_back);
  EXPECT_FALSE(left.waits);
  EXPECT_THAT(left.notes, testing::ElementsAre("a setting stays"));
  EXPECT_EQ(doing, "giving back");
}

TEST_F(CoordinatorTest, NotesOfAnUnfinishedOrderAreReported) {
  Coordinator::Hand hand(coordinator_, "the worker", worker("obedient"), "s");
  hand.order("close");
  coordinator_.await(hand, "said", 10s);
  const auto left = hand.leave([] { return true; });
  EXPECT_TRUE(left.gave_back);
  EXPECT_THAT(left.notes, testing::ElementsAre("the load stays"));
}

TEST_F(CoordinatorTest, WorkerThatIsKilledHasNotGivenBack) {
  Coordinator::Hand hand(coordinator_, "the worker", worker("obedient"), "s");
  kill(pid_of(hand), SIGKILL);
  const auto left = hand.leave([] { return true; });
  EXPECT_FALSE(left.gave_back);
  EXPECT_FALSE(left.waits);
}

TEST_F(CoordinatorTest, WorkerThatIsNotWaitedForGoesOn) {
  pid_t pid = -1;
  {
    Coordinator::Hand hand(coordinator_, "the worker", worker("obedient"), "s");
    hand.order("be slow at the end");
    pid = pid_of(hand);
    EXPECT_TRUE(hand.leave([] { return false; }).waits);
  }
  EXPECT_EQ(waitpid(pid, nullptr, WNOHANG), 0) << "it was ended";
  kill(pid, SIGKILL);
  waitpid(pid, nullptr, 0);
}

// What a worker says that is alone: here the coordinator is this test, which says nothing.
TEST(Worker, LeavesACoordinatorThatIsSilent) {
  Process process("the worker", worker("obedient"));
  auto& frames = process.frames();
  json last;
  try {
    while (true) {
      while (!frames.fill()) usleep(10'000);
      while (const auto frame = frames.take())
        if (frame->message.at("event") == "failed") last = frame->message;
    }
  } catch (const Broken&) {  // it has left
  }
  EXPECT_EQ(last.at("event"), "failed");
  EXPECT_THAT(last.at("message").get<std::string>(), HasSubstr("the coordinator"));
  EXPECT_THAT(last.at("message").get<std::string>(), HasSubstr("10 s"));
}

// As by an upgrade during a suite.
TEST(Program, HasItsPathAlsoOnceAnotherIsInstalledThere) {
  const auto copy =
      std::filesystem::temp_directory_path() / ("ontime-orders-test-" + std::to_string(getpid()));
  std::filesystem::copy_file("/proc/self/exe", copy);
  const auto started = process::start({copy.string(), "replaced"}, {0, 1, 2});
  EXPECT_EQ(process::wait_for(started.pid), 0);
  std::filesystem::remove(copy);
}

// The exit code of a child that was given these signals, and then SIGTERM; 2: it did not hear that.
template <class Given>
int code_after(Given given) {
  const pid_t child = fork();
  if (child == 0) {
    given();
    on_termination([](int) { _exit(7); });
    raise(SIGTERM);
    _exit(2);
  }
  int status = 0;
  waitpid(child, &status, 0);
  return WEXITSTATUS(status);
}

TEST(Signals, IgnoredSignalsStayIgnored) {
  EXPECT_EQ(code_after([] {
              std::signal(SIGHUP, SIG_IGN);  // as nohup leaves it
              on_termination([](int) { _exit(1); });
              raise(SIGHUP);
            }),
            7);
}

TEST(Signals, BlockedSignalsAreHeard) {
  EXPECT_EQ(code_after([] {
              sigset_t all;
              sigfillset(&all);
              sigprocmask(SIG_BLOCK, &all, nullptr);
            }),
            7);
}

class Obedient final : public Worker {
 public:
  explicit Obedient(Events& events) : events_(events) {}
  void obey(const std::string& order, const json& body) override {
    if (order == "say") events_.tell("said", {{"what", body.at("what")}});
    if (order == "answer") events_.tell("answered", {{"pid", getpid()}});
    if (order == "print") {
      std::puts("as a middleware may");
      std::fflush(stdout);
    }
    if (order == "chatter")
      for (int count = 0; count < chatter; ++count) events_.tell("said", json::object(), much);
    if (order == "take long") std::this_thread::sleep_for(longest_silence + 1s);
    if (order == "be slow at the end") slow_ = true;
    if (order == "close") {
      events_.tell("said");
      std::this_thread::sleep_for(300ms);
      events_.tell("closed", {{"notes", {"the load stays"}}});
    }
    if (order == "ask in vain") throw Unanswered("no peer was there");
    if (order == "fail") throw Error(body.value("exit", 2), "it was wrong");
  }
  std::chrono::milliseconds go_on() override { return 500ms; }
  std::vector<std::string> give_back() noexcept override {
    if (!slow_) return {};
    events_.doing("giving back");
    std::this_thread::sleep_for(longest_silence + 1s);
    return {"a setting stays"};
  }

 private:
  Events& events_;
  bool slow_ = false;
};

}  // namespace
}  // namespace ontime::orders

// The workers of these tests are this program.
int main(int argc, char** argv) {
  using namespace ontime::orders;
  if (argc > 1 && std::string_view(argv[1]) == "obedient")
    return serve("s", [](Events& events) { return std::make_unique<Obedient>(events); });
  if (argc > 1 && std::string_view(argv[1]) == "replaced") {
    const auto path = this_program();
    std::filesystem::remove(path);
    return this_program() == path ? 0 : 1;
  }
  on_termination([](int) { _exit(130); });
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}

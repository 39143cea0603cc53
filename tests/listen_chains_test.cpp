// SPDX-License-Identifier: Apache-2.0
#include <functional>
#include <set>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "listen/chains.hpp"
#include "listen_times.hpp"

namespace ontime::listen {
namespace {

using namespace std::chrono_literals;
using testing::ElementsAre;

// Processes 1 to 4 publish /scan, take it and publish /map, take that and publish /cmd_vel, take that. The
// thread that does it has the process's number; a publisher too.
class ChainOfThree : public testing::Test {
 protected:
  explicit ChainOfThree(bool is_of_latest = false)
      : chain(
            {.steps = {{"/scan"}, {"/map", is_of_latest}, {"/cmd_vel"}}, .age = 50ms},
            [](std::uint32_t process) {
              return Party{process, "node"};
            },
            probing, 100) {}

  void publish(std::uint32_t process, std::uint64_t number, std::int64_t at_ms) {
    publish(process, process, number, at_ms);
  }
  void publish(std::uint32_t process, std::uint32_t thread, std::uint64_t number, std::int64_t at_ms) {
    chain.published({topics.at(process - 1), process, thread, process, number, at_ms * ms});
  }
  void take(std::uint32_t process, std::optional<std::uint64_t> number, std::int64_t at_ms) {
    take(process, process, number, at_ms);
  }
  // Stamped a millisecond before.
  void take(std::uint32_t process, std::uint32_t thread, std::optional<std::uint64_t> number,
            std::int64_t at_ms) {
    chain.taken({topics.at(process - 2), process, thread, process - 1, number, at_ms * ms, (at_ms - 1) * ms});
  }
  void pass(std::uint64_t number, std::int64_t at_ms) {
    publish(1, number, at_ms);
    take(2, number, at_ms + 1);
    publish(2, number, at_ms + 11);
    take(3, number, at_ms + 13);
    publish(3, number, at_ms + 33);
    take(4, number, at_ms + 36);
  }

  const std::vector<std::string> topics{"/scan", "/map", "/cmd_vel"};
  Probing probing;
  ChainFollower chain;
};

TEST_F(ChainOfThree, MessageUnderWayWhileProbesAreSetIsNotJudged) {
  publish(1, 0, 0);
  probing.add(2 * ms, 60 * ms);
  take(2, 0, 61);
  publish(2, 0, 62);
  take(3, 0, 63);
  publish(3, 0, 64);
  take(4, 0, 65);
  pass(1, 100);
  const auto found = chain.findings();
  ASSERT_EQ(found.paths.size(), 1U);
  EXPECT_EQ(found.paths[0].late, 0U);
  EXPECT_EQ(found.paths[0].not_judged, 1U);
  EXPECT_EQ(found.paths[0].age.count(), 1U);
}

TEST_F(ChainOfThree, MessageThatProbesMayHaveEndedIsNotCounted) {
  probing.add(0, 18 * ms);
  publish(1, 0, 1);  // overwritten while the node was held up
  pass(1, 20);
  EXPECT_THAT(chain.findings().ended, ElementsAre(0, 0, 0, 0, 0));
  publish(1, 2, 100);
  pass(3, 120);
  EXPECT_THAT(chain.findings().ended, ElementsAre(1, 0, 0, 0, 0));
}

class ChainOfLatest : public ChainOfThree {
 protected:
  ChainOfLatest() : ChainOfThree(true) {}
};

TEST_F(ChainOfThree, MessageHasTheTimeOfEachPart) {
  pass(0, 0);
  const auto found = chain.findings();
  ASSERT_EQ(found.paths.size(), 1U);
  const auto& path = found.paths[0];
  EXPECT_EQ(path.age.max_ns(), 36 * ms);
  std::vector<std::int64_t> parts;
  for (const auto& part : path.parts) parts.push_back(part.max_ns());
  EXPECT_THAT(parts, ElementsAre(1 * ms, 10 * ms, 2 * ms, 20 * ms, 3 * ms));
  EXPECT_EQ(path.late, 0U);
  EXPECT_THAT(found.without_take, ElementsAre(0, 0, 0));
  std::vector<std::uint32_t> processes;
  for (const auto& party : path.parties) processes.push_back(party.process);
  EXPECT_THAT(processes, ElementsAre(1, 2, 3, 4));
}

TEST_F(ChainOfThree, AgeBeyondTheLimitIsLate) {
  publish(1, 0, 0);
  take(2, 0, 1);
  publish(2, 0, 2);
  take(3, 0, 3);
  publish(3, 0, 49);
  take(4, 0, 51);
  EXPECT_EQ(chain.findings().paths.at(0).late, 1U);
}

TEST_F(ChainOfThree, SamplingDownIsNoLoss) {
  for (std::uint64_t i = 0; i < 30; ++i) {
    const auto at_ms = static_cast<std::int64_t>(i) * 100;
    publish(1, i, at_ms);
    take(2, i, at_ms + 1);
    if (i % 3 != 0) continue;
    publish(2, i / 3, at_ms + 2);
    take(3, i / 3, at_ms + 3);
    publish(3, i / 3, at_ms + 4);
    take(4, i / 3, at_ms + 5);
  }
  const auto found = chain.findings();
  EXPECT_EQ(found.paths.at(0).age.count(), 10U);
  // The two after the last that came out may still come.
  EXPECT_THAT(found.ended, ElementsAre(0, 18, 0, 0, 0));
}

TEST_F(ChainOfThree, MessageThatIsNotTakenEndsInItsTopic) {
  pass(0, 0);
  publish(1, 1, 100);
  take(2, 1, 101);
  publish(2, 1, 102);
  pass(2, 200);
  EXPECT_THAT(chain.findings().ended, ElementsAre(0, 0, 1, 0, 0));
}

TEST_F(ChainOfThree, TakeByARecorderIsNotATakeOfTheChain) {
  pass(0, 0);
  publish(1, 1, 100);
  chain.taken({topics[0], 9, 9, 1, 1, 101 * ms});
  pass(2, 200);
  const auto found = chain.findings();
  EXPECT_THAT(found.ended, ElementsAre(1, 0, 0, 0, 0));
  EXPECT_EQ(found.paths.size(), 1U);
}

TEST_F(ChainOfThree, MessageUnderWayHasNotEnded) {
  pass(0, 0);
  publish(1, 1, 100);
  take(2, 1, 101);
  EXPECT_THAT(chain.findings().ended, ElementsAre(0, 0, 0, 0, 0));
  publish(2, 1, 300);
  take(3, 1, 301);
  publish(3, 1, 302);
  take(4, 1, 303);
  EXPECT_EQ(chain.findings().paths.at(0).age.max_ns(), 203 * ms);
}

TEST_F(ChainOfThree, NodeThatDiesEndsWhatIsUnderWayAndSilencesTheChain) {
  pass(0, 0);
  for (std::uint64_t i = 1; i <= 150; ++i) {
    publish(1, i, static_cast<std::int64_t>(i) * 100);
    take(2, i, static_cast<std::int64_t>(i) * 100 + 1);
  }
  const auto found = chain.findings();
  EXPECT_THAT(found.ended, ElementsAre(0, 50, 0, 0, 0));
  EXPECT_EQ(found.silent_ns, 15'001 * ms - 36 * ms);
}

TEST_F(ChainOfThree, WaitEndsTheCallback) {
  publish(1, 0, 0);
  take(2, 0, 1);
  chain.turned(2, 2 * ms);
  publish(2, 0, 2);
  const auto found = chain.findings();
  EXPECT_THAT(found.without_take, ElementsAre(0, 1, 0));
  take(3, 0, 3);
  publish(3, 0, 4);
  take(4, 0, 5);
  EXPECT_TRUE(chain.findings().paths.empty());
}

TEST_F(ChainOfThree, TakeOfAnotherTopicEndsTheCallback) {
  publish(1, 0, 0);
  take(2, 0, 1);
  chain.taken({"/tf", 2, 2, 7, 0, 2 * ms});
  publish(2, 0, 3);
  EXPECT_THAT(chain.findings().without_take, ElementsAre(0, 1, 0));
}

TEST_F(ChainOfThree, ThreadsOfOneProcessAreApart) {
  publish(1, 0, 0);
  publish(1, 1, 5);
  take(2, 20, 0, 6);
  take(2, 21, 1, 7);
  publish(2, 21, 0, 8);  // of the message at 5 ms
  publish(2, 20, 1, 9);  // of that at 0 ms
  publish(2, 22, 2, 10);
  for (const std::uint32_t thread : {20, 21, 22}) chain.turned(thread, 11 * ms);
  for (std::uint64_t i = 0; i < 3; ++i) {
    const auto at_ms = static_cast<std::int64_t>(i) * 3 + 20;
    take(3, i, at_ms);
    publish(3, i, at_ms + 1);
    take(4, i, at_ms + 2);
  }
  const auto found = chain.findings();
  EXPECT_EQ(found.paths.at(0).age.count(), 2U);
  EXPECT_EQ(found.paths.at(0).age.max_ns(), (25 - 0) * ms);
  EXPECT_EQ(found.paths.at(0).age.sum_ns(), static_cast<double>((22 - 5 + 25) * ms));
  EXPECT_THAT(found.without_take, ElementsAre(0, 1, 0));
}

// Both stamps may come after both publishes began, in either order.
TEST_F(ChainOfThree, TwoThreadsThatPublishAtOnceAreNotToldApart) {
  pass(0, 0);
  publish(1, 1, 100);
  publish(1, 2, 105);
  take(2, 20, 1, 106);
  take(2, 21, 2, 107);
  publish(2, 20, 1, 110);
  publish(2, 21, 2, 111);
  take(3, 2, 112);
  publish(3, 1, 113);
  take(4, 1, 114);
  chain.turned(20, 115 * ms);
  take(3, 1, 116);
  publish(3, 2, 117);
  take(4, 2, 118);
  pass(3, 200);
  const auto found = chain.findings();
  EXPECT_EQ(found.paths.at(0).age.count(), 3U);
  EXPECT_THAT(found.ended, ElementsAre(0, 0, 0, 0, 0));
  EXPECT_THAT(found.unknown_takes, ElementsAre(0, 1, 0));
}

TEST_F(ChainOfThree, TwoPublishersOfATopicAreTwoPaths) {
  pass(0, 0);
  publish(1, 1, 100);
  take(2, 1, 101);
  chain.taken({topics[0], 5, 5, 1, 1, 102 * ms});
  publish(2, 1, 103);
  chain.published({topics[1], 5, 5, 5, 0, 104 * ms});
  take(3, 1, 105);
  publish(3, 1, 106);
  take(4, 1, 107);
  chain.taken({topics[1], 3, 3, 5, 0, 108 * ms});
  publish(3, 2, 109);
  take(4, 2, 110);
  const auto found = chain.findings();
  ASSERT_EQ(found.paths.size(), 2U);
  EXPECT_EQ(found.paths[0].age.count(), 2U);
  EXPECT_EQ(found.paths[1].parties[1].process, 5U);
  EXPECT_EQ(found.paths[1].age.max_ns(), 10 * ms);
}

TEST_F(ChainOfThree, TakeOfAnUnknownPublishLinksNothingAndAccusesNoPart) {
  pass(0, 0);
  publish(1, 1, 100);
  chain.taken({topics[0], 2, 2, 0, {}, 101 * ms});
  publish(2, 1, 102);
  take(3, 1, 103);
  publish(3, 1, 104);
  take(4, 1, 105);
  pass(2, 200);
  const auto found = chain.findings();
  EXPECT_EQ(found.paths.at(0).age.count(), 2U);
  EXPECT_THAT(found.unknown_takes, ElementsAre(1, 0, 0));
  EXPECT_THAT(found.without_take, ElementsAre(0, 0, 0));
  EXPECT_THAT(found.ended, ElementsAre(0, 0, 0, 0, 0));
}

TEST_F(ChainOfThree, LostEventsEndNothingAndLinkNothing) {
  pass(0, 0);
  publish(1, 1, 100);
  take(2, 1, 101);
  chain.interrupt();
  publish(2, 1, 102);
  take(3, 1, 103);
  pass(2, 200);
  const auto found = chain.findings();
  EXPECT_EQ(found.paths.at(0).age.count(), 2U);
  EXPECT_THAT(found.ended, ElementsAre(0, 0, 0, 0, 0));
}

TEST_F(ChainOfThree, AnotherProcessOfTheSameNumberIsAnotherPath) {
  pass(0, 0);
  chain.retire(3);
  pass(1, 100);
  const auto found = chain.findings();
  ASSERT_EQ(found.paths.size(), 2U);
  EXPECT_NE(found.paths[0].id, found.paths[1].id);
}

TEST_F(ChainOfThree, MemoryIsBoundedAndForgottenMessagesAreCounted) {
  for (std::uint64_t i = 0; i < 3 * ChainFollower::most_begun; ++i) {
    const auto at_ms = static_cast<std::int64_t>(i) * 40;
    if (i % 2 == 0)
      pass(i, at_ms);
    else
      publish(1, i, at_ms);
  }
  for (std::uint32_t reader = 10; reader < 10 + 2 * ChainFollower::most_paths; ++reader)
    chain.taken({topics[2], reader, reader, 3, 3 * ChainFollower::most_begun - 2, 1'000'000 * ms});
  const auto found = chain.findings();
  EXPECT_EQ(found.ended[0], 3 * ChainFollower::most_begun / 2);
  EXPECT_EQ(found.paths.size(), ChainFollower::most_paths);
  // The way that was idle for long made room, the others did not.
  EXPECT_EQ(found.forgotten, 3 * ChainFollower::most_begun / 2 + ChainFollower::most_paths);
}

TEST_F(ChainOfThree, PathsBeyondTheLimitGetNoRowsAndCountLateMessages) {
  std::set<std::uint64_t> ids;
  chain.keep_rows([&](const Row& row) { ids.insert(row.flow); });
  for (std::uint64_t i = 0; i < 10; ++i) {
    const auto at_ms = static_cast<std::int64_t>(i) * 100;
    pass(i, at_ms);
    for (std::uint32_t reader = 10; reader < 10 + ChainFollower::most_paths; ++reader)
      chain.taken({topics[2], reader, reader, 3, i, (at_ms + 60) * ms, (at_ms + 34) * ms});
  }
  const auto found = chain.findings();
  EXPECT_EQ(ids.size(), ChainFollower::most_paths);
  EXPECT_EQ(found.forgotten, 10U);
  EXPECT_EQ(found.forgotten_late, 10U);
}

TEST_F(ChainOfThree, SilenceOfAFastTopicIsSeen) {
  pass(0, 0);
  for (std::uint64_t i = 1; i <= 3 * ChainFollower::most_begun; ++i)
    publish(1, i, 100 + static_cast<std::int64_t>(i));
  EXPECT_GT(chain.findings().silent_ns, ChainFollower::under_way_ns);
}

TEST_F(ChainOfThree, WriterThatIsNotKnownHidesNoSilence) {
  pass(0, 0);
  for (std::uint64_t i = 1; i <= 150; ++i) {
    publish(1, i, static_cast<std::int64_t>(i) * 100);
    chain.taken({topics[2], 4, 4, 0, {}, static_cast<std::int64_t>(i) * 100 * ms + 5 * ms});
  }
  EXPECT_GT(chain.findings().silent_ns, ChainFollower::under_way_ns);
}

TEST_F(ChainOfThree, MessageThatTakesLongSilencesNothing) {
  pass(0, 0);
  publish(1, 1, 100);
  take(2, 1, 12'000);
  publish(2, 1, 12'001);
  take(3, 1, 12'002);
  publish(3, 1, 12'003);
  take(4, 1, 12'004);
  publish(1, 2, 12'005);
  EXPECT_EQ(chain.findings().silent_ns, 0);
}

TEST_F(ChainOfThree, ThreadsThatPublishByTurnsAreToldApart) {
  for (std::uint64_t i = 0; i < 100; ++i) {
    const auto at_ms = static_cast<std::int64_t>(i) * 10;
    const auto thread = static_cast<std::uint32_t>(20 + i % 8);
    publish(1, i, at_ms);
    take(2, thread, i, at_ms + 2);
    publish(2, thread, i, at_ms + 3);
    take(3, i, at_ms + 5);
    publish(3, i, at_ms + 6);
    take(4, i, at_ms + 8);
  }
  const auto found = chain.findings();
  EXPECT_EQ(found.paths.at(0).age.count(), 100U);
  EXPECT_THAT(found.unknown_takes, ElementsAre(0, 0, 0));
}

TEST_F(ChainOfThree, ThreadsThatEndedKeepNoOtherFromEndingItsCall) {
  for (std::uint32_t thread = 0; thread < ChainFollower::most_threads; ++thread)
    publish(1, 1000 + thread, thread, 0);
  publish(2, 20, 0, 5);
  chain.turned(20, 6 * ms);
  publish(2, 21, 1, 8);
  take(3, 1, 10);
  EXPECT_THAT(chain.findings().unknown_takes, ElementsAre(0, 0, 0));
}

TEST_F(ChainOfThree, MessagesThatAreTakenWhenTheirPublishIsForgottenAccuseNoPart) {
  pass(0, 0);
  const std::uint64_t many = 2 * ChainFollower::most_remembered;
  for (std::uint64_t i = 1; i <= many; ++i) publish(1, i, 100 + static_cast<std::int64_t>(i));
  for (std::uint64_t i = 1; i <= many; ++i) take(2, i, 5000 + static_cast<std::int64_t>(i));
  pass(many + 1, 10'000);
  const auto found = chain.findings();
  EXPECT_EQ(found.unknown_takes[0], ChainFollower::most_remembered);
  EXPECT_EQ(found.ended[0], 0U);
}

TEST_F(ChainOfThree, PublishAfterLostEventsIsNotWithoutATake) {
  publish(1, 0, 0);
  take(2, 0, 1);
  chain.interrupt();
  publish(2, 0, 2);
  EXPECT_THAT(chain.findings().without_take, ElementsAre(0, 0, 0));
  publish(2, 1, 3);
  EXPECT_THAT(chain.findings().without_take, ElementsAre(0, 1, 0));
}

TEST_F(ChainOfThree, ThreadWithTheNumberOfAnotherProcessIsAnother) {
  publish(1, 0, 0);
  take(2, 20, 0, 1);
  chain.published({topics[1], 9, 20, 9, 0, 5000 * ms});
  chain.taken({topics[1], 3, 3, 9, 0, 5001 * ms, 5000 * ms});
  publish(3, 0, 5002);
  take(4, 0, 5003);
  EXPECT_TRUE(chain.findings().paths.empty());
}

TEST_F(ChainOfThree, EachArrivedMessageHasARow) {
  std::vector<Row> rows;
  chain.keep_rows([&](const Row& row) { rows.push_back(row); });
  pass(0, 0);
  publish(1, 1, 100);
  pass(2, 200);
  ASSERT_EQ(rows.size(), 2U);
  EXPECT_EQ(rows[1].flow, chain.findings().paths.at(0).id);
  EXPECT_EQ(rows[1].index, 1U);
  EXPECT_EQ(rows[1].from_ns, 200 * ms);
  EXPECT_EQ(rows[1].to_ns, 236 * ms);
}

TEST_F(ChainOfLatest, PublishOfATimerBelongsToTheLatestTakeOfItsProcess) {
  publish(1, 0, 0);
  take(2, 20, 0, 1);
  publish(1, 1, 10);
  take(2, 20, 1, 11);
  chain.turned(20, 12 * ms);
  publish(2, 21, 0, 15);
  publish(2, 21, 1, 18);  // a timer that is faster than its input says the same again
  for (std::uint64_t i = 0; i < 2; ++i) {
    take(3, i, 19);
    publish(3, i, 20);
    take(4, i, 21);
  }
  const auto found = chain.findings();
  EXPECT_EQ(found.paths.at(0).age.count(), 2U);
  EXPECT_EQ(found.paths.at(0).age.max_ns(), 11 * ms);
  EXPECT_THAT(found.without_take, ElementsAre(0, 0, 0));
}

TEST_F(ChainOfLatest, MessagesOfAnEndedProcessLinkNothing) {
  publish(1, 0, 0);
  take(2, 0, 1);
  chain.retire(1);
  publish(2, 0, 20'000);
  take(3, 0, 20'001);
  publish(3, 0, 20'002);
  take(4, 0, 20'003);
  EXPECT_TRUE(chain.findings().paths.empty());
}

TEST_F(ChainOfLatest, DuplicateLeavesTheLatestAsItIs) {
  publish(1, 0, 0);
  take(2, 0, 1);
  take(2, std::nullopt, 2);
  publish(2, 0, 3);
  take(3, 0, 4);
  publish(3, 0, 5);
  take(4, 0, 6);
  EXPECT_EQ(chain.findings().paths.at(0).age.count(), 1U);
}

}  // namespace
}  // namespace ontime::listen

// SPDX-License-Identifier: Apache-2.0
// Whose the machine is meanwhile.
#include <chrono>
#include <thread>

#include "journal_setting.hpp"

namespace ontime::journal {
namespace {

using test::error_of;
using test::in_child;
using test::Victim;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

TEST_F(Settings, OneChangesTheMachineAtATime) {
  Victim holder([](Journal& journal) {
    journal.held_for({4711, "ontime run\ndemo"});
    return make_folder(journal);
  });
  Journal second(settings);
  const auto refused = error_of([&] { second.change(governor, one_, "performance"); });
  EXPECT_THAT(refused, AllOf(HasSubstr("process 4711 (\"ontime run demo\")"), HasSubstr("wait until")))
      << "a keeper holds the machine for it";
  EXPECT_EQ(read_file(one_), "powersave");
  EXPECT_THAT(second.revert(), IsEmpty());
  EXPECT_TRUE(fs::exists(holder.said()));
  holder.kill_9();
  second.hold();
  EXPECT_FALSE(fs::exists(holder.said())) << "what a dead one left is cleared on the way";
  second.change(governor, one_, "performance");
  EXPECT_THAT(error_of([] { Journal().hold(); }), HasSubstr(std::to_string(getpid())));
}

TEST_F(Settings, AHolderThatIsAboutToEndIsWaitedFor) {
  Journal ending;
  ending.hold();
  std::thread end([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(300));
    EXPECT_THAT(ending.revert(), IsEmpty());
  });
  Journal next;
  EXPECT_NO_THROW(next.hold());
  end.join();
}

TEST_F(Journals, WithoutChangesBlockNoOther) {
  Journal one, two;
  EXPECT_TRUE(there_is_no_folder());
  make_folder(one);
}

class Processes : public Settings {
 protected:
  // As in a container: other process ids, and a /proc that shows no others.
  static void in_pid_namespace(const std::function<void()>& body) {
    in_child([&] {
      ASSERT_EQ(unshare(CLONE_NEWPID | CLONE_NEWNS), 0);
      in_child([&] {
        ASSERT_EQ(mount("proc", "/proc", "proc", 0, nullptr), 0);
        ASSERT_EQ(getpid(), 1);
        body();
      });
    });
  }
  void SetUp() override {
    Settings::SetUp();
    if (!test::has_own_run) GTEST_SKIP() << "needs root";
  }
};

TEST_F(Processes, ProcessesOfAnotherPidNamespaceAreAlive) {
  Journal journal;
  const auto path = make_folder(journal);
  in_pid_namespace([&] {
    EXPECT_THAT(revert_abandoned(), IsEmpty());
    EXPECT_TRUE(fs::exists(path));
    Journal other;
    EXPECT_THAT(error_of([&] { other.hold(); }), HasSubstr("another ontime changes this machine"));
  });
  EXPECT_TRUE(fs::exists(path));
}

TEST_F(Processes, EndedProcessesOfAnotherPidNamespaceAreGone) {
  in_pid_namespace([&] {
    Victim victim([](Journal& journal) { return make_folder(journal); });
    EXPECT_THAT(revert_abandoned(), IsEmpty());
    victim.kill_9();
    write_file(folder_ / "said", victim.said());
  });
  const auto path = read_file(folder_ / "said");
  EXPECT_TRUE(fs::exists(path));
  EXPECT_THAT(revert_abandoned(), ElementsAre(HasSubstr(path))) << "though its mount namespace was another";
  EXPECT_FALSE(fs::exists(path));
}

}  // namespace
}  // namespace ontime::journal

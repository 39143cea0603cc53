// SPDX-License-Identifier: Apache-2.0
// What is set on a machine.
#include <system_error>

#include "journal_setting.hpp"

namespace ontime::journal {
namespace {

using test::error_of;
using test::in_child;
using test::set;
using test::Victim;
using ::testing::AllOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;
using ::testing::StartsWith;

TEST_F(Settings, ArePutBackInTheirOrder) {
  {
    Journal journal(settings);
    journal.change(governor, one_, "performance");
    EXPECT_EQ(read_file(one_), "performance");
    journal.change(governor, one_, "ondemand");
    journal.change(governor, two_, "made");
    journal.change(governor, one_, {});
    EXPECT_FALSE(fs::exists(one_));
    journal.change(governor, two_, "made");  // is so already
  }
  EXPECT_EQ(read_file(one_), "powersave");
  EXPECT_FALSE(fs::exists(two_));
}

TEST_F(Settings, AreReadBack) {
  Journal journal(settings);
  EXPECT_THAT(error_of([&] { journal.change(governor, one_, "9000"); }),
              AllOf(HasSubstr("titled " + one_), HasSubstr("9000"), HasSubstr("4096")));
  EXPECT_EQ(read_file(one_), "powersave") << "half a success is undone";
  EXPECT_EQ(error_of([&] { journal.change(governor, one_, "impossible"); }), "no such value");
  EXPECT_EQ(read_file(one_), "powersave");
  journal.change(governor, one_, "performance");
  EXPECT_THAT(parse(read_file(journals().at(0))).entries, SizeIs(1)) << "what was not changed is not there";
  EXPECT_THAT(journal.revert(), IsEmpty());
  EXPECT_EQ(read_file(one_), "powersave");
}

TEST_F(Settings, AThingThatAnotherProgramMakesJustBeforeIsLeft) {
  Journal journal(settings);
  EXPECT_EQ(error_of([&] { journal.change(governor, two_, "another is quicker"); }), "it exists");
  EXPECT_EQ(read_file(two_), "another's");
  EXPECT_THAT(parse(read_file(journals().at(0))).entries, IsEmpty());
  EXPECT_THAT(journal.revert(), IsEmpty());
  EXPECT_EQ(read_file(two_), "another's");
}

// As where no more threads can be started: the identities that follow are of the right entries.
TEST_F(Settings, AnErrorOfTheLibraryDuringAChangeLeavesTheJournalInStep) {
  std::string folder;
  {
    Journal journal(settings);
    EXPECT_THROW(journal.change(governor, one_, "no thread"), std::system_error);
    EXPECT_EQ(read_file(one_), "powersave");
    folder = make_folder(journal);
    const auto entries = parse(read_file(journals().at(0))).entries;
    ASSERT_THAT(entries, SizeIs(1));
    EXPECT_EQ(entries[0].after, directory_kind.read(folder));
    EXPECT_THAT(journal.revert(), IsEmpty());
  }
  EXPECT_FALSE(fs::exists(folder));
}

TEST_F(Settings, AnErrorOfTheLibraryKeepsOneEntryAndUndoesTheOthers) {
  const auto path =
      plant(text_of_all({boot_id(), 7, "ontime"}, {{"governor", "", two_, "first", "second"},
                                                   {"governor", "", one_, "no thread", "mine"}}));
  write_file(one_, "mine");
  write_file(two_, "second");
  EXPECT_THAT(revert_abandoned(settings), AllOf(SizeIs(2), Contains(HasSubstr(path.string()))));
  EXPECT_EQ(read_file(two_), "first");
  EXPECT_TRUE(fs::exists(path));
  unplant(path);
}

TEST_F(Settings, CanBeTakenBackOneByOne) {
  Journal journal(settings);
  const auto folder = make_folder(journal);
  for (int round = 0; round < 3; ++round) {
    journal.change(governor, one_, "performance");
    const auto other = make_folder(journal);
    journal.change(governor, one_, "ondemand");
    EXPECT_THAT(journal.take_back(governor, one_), IsEmpty());
    EXPECT_EQ(read_file(one_), "powersave");
    EXPECT_TRUE(fs::exists(other));
    EXPECT_THAT(parse(read_file(journals().at(0))).entries, SizeIs(3)) << "a journal does not grow for ever";
    EXPECT_THAT(remove_directory(journal, other), IsEmpty());
    EXPECT_FALSE(fs::exists(other));
    EXPECT_THAT(parse(read_file(journals().at(0))).entries, SizeIs(1));
  }
  journal.change(governor, two_, "made");
  write_file(two_, "by another");
  EXPECT_THAT(journal.take_back(governor, two_), ElementsAre(StartsWith("left")));
  EXPECT_THAT(journal.take_back(governor, two_), IsEmpty());
  EXPECT_THAT(journal.take_back(governor, "never changed"), IsEmpty());
  journal.change(governor, one_, "ondemand");
  EXPECT_THAT(journal.revert(), IsEmpty());
  EXPECT_FALSE(fs::exists(folder));
  EXPECT_EQ(read_file(one_), "powersave");
  EXPECT_EQ(read_file(two_), "by another");
}

TEST_F(Settings, TakenBackAreNotTakenBackAgain) {
  Victim victim(
      [&](Journal& journal) {
        journal.change(governor, one_, "performance");
        make_folder(journal);
        journal.take_back(governor, one_);
        return "done";
      },
      settings);
  victim.kill_9();
  write_file(one_, "performance");  // another process did, and meant it
  EXPECT_THAT(revert_abandoned(settings), ElementsAre(StartsWith("removed directory")));
  EXPECT_EQ(read_file(one_), "performance");
}

// It is killed after it has restored all, and before it says so in the journal.
TEST_F(Settings, AKilledRevertLeavesNothingThatAnotherProgramWouldHaveChanged) {
  const auto path = plant(text_of_all({boot_id(), 7, "ontime"}, {{"governor", "", one_, "first", "second"},
                                                                 {"governor", "", one_, "second", "third"}}));
  write_file(one_, "first");
  EXPECT_THAT(revert_abandoned(settings), IsEmpty());
  EXPECT_EQ(read_file(one_), "first");
  EXPECT_FALSE(fs::exists(path));
}

TEST_F(Settings, AJournalThatIsFullRefusesAndIsKeptUsable) {
  Journal journal(settings);
  const std::string much(100'000, 'x');
  std::string refused;
  for (int round = 0; round < 20 && refused.empty(); ++round)
    refused = error_of([&] { journal.change(governor, one_, much + std::to_string(round)); });
  EXPECT_THAT(refused, HasSubstr("without a journal"));
  EXPECT_THAT(journal.revert(), IsEmpty());
  EXPECT_EQ(read_file(one_), "powersave");
}

TEST_F(Settings, AFullDiskRefusesAllChangesAndKeepsNoJournal) {
  if (!test::has_own_run) GTEST_SKIP() << "needs root";
  in_child([&] {
    ASSERT_EQ(unshare(CLONE_NEWNS), 0);
    ASSERT_EQ(mount("none", "/run", "tmpfs", 0, "size=4k"), 0);
    write_file("/run/full", std::string(4096, 'x'));
    Journal journal(settings);
    EXPECT_THAT(error_of([&] { journal.change(governor, one_, "performance"); }), HasSubstr("No space left"));
    EXPECT_EQ(read_file(one_), "powersave");
    EXPECT_TRUE(there_is_no_folder());
    fs::remove("/run/full");
    journal.change(governor, one_, "performance");
    EXPECT_THAT(journal.revert(), IsEmpty());
    EXPECT_EQ(read_file(one_), "powersave");
  });
}

TEST_F(Settings, SettingsOfAKilledProcessAreRestored) {
  Victim victim(
      [&](Journal& journal) {
        journal.change(governor, one_, "performance");
        journal.change(governor, one_, "ondemand");
        return "changed";
      },
      settings);
  victim.kill_9();
  EXPECT_THAT(revert_abandoned(settings), ElementsAre(AllOf(HasSubstr(one_ + " back to powersave"),
                                                            HasSubstr(std::to_string(getpid())))));
  EXPECT_EQ(read_file(one_), "powersave");
}

TEST_F(Settings, UnrestorableSettingsAreReportedUntilRestored) {
  write_file(one_, "impossible");
  {
    Journal journal(settings);
    journal.change(governor, one_, "performance");
  }  // no program reads what this could not restore
  EXPECT_THAT(revert_abandoned(settings, Tell::always), ElementsAre(HasSubstr("no such value")));
  EXPECT_THAT(revert_abandoned(settings), ElementsAre(HasSubstr("no such value")));
  EXPECT_THAT(revert_abandoned(settings), IsEmpty()) << "told at one start, it is not told at the next";
  const auto asked_for = [] { return Journal(settings).revert_kept(); };
  EXPECT_THAT(asked_for().left, ElementsAre(HasSubstr("no such value")));
  EXPECT_FALSE(asked_for().finished);
  write_file(one_, "powersave");  // another program does it
  EXPECT_THAT(asked_for().left, ElementsAre(HasSubstr("another program")));
  EXPECT_TRUE(asked_for().finished);
}

TEST_F(Settings, ChangedByAnotherAreLeft) {
  Victim victim(
      [&](Journal& journal) {
        journal.change(governor, one_, "performance");
        journal.change(governor, two_, "made");
        return "changed";
      },
      settings);
  victim.kill_9();
  write_file(one_, "ondemand");
  EXPECT_THAT(revert_abandoned(settings),
              ElementsAre(StartsWith("removed"), AllOf(StartsWith("left"), HasSubstr(one_),
                                                       HasSubstr("before that it was powersave"))));
  EXPECT_EQ(read_file(one_), "ondemand");
}

TEST_F(Settings, SettingsOfAnotherNetworkNamespaceAreKept) {
  const auto change = [&](Journal& journal) {
    journal.change(governor, two_, "made");
    journal.change(qdisc, one_, "fq");
    return "changed";
  };
  Victim victim(change, settings);
  ASSERT_EQ(victim.said(), "changed");
  victim.kill_9();
  in_child([&] {
    if (unshare(CLONE_NEWNET) != 0) GTEST_SKIP() << "no network namespace may be made";
    EXPECT_THAT(revert_abandoned(settings), ElementsAre(StartsWith("removed"), HasSubstr("not visible")));
    EXPECT_THAT(revert_abandoned(settings), IsEmpty()) << "one is done, the other was told";
    EXPECT_FALSE(fs::exists(two_));
    EXPECT_EQ(read_file(one_), "fq");
    write_file(two_, "made");  // by another process
  });
  EXPECT_THAT(revert_abandoned(settings), ::testing::Contains(HasSubstr(one_ + " back to powersave")));
  EXPECT_EQ(read_file(one_), "powersave");
}

// One that `ip netns` knows can be entered from outside.
class InNamespace : public Settings {
 protected:
  void SetUp() override {
    Settings::SetUp();
    if (!test::has_own_run) GTEST_SKIP() << "needs root";
  }
  std::string change(Journal& journal) const {
    add_namespace(journal, "ontime-a");
    within_namespace("ontime-a", [&] { journal.change(qdisc, one_, "fq"); });
    return "changed";
  }
};

TEST_F(InNamespace, TheyAreTakenBackFromOutside) {
  Victim victim([&](Journal& journal) { return change(journal); }, settings);
  ASSERT_EQ(victim.said(), "changed");
  victim.kill_9();
  EXPECT_THAT(revert_abandoned(settings),
              ElementsAre(HasSubstr(one_ + " back to powersave"), HasSubstr("namespace ontime-a")));
  EXPECT_EQ(read_file(one_), "powersave");
}

TEST_F(InNamespace, TheyWentWithIt) {
  Victim victim([&](Journal& journal) { return change(journal); }, settings);
  victim.kill_9();
  umount2(namespace_path("ontime-a").c_str(), MNT_DETACH);
  fs::remove(namespace_path("ontime-a"));
  EXPECT_THAT(revert_abandoned(settings), IsEmpty());
  EXPECT_EQ(read_file(one_), "fq") << "it was another's, of that name";
}

TEST_F(InNamespace, AnActionIsThereAndItsErrorIsHere) {
  Journal journal;
  add_namespace(journal, "ontime-a");
  std::string there, here = place(Scope::network_namespace);
  within_namespace("ontime-a", [&] {
    there = place(Scope::network_namespace);
    EXPECT_TRUE(fs::exists("/sys/class/net/lo"));
    EXPECT_FALSE(fs::exists("/sys/class/net/eth0"));
  });
  EXPECT_NE(there, here);
  EXPECT_EQ(place(Scope::network_namespace), here);
  EXPECT_EQ(error_of([] { within_namespace("ontime-a", [] { throw Error("so it is"); }); }), "so it is");
  for (const auto* name : {"ontime-b", "../netns/ontime-a", ".."})
    EXPECT_THAT(error_of([&] { within_namespace(name, [] {}); }), HasSubstr("entered")) << name;
}

TEST_F(Settings, KeptInUntrustedJournalAreIgnored) {
  const auto path =
      plant(text_of_all({boot_id(), 7, "ontime"}, {{"governor", "", one_, "performance", "powersave"}}),
            "0000000000000001-00000001.kept");
  EXPECT_THAT(kept(settings), SizeIs(1));
  fs::permissions(path, fs::perms::all);
  EXPECT_THAT(error_of([] { kept(settings); }), HasSubstr("not trusted"));
  Journal journal(settings);
  const auto given_back = journal.revert_kept();
  EXPECT_FALSE(given_back.finished);
  EXPECT_THAT(given_back.left, ElementsAre(HasSubstr("not trusted")));
  EXPECT_EQ(read_file(one_), "powersave");
  EXPECT_THAT(journal.revert(), IsEmpty());
  unplant(path);
}

TEST_F(Settings, GoneSettingsRaiseNoError) {
  Journal journal(settings);
  journal.change(governor, one_, "performance");
  fs::remove(one_);
  EXPECT_THAT(journal.revert(), IsEmpty());
  EXPECT_FALSE(fs::exists(one_));
}

TEST_F(Settings, SettingsLostByARebootAreNotUndone) {
  const auto path = (folder_ / "ontime-journal-test-0123456789abcdef").string();
  fs::create_directory(path);
  plant(text_of_all({"an earlier boot", 7, "ontime"},
                    {{"governor", "", one_, "performance", "powersave"},
                     {"qdisc", "gone", one_, "fq", "powersave"},
                     {"file", "", two_, {}, "made"},
                     {"directory", "gone", path, {}, directory_kind.read(path)}}));
  write_file(two_, "made");
  EXPECT_THAT(revert_abandoned(settings), ElementsAre(HasSubstr("directory"), HasSubstr(two_)));
  EXPECT_EQ(read_file(one_), "powersave") << "it is so by itself";
  EXPECT_FALSE(fs::exists(two_) || fs::exists(path));
}

TEST_F(Settings, SettingsOfAnUnnamedBootAreRestored) {
  plant(text_of_all({"", 7, "ontime"}, {{"governor", "", one_, "performance", "powersave"}}));
  EXPECT_THAT(revert_abandoned(settings), ElementsAre(HasSubstr(one_)));
  EXPECT_EQ(read_file(one_), "performance");
}

TEST_F(Settings, AreTakenBackFromTheLatestJournalOn) {
  const Header dead{boot_id(), 7, "ontime"};
  plant(text_of_all(dead, {{"governor", "", one_, "powersave", "ondemand"}}),
        "0000000000000001-f0000000.journal");
  plant(text_of_all(dead, {{"governor", "", one_, "ondemand", "performance"}}),
        "0000000000000002-00000000.journal");
  write_file(one_, "performance");
  EXPECT_THAT(revert_abandoned(settings), SizeIs(2));
  EXPECT_EQ(read_file(one_), "powersave");
}

TEST_F(Settings, AbandonedJournalIsRestoredBeforeTheFirstChange) {
  plant(text_of_all({boot_id(), 7, "ontime"}, {{"governor", "", one_, "powersave", "performance"}}));
  write_file(one_, "performance");
  {
    Journal journal(settings);
    journal.change(governor, one_, "ondemand");
    EXPECT_THAT(revert_abandoned(settings), IsEmpty());
  }
  EXPECT_EQ(read_file(one_), "powersave");
}

TEST_F(Settings, RootSettingsNeedRootEvenWithCapabilities) {
  if (geteuid() != 0) GTEST_SKIP() << "needs root";
  in_child([&] {
    fs::permissions(folder_, fs::perms::all);
    fs::permissions(one_, fs::perms::all);
    const auto own = folder_ / "run";
    fs::create_directory(own);
    ASSERT_EQ(chown(own.c_str(), 65534, 65534), 0);
    test::become_ordinary_user();
    set("XDG_RUNTIME_DIR", own);
    Journal journal(settings);
    EXPECT_THAT(error_of([&] { journal.change(settings[3], one_, "x"); }), HasSubstr("run as root"));
    const auto path = plant(text_of_all({boot_id(), 7, ""}, {{"privilege", "", one_, "mine", "powersave"}}));
    EXPECT_THAT(revert_abandoned(settings), ElementsAre(HasSubstr("this user")));
    EXPECT_EQ(read_file(one_), "powersave");
    unplant(path);
  });
}

TEST_F(Settings, UnknownKindIsALogicError) {
  Journal journal;
  EXPECT_THROW(journal.change(governor, one_, "performance"), std::logic_error);
}

// As on a robot whose clock is set by the network.
TEST_F(Settings, KeptBeforeTheClockWasSetBackAreUndoneLast) {
  const auto before =
      plant(text_of_all({boot_id(), 7, "ontime"}, {{"governor", "", one_, "powersave", "ondemand"}}),
            "7f00000000000001-00000001.kept");
  write_file(one_, "ondemand");
  Journal journal(settings);
  journal.change(governor, one_, "performance");
  journal.keep();
  EXPECT_THAT(journal.revert_kept().left, IsEmpty());
  EXPECT_EQ(read_file(one_), "powersave");
  EXPECT_FALSE(fs::exists(before));
}

TEST_F(Settings, AreRestoredWithoutTheirFolder) {
  {
    Journal journal(settings);
    journal.change(governor, one_, "performance");
    fs::remove_all(folder_path());  // by another program: only this process can restore them
    EXPECT_THAT(error_of([&] { journal.change(governor, two_, "made"); }),
                AllOf(HasSubstr("removed by another"), HasSubstr("changes nothing")));
    EXPECT_FALSE(fs::exists(two_));
    EXPECT_THAT(journal.revert(), IsEmpty());
  }
  EXPECT_EQ(read_file(one_), "powersave");
  EXPECT_TRUE(there_is_no_folder());
}

TEST_F(Settings, AreRestoredWhileAStoppedOntimeLocksTheFolder) {
  Journal journal(settings);
  journal.change(governor, one_, "performance");
  {
    const auto locked = Folder::make();
    EXPECT_THAT(journal.revert(), IsEmpty());
    EXPECT_EQ(read_file(one_), "powersave");
  }
  EXPECT_THAT(revert_abandoned(settings), IsEmpty());
}

}  // namespace
}  // namespace ontime::journal

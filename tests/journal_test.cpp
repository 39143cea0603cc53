// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <chrono>
#include <fstream>
#include <random>
#include <thread>

#include <sys/resource.h>
#include <sys/stat.h>

#include "journal_fixture.hpp"

namespace ontime::journal {
namespace {

using test::error_of;
using test::in_child;
using test::set;
using test::start_child;
using test::status_of;
using test::Victim;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;
using ::testing::StartsWith;

[[maybe_unused]] const auto* const own_run = ::testing::AddGlobalTestEnvironment(new test::OwnRun);

// --- the text of a journal

TEST(Format, CutAnywhereItHoldsTheChangesWrittenToTheirEnd) {
  std::mt19937 random(2);
  const auto some = [&] { return "/a b/\n\t\"\\ü" + std::to_string(random()); };
  const auto value = [&] { return random() % 3 == 0 ? Value() : Value(some()); };
  const Header header{"boot", 4711, "ontime run \"a\" \n"};
  for (int round = 0; round < 10; ++round) {
    std::vector<Entry> entries;
    std::vector<std::size_t> ends;
    auto text = line_of(header);
    for (int i = 0; i < 5; ++i) {
      entries.push_back({some(), some(), some(), value(), value()});
      text += line_of(entries.back());
      ends.push_back(text.size());
    }
    for (std::size_t length = line_of(header).size(); length <= text.size(); ++length) {
      const auto whole =
          std::count_if(ends.begin(), ends.end(), [&](std::size_t end) { return end <= length; });
      const auto contents = parse(text.substr(0, length));
      EXPECT_EQ(contents.header, header);
      EXPECT_EQ(contents.not_understood, "");
      EXPECT_EQ(contents.entries, std::vector(entries.begin(), entries.begin() + whole));
    }
  }
}

TEST(Format, LaterIdentityBelongsToItsEntry) {
  const auto contents = parse(text_of_all({}, {{"a", "", "x", {}, to_be_made}, {"b", "", "y", {}, "1"}}) +
                              line_of_identity(0, "7:8") + line_of_done(1));
  EXPECT_EQ(contents.entries, (std::vector<Entry>{{"a", "", "x", {}, "7:8"}, {"b", "", "y", {}, "1", true}}));
}

TEST(Format, UnknownLineRejectsTheWholeFile) {
  const auto header = line_of(Header{});
  const auto entry = line_of(Entry{"a", "", "x", {}, "1"});
  for (const std::string& text :
       {std::string("\n"), std::string("directory /home\n"), entry, "[]\n" + entry, header + "\n",
        header + header, header + line_of_done(0), header + entry + line_of_done(1),
        header + entry + "{\"change\":-1,\"done\":true}\n", header + entry + "{\"change\":0}\n",
        header + entry + "{\"change\":0,\"done\":false}\n",
        header + entry + "{\"change\":0,\"after\":null}\n", header + "{\"kind\":\"a\"}\n",
        header + "{\"kind\":1,\"where\":\"\",\"what\":\"\",\"before\":null,\"after\":null}\n",
        header + "{\"kind\":\"a\",\"where\":\"\",\"what\":\"\",\"before\":1,\"after\":null}\n",
        std::string("{\"journal\":2,\"boot\":\"\",\"pid\":1,\"command\":\"\"}\n"),
        std::string("{\"journal\":1,\"boot\":\"\",\"pid\":-1,\"command\":\"\"}\n"),
        std::string("{\"journal\":1,\"boot\":\"\",\"pid\":99999999999,\"command\":\"\"}\n")})
    EXPECT_NE(parse(text).not_understood, "") << text;
  for (const auto* text : {"", "{", "not written to its end"}) {
    EXPECT_EQ(parse(text).not_understood, "");
    EXPECT_THAT(parse(text).entries, IsEmpty());
  }
}

TEST(Format, AnyBytesCanBeRead) {
  std::mt19937 random(4);
  const auto good = text_of_all({"b", 1, "c"}, {{"directory", "1:2", "/tmp/x", {}, "3:4"}}) + line_of_done(0);
  for (int round = 0; round < 2000; ++round) {
    auto text = round % 2 == 0 ? good : std::string(random() % 80, '\n');
    for (auto changes = random() % 6; changes > 0 && !text.empty(); --changes)
      text[random() % text.size()] = static_cast<char>(random() % 256);
    const auto contents = parse(text);
    for (const unsigned char c : contents.not_understood) EXPECT_TRUE(c >= ' ' && c != 0x7f);
    EXPECT_LE(contents.not_understood.size(), 700u);
  }
  for (const auto* piece : {"[", "{\"a\":", "{\"a\":[", "\"", "\\"}) {
    std::string deep;
    while (deep.size() < std::size_t{1} << 16) deep += piece;
    EXPECT_NE(parse(deep + "\n").not_understood, "");
    EXPECT_NE(parse(line_of(Header{}) + deep + "\n").not_understood, "");
  }
}

// --- what may ever be touched

TEST(Kinds, AFolderIsOneOfOurOwnMaking) {
  const std::string random = "-0123456789abcdef";
  EXPECT_TRUE(directory_kind.accepts("/tmp/ontime-stress" + random));
  EXPECT_TRUE(directory_kind.accepts("/a b/ü/ontime-a-b" + random));
  for (const auto& path :
       {std::string(""), std::string("/"), std::string("/home/robot"), std::string("/tmp/ontime-stress"),
        "tmp/ontime-stress" + random, "/tmp/../ontime-stress" + random, "/tmp/./ontime-stress" + random,
        "/tmp/ontime-stress" + random + "/", "/tmp/ontime-stress" + random + "/..", "/tmp/ontime" + random,
        "/tmp/stress" + random, "/tmp/ontime-" + random, "/tmp/ontime-Stress" + random,
        "/tmp/ontime-stress" + random + "0", std::string("/tmp/ontime-stress-0123456789abcdeX")})
    EXPECT_FALSE(directory_kind.accepts(path)) << path;
}

TEST(Kinds, ANamespaceIsOneOfOurOwnNames) {
  EXPECT_TRUE(namespace_kind.accepts("ontime-controller"));
  for (const auto* name :
       {"", "controller", "ontime-", "ontime-a/b", "ontime-../x", "ontime-A", "ontime-a b", "xontime-a"})
    EXPECT_FALSE(namespace_kind.accepts(name)) << name;
}

// --- taking back

TEST_F(Journals, AFolderGoesWithItsContents) {
  std::string one, two;
  {
    Journal journal;
    one = make_folder(journal);
    two = make_folder(journal);
    EXPECT_NE(one, two);
    struct stat found {};
    ASSERT_EQ(stat(one.c_str(), &found), 0);
    EXPECT_EQ(found.st_mode & 0777U, 0700U);
    EXPECT_THAT(revert_abandoned(), IsEmpty()) << "its owner lives";
    EXPECT_TRUE(fs::exists(one) && fs::exists(two));
  }
  EXPECT_FALSE(fs::exists(one) || fs::exists(two));
}

TEST_F(Journals, CanBeRevertedAgainAndUsedAfterwards) {
  Journal journal;
  EXPECT_THAT(journal.revert(), IsEmpty());
  const auto one = make_folder(journal);
  EXPECT_THAT(journal.revert(), IsEmpty());
  EXPECT_FALSE(fs::exists(one));
  EXPECT_TRUE(there_is_no_folder());
  EXPECT_THAT(journal.revert(), IsEmpty());
  const auto two = make_folder(journal);
  fs::remove_all(two);  // another process was quicker
  EXPECT_THAT(journal.revert(), IsEmpty());
}

TEST_F(Journals, LinksAreNotFollowed) {
  Journal outer;
  const auto kept = make_folder(outer);
  const auto inside = make_folder(outer);
  fs::create_symlink(kept, inside + "/link");
  directory_kind.write(inside, {}, directory_kind.read(inside));
  EXPECT_FALSE(fs::exists(inside));
  EXPECT_TRUE(fs::exists(kept + "/in/side/file"));
}

TEST_F(Journals, FoldersFromBeforeABootAreForgottenAndNothingElseIs) {
  in_child([] {
    std::string outer_name = fs::temp_directory_path() / "ontime-forgotten-XXXXXX";
    ASSERT_NE(mkdtemp(outer_name.data()), nullptr);
    const fs::path outer = outer_name;
    set("TMPDIR", outer.c_str());
    const auto own = outer / "ontime-stress-0123456789abcdef", link = outer / "ontime-lab-0123456789abcdef";
    fs::create_directory(own);
    fs::create_directory(outer / "ontime-stress");
    fs::create_directory(outer / "stress-0123456789abcdef");
    fs::create_symlink(own, link);
    write_file(outer / "ontime-file-0123456789abcdef", "");
    const auto now = std::time(nullptr);
    EXPECT_THAT(forgotten_directories(now + 10), ElementsAre(own.string()));
    EXPECT_THAT(forgotten_directories(now - 1000), IsEmpty()) << "it was made since";
    EXPECT_THAT(forgotten_directories(time_of_boot()), IsEmpty());
    if (geteuid() == 0) {
      EXPECT_EQ(chown(own.c_str(), 65534, 65534), 0);
      EXPECT_THAT(forgotten_directories(now + 10), IsEmpty()) << "it is another user's";
    }
    fs::remove(own);
    Journal living;
    make_folder(living);
    EXPECT_THAT(forgotten_directories(now + 1000), IsEmpty()) << "a journal names it";
    EXPECT_THAT(living.revert(), IsEmpty());
    fs::remove_all(outer);
  });
  EXPECT_GT(time_of_boot(), 0);
}

TEST_F(Journals, BadNamesAreRefusedAndLeaveNothing) {
  Journal journal;
  for (const auto* name : {"", ".", "..", "a/b", "../a", "/tmp/a", "a b", "a\nb", "-a", "a\x7f", "A"}) {
    EXPECT_NE(error_of([&] { add_directory(journal, name); }), "") << name;
    EXPECT_NE(error_of([&] { add_namespace(journal, name); }), "") << name;
    EXPECT_TRUE(there_is_no_folder());
  }
}

TEST_F(Journals, NoTemporaryFolderIsAnError) {
  in_child([] {
    set("TMPDIR", "/there/is/none");
    Journal journal;
    EXPECT_THAT(error_of([&] { add_directory(journal, "a"); }), HasSubstr("TMPDIR"));
  });
}

// As after an upgrade of what "current" leads to.
TEST_F(Journals, AFolderIsFoundAgainWhereverALinkLeadsByThen) {
  in_child([] {
    std::string outer_name = fs::temp_directory_path() / "ontime-linked-XXXXXX";
    ASSERT_NE(mkdtemp(outer_name.data()), nullptr);
    const fs::path outer = outer_name;
    for (const auto* name : {"one", "two"}) fs::create_directory(outer / name);
    fs::create_symlink("one", outer / "link");
    set("TMPDIR", outer / "two/../link/");
    Journal journal;
    make_folder(journal);
    fs::remove(outer / "link");
    fs::create_symlink("two", outer / "link");
    EXPECT_THAT(journal.revert(), IsEmpty());
    EXPECT_TRUE(fs::is_empty(outer / "one"));
    fs::remove_all(outer);
  });
}

TEST_F(Journals, WithoutAJournalNothingIsChanged) {
  in_child([] {
    Journal journal;
    const auto folder = fs::temp_directory_path() / ("ontime-journal-test-" + std::to_string(getpid()));
    fs::create_directory(folder);
    set("TMPDIR", folder.string());
    signal(SIGXFSZ, SIG_IGN);
    for (const rlim_t bytes : {0, 200}) {  // no journal at all; none but for its first line
      const rlimit limit{bytes, RLIM_INFINITY};
      ASSERT_EQ(setrlimit(RLIMIT_FSIZE, &limit), 0);
      EXPECT_THAT(error_of([&] { add_directory(journal, "a"); }), HasSubstr("without a journal"));
      EXPECT_TRUE(fs::is_empty(folder));
    }
    fs::remove(folder);
  });
}

TEST_F(Journals, ChangesOfAKilledProcessAreUndone) {
  Victim victim([](Journal& journal) { return make_folder(journal); });
  ASSERT_TRUE(fs::exists(victim.said()));
  EXPECT_THAT(revert_abandoned(), IsEmpty()) << "it lives";
  victim.kill_9();
  EXPECT_THAT(revert_abandoned(),
              ElementsAre(AllOf(HasSubstr(victim.said()), HasSubstr(std::to_string(victim.pid())))))
      << "not yet waited for, but gone";
  EXPECT_FALSE(fs::exists(victim.said()));
}

TEST_F(Journals, AForkedChildOwnsNothing) {
  Journal journal;
  const auto path = make_folder(journal);
  in_child([&] {
    EXPECT_THAT(error_of([&] { make_folder(journal); }), HasSubstr(std::to_string(getppid())));
    EXPECT_THAT(journal.revert(), IsEmpty());
    EXPECT_TRUE(fs::exists(path));
    EXPECT_THAT(revert_abandoned(), IsEmpty());
  });
  EXPECT_TRUE(fs::exists(path));
  EXPECT_THAT(revert_abandoned(), IsEmpty());
  EXPECT_TRUE(fs::exists(path)) << "the child's end has not ended our hold";
}

TEST_F(Journals, AChildThatIsAnotherProgramKeepsNothing) {
  std::array<int, 2> hold;
  ASSERT_EQ(pipe2(hold.data(), O_CLOEXEC), 0);
  Victim victim([&](Journal& journal) {
    auto path = make_folder(journal);
    if (fork() == 0) {
      dup2(hold[0], STDIN_FILENO);
      execlp("cat", "cat", nullptr);  // lives as long as the test wants
    }
    // It must have become another program.
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
    return path;
  });
  while (true) {
    std::ifstream status("/proc/" + std::to_string(victim.pid()) + "/task/" + std::to_string(victim.pid()) +
                         "/children");
    std::string child;
    if (!(status >> child) || read_file("/proc/" + child + "/comm") == "cat\n") break;
  }
  victim.kill_9();
  victim.wait();
  EXPECT_THAT(revert_abandoned(), SizeIs(1));
  EXPECT_FALSE(fs::exists(victim.said()));
  close(hold[0]);
  close(hold[1]);
}

TEST_F(Journals, AHalfWrittenLineIsNoChange) {
  Journal outer;
  Victim victim([&](Journal& journal) {
    auto path = make_folder(journal);
    auto line = line_of(Entry{"directory", place(Scope::mount_namespace), path + "x", {}, "1:1"});
    line.pop_back();
    std::ofstream(journals().at(0), std::ios::app) << line;
    return path;
  });
  victim.kill_9();
  EXPECT_THAT(revert_abandoned(), ElementsAre(HasSubstr(victim.said())));
}

TEST_F(Journals, KilledAtAnyInstantNothingStays) {
  std::mt19937 random(3);
  const auto folder = fs::temp_directory_path() / ("ontime-journal-test-" + std::to_string(getpid()));
  fs::create_directory(folder);
  for (int round = 0; round < 40; ++round) {
    const pid_t child = start_child([&] {
      set("TMPDIR", folder.string());
      for (;;) {
        Journal journal;
        make_folder(journal);
        make_folder(journal);
      }
    });
    std::this_thread::sleep_for(std::chrono::microseconds(random() % 5000));
    kill(child, SIGKILL);
    waitpid(child, nullptr, 0);
    revert_abandoned();
    EXPECT_TRUE(fs::is_empty(folder));
    EXPECT_TRUE(there_is_no_folder());
  }
  fs::remove_all(folder);
}

TEST_F(Journals, FolderWithoutIdentityIsRemovedOnlyIfEmpty) {
  const auto path = (fs::temp_directory_path() / "ontime-journal-test-0123456789abcdef").string();
  const auto text = text_of_all({boot_id(), 1, "ontime"},
                                {{"directory", place(Scope::mount_namespace), path, {}, to_be_made}});
  fs::create_directory(path);
  plant(text);
  EXPECT_THAT(revert_abandoned(), ElementsAre(StartsWith("removed directory " + path)));
  EXPECT_FALSE(fs::exists(path));
  fs::create_directory(path);
  write_file(path + "/somebody's", "text");
  const auto planted = plant(text);
  EXPECT_THAT(revert_abandoned(), ElementsAre(HasSubstr("cannot be removed")));
  EXPECT_TRUE(fs::exists(path + "/somebody's"));
  unplant(planted);
  fs::remove_all(path);
}

TEST_F(Journals, AFolderOfTheSameNameIsNotTheSame) {
  Victim victim([&](Journal& journal) { return add_directory(journal, "journal-test"); });
  victim.kill_9();
  const auto aside = victim.said() + "x";
  fs::rename(victim.said(), aside);
  fs::create_directory(victim.said());
  write_file(victim.said() + "/somebody's", "text");
  EXPECT_THAT(revert_abandoned(), ElementsAre(HasSubstr("another program has changed it")));
  EXPECT_TRUE(fs::exists(victim.said() + "/somebody's"));
  fs::remove_all(victim.said());
  fs::remove_all(aside);
}

TEST_F(Journals, TwoThatRevertAtOnceDoItOnce) {
  for (int round = 0; round < 20; ++round) {
    Victim victim([](Journal& journal) { return make_folder(journal) + "," + make_folder(journal); });
    victim.kill_9();
    std::array<int, 2> start;
    ASSERT_EQ(pipe2(start.data(), O_CLOEXEC), 0);
    std::array<pid_t, 2> reverters{};
    for (auto& reverter : reverters)
      reverter = start_child([&] {
        close(start[1]);
        char end = 0;
        (void)!read(start[0], &end, 1);  // both wait for the pipe to close
        const auto lines = revert_abandoned();
        const auto comma = victim.said().find(',');
        // Whichever returns, all is gone; one of them says what was done.
        EXPECT_FALSE(fs::exists(victim.said().substr(0, comma)) ||
                     fs::exists(victim.said().substr(comma + 1)));
        _exit(::testing::Test::HasFailure() ? 100 : static_cast<int>(lines.size()));
      });
    close(start[0]);
    close(start[1]);
    int told = 0;
    for (const pid_t child : reverters) told += status_of(child);
    EXPECT_EQ(told, 2);
  }
}

TEST_F(Journals, UnknownJournalIsReportedOnceAndKept) {
  for (const auto& text :
       {std::string("directory /home\n"), line_of(Header{boot_id(), 7, "ontime tune"}) + "what next\n",
        text_of_all({boot_id(), 7, "ontime tune"}, {{"governor", "", "cpu0", "powersave", "performance"}}),
        text_of_all({boot_id(), 7, "ontime"},
                    {{"directory", place(Scope::mount_namespace), "/home", {}, "1:1"}})}) {
    const auto path = plant(text);
    EXPECT_THAT(revert_abandoned(), ElementsAre(HasSubstr(path.string())));
    EXPECT_THAT(revert_abandoned(), IsEmpty()) << "it was told";
    EXPECT_EQ(read_file(path), text);
    unplant(path);
  }
}

TEST_F(Journals, GarbageHarmsNothing) {
  std::mt19937 random(4);
  for (int round = 0; round < 300; ++round) {
    std::string text;
    for (auto length = random() % 60; length > 0; --length)
      text += random() % 8 == 0 ? (random() % 2 == 0 ? '\n' : ' ') : static_cast<char>(random() % 256);
    const auto path = plant(text);
    EXPECT_THAT(revert_abandoned(), SizeIs(parse(text).not_understood.empty() ? 0 : 1));
    if (fs::exists(path)) unplant(path);
  }
}

}  // namespace
}  // namespace ontime::journal

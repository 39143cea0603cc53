// SPDX-License-Identifier: Apache-2.0
// A machine that has run out of something: room on a disk, open files.
#include <csignal>

#include <fcntl.h>
#include <sched.h>
#include <sys/mount.h>
#include <sys/resource.h>

#include "journal_setting.hpp"

namespace ontime::journal {
namespace {

using test::error_of;
using test::in_child;
using ::testing::AllOf;
using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::SizeIs;

class Lacks : public Settings {
 protected:
  // Applied by an ontime that ended, in a /run of a page for that and no more.
  void apply_on_small_disk() {
    ASSERT_EQ(unshare(CLONE_NEWNS), 0);
    ASSERT_EQ(mount("none", "/run", "tmpfs", 0, "size=4k"), 0);
    Journal journal(settings);
    journal.change(governor, one_, "performance");
    journal.keep();
  }
  static void limit(int resource, rlim_t most) {
    rlimit now{};
    ASSERT_EQ(getrlimit(resource, &now), 0);
    now.rlim_cur = most;
    ASSERT_EQ(setrlimit(resource, &now), 0);
  }
};

TEST_F(Lacks, AppliedIsRevertedOnAFullDisk) {
  if (!test::has_own_run) GTEST_SKIP() << "needs root";
  in_child([&] {
    apply_on_small_disk();
    EXPECT_THAT(error_of([&] { Journal(settings).change(governor, one_, "ondemand"); }),
                AllOf(HasSubstr("No space left"), HasSubstr(folder_path())));
    EXPECT_THAT(kept(settings), SizeIs(1));
    const auto given_back = Journal(settings).revert_kept();
    EXPECT_THAT(given_back.done, ElementsAre(HasSubstr(one_ + " back to powersave")));
    EXPECT_THAT(given_back.left, IsEmpty());
    EXPECT_EQ(read_file(one_), "powersave");
    EXPECT_TRUE(there_is_no_folder());
  });
}

TEST_F(Lacks, AppliedIsRevertedOnAReadOnlyDisk) {
  if (!test::has_own_run) GTEST_SKIP() << "needs root";
  in_child([&] {
    apply_on_small_disk();
    ASSERT_EQ(mount("none", "/run", nullptr, MS_REMOUNT | MS_RDONLY, nullptr), 0);
    EXPECT_THAT(kept(settings), SizeIs(1));
    EXPECT_THAT(Journal(settings).revert_kept().done, ElementsAre(HasSubstr(one_ + " back to powersave")));
    EXPECT_EQ(read_file(one_), "powersave");
    EXPECT_THAT(Journal(settings).revert_kept().done, IsEmpty());
  });
}

TEST_F(Lacks, ADiskThatTakesAPartOfAChangeIsNamedAsFull) {
  in_child([&] {
    signal(SIGXFSZ, SIG_IGN);
    Journal journal(settings);
    journal.hold();
    const auto size = fs::file_size(journals().at(0));
    limit(RLIMIT_FSIZE, size + 10);
    EXPECT_THAT(error_of([&] { journal.change(governor, one_, "performance"); }),
                AllOf(HasSubstr("File too large"), Not(HasSubstr("Success"))));
    EXPECT_EQ(fs::file_size(journals().at(0)), size);
    EXPECT_EQ(read_file(one_), "powersave");
  });
}

// What cannot be looked at is not taken for gone.
TEST_F(Lacks, WhereNoFileCanBeOpenedAnErrorIsToldAndNoLackOfJournals) {
  in_child([&] {
    const auto path =
        plant(text_of_all({boot_id(), 7, "ontime"}, {{"governor", "", one_, "performance", "powersave"}}),
              "0000000000000001-00000001.kept");
    if (test::has_own_run) {
      fs::create_directory("/run/netns");
      write_file("/run/netns/one", "");
    }
    {
      const auto folder = Folder::make();
      rlimit before{};
      ASSERT_EQ(getrlimit(RLIMIT_NOFILE, &before), 0);
      const auto next = static_cast<rlim_t>(Fd(open("/", O_PATH | O_CLOEXEC)).get());
      // Of types that it does not know yet, the undefined-behaviour sanitizer opens a pipe to look at them.
      EXPECT_THAT(error_of([] { throw cannot("x", EMFILE); }), HasSubstr("Too many open files"));
      place(Scope::network_namespace);
      namespace_name("");  // finds the file
      std::vector<std::string> told;
      limit(RLIMIT_NOFILE, next);
      told.push_back(error_of([&] { folder.kept(); }));
      told.push_back(folder.open(path.filename()).not_used);
      told.push_back(error_of([] { Folder::find(); }));
      told.push_back(error_of([] { namespace_name("of another"); }));
      limit(RLIMIT_NOFILE, next + 1);
      if (test::has_own_run) {  // only root can ask for the namespace's cookie
        told.push_back(error_of([] { place(Scope::network_namespace); }));
        told.push_back(error_of([] { namespace_name("of another"); }));
      }
      limit(RLIMIT_NOFILE, before.rlim_cur);
      EXPECT_THAT(told, Each(AllOf(HasSubstr("Too many open files"), Not(HasSubstr("remove it")))));
    }
    unplant(path);
    if (test::has_own_run) fs::remove("/run/netns/one");
  });
}

}  // namespace
}  // namespace ontime::journal

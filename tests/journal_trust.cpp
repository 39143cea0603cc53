// SPDX-License-Identifier: Apache-2.0
// Which journals are believed.
#include <utility>

#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>

#include "journal_fixture.hpp"

namespace ontime::journal {
namespace {

using test::error_of;
using test::in_child;
using test::set;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

// --- whom to believe

constexpr uid_t planter = 1234;

class Planted : public Journals {
 protected:
  void SetUp() override {
    victim_ = fs::temp_directory_path() / "ontime-journal-test-0123456789abcdef";
    fs::create_directory(victim_);
    write_file(victim_ / "file", "text");
    // Everything is right but who says it; once more as the first journals were written.
    plant(text_of_all({boot_id(), 7, "ontime"}, {{"directory",
                                                  place(Scope::mount_namespace),
                                                  victim_.string(),
                                                  {},
                                                  directory_kind.read(victim_.string())}}));
    plant("directory " + victim_.string() + "\n", "1073741824-1-0.journal");
  }
  void TearDown() override {
    EXPECT_TRUE(fs::exists(victim_ / "file"));
    fs::remove_all(victim_);
    fs::remove_all(folder_path());
    fs::remove_all(aside(""));
    Journals::TearDown();
  }
  // On the same file system.
  static fs::path aside(const fs::path& path) {
    const auto folder = fs::path(folder_path()).parent_path() / "aside";
    fs::create_directory(folder);
    return folder / path.filename();
  }
  static void expect_all_refused(const std::string& why) {
    EXPECT_THAT(revert_abandoned(), ::testing::Each(HasSubstr(why)));
  }

  fs::path victim_;
};

TEST_F(Planted, FilesOfAnotherUserAreNotTrusted) {
  if (geteuid() != 0) GTEST_SKIP() << "needs root";
  for (const auto& path : journals()) ASSERT_EQ(chown(path.c_str(), planter, planter), 0);
  const auto lines = revert_abandoned();
  EXPECT_THAT(lines, SizeIs(2));
  EXPECT_THAT(lines, ::testing::Each(HasSubstr("belongs to user 1234")));
  EXPECT_THAT(revert_abandoned(), IsEmpty()) << "it was told";
}

TEST_F(Planted, FilesWritableByOthersAreNotTrusted) {
  for (const auto& path : journals()) fs::permissions(path, fs::perms::group_write, fs::perm_options::add);
  expect_all_refused("others may write to it");
}

TEST_F(Planted, HardLinkedFilesAreNotTrusted) {
  for (const auto& path : journals()) fs::create_hard_link(path, aside(path));
  expect_all_refused("more than one name");
}

TEST_F(Planted, LinksAreNotBelieved) {
  for (const auto& path : journals()) {
    fs::rename(path, aside(path));
    fs::create_symlink(aside(path), path);
  }
  expect_all_refused("not a file");
}

TEST_F(Planted, OtherFilesAreNotOpened) {
  for (const auto& path : journals()) fs::remove(path);
  const fs::path folder = folder_path();
  ASSERT_EQ(mkfifo((folder / "0.journal").c_str(), 0600), 0);  // a reader waits for a writer
  ASSERT_EQ(mkfifo((folder / "1073741824-1-0.journal").c_str(), 0600), 0);
  fs::create_directory(folder / "1.journal");
  const int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  (folder / "2.journal").string().copy(address.sun_path, sizeof address.sun_path - 1);
  ASSERT_EQ(bind(fd, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
  expect_all_refused("not a file");
  close(fd);
}

TEST_F(Planted, EndlessJournalIsNotRead) {
  for (const auto& path : journals()) fs::resize_file(path, std::uintmax_t{1} << 40);
  expect_all_refused("larger than any journal");
}

TEST_F(Planted, FolderWritableByOthersIsNotTrusted) {
  fs::permissions(folder_path(), fs::perms::others_write, fs::perm_options::add);
  EXPECT_THAT(revert_abandoned(),
              ElementsAre(AllOf(HasSubstr(folder_path()), HasSubstr("others may write"))));
  EXPECT_THAT(revert_abandoned(), IsEmpty()) << "it was told";
  Journal journal;
  EXPECT_THAT(error_of([&] { journal.hold(); }), HasSubstr("changes nothing"));
}

TEST_F(Planted, FolderOfAnotherUserIsNotTrusted) {
  if (geteuid() != 0) GTEST_SKIP() << "needs root";
  ASSERT_EQ(chown(folder_path().c_str(), planter, planter), 0);
  EXPECT_THAT(revert_abandoned(), ElementsAre(HasSubstr("belongs to user 1234")));
  Journal journal;
  EXPECT_THAT(error_of([&] { journal.hold(); }), HasSubstr("belongs to user 1234"));
}

TEST_F(Planted, AFolderIsNotLookedForBehindALink) {
  fs::rename(folder_path(), aside("folder"));
  fs::create_symlink(aside("folder"), folder_path());
  EXPECT_THAT(revert_abandoned(), ElementsAre(HasSubstr("not a folder")));
  Journal journal;
  EXPECT_THAT(error_of([&] { journal.hold(); }), HasSubstr("not a folder"));
}

// As it was shown: without root the folder may be one under /tmp, where any user can be first.
TEST_F(Planted, FolderUnderTmpOfAnotherUserIsNotTrusted) {
  if (!test::has_own_run) GTEST_SKIP() << "needs root";
  in_child([&] {
    ASSERT_EQ(unshare(CLONE_NEWNS), 0);
    const auto read_planted = [](const fs::path& path) {
      return std::pair(path.filename(), read_file(path));
    };
    std::vector<std::pair<fs::path, std::string>> planted;
    for (const auto& path : journals()) planted.push_back(read_planted(path));
    ASSERT_EQ(mount("none", "/tmp", "tmpfs", 0, "mode=1777"), 0);
    const auto home = fs::path("/tmp/ontime-journal-test-0123456789abcdef");
    fs::create_directory(home);
    write_file(home / "file", "text");
    ASSERT_EQ(chown(home.c_str(), 65534, 65534), 0);
    const fs::path folder = "/tmp/ontime-65534";
    fs::create_directory(folder);
    for (const auto& [name, text] : planted) write_file(folder / name, text);
    write_file(folder / "1073741824-1-1.journal", "directory " + home.string() + "\n");
    test::become_ordinary_user();
    unsetenv("XDG_RUNTIME_DIR");  // NOLINT(concurrency-mt-unsafe): in a process of its own
    EXPECT_THAT(revert_abandoned(), ElementsAre(HasSubstr("belongs to user 0")));
    EXPECT_TRUE(fs::exists(home / "file"));
    Journal journal;
    EXPECT_THAT(error_of([&] { make_folder(journal); }), HasSubstr("belongs to user 0"));
  });
}

TEST_F(Journals, TheFolderOfAnotherUsersSessionIsNotTaken) {
  if (geteuid() != 0) GTEST_SKIP() << "needs root";
  const auto own = fs::temp_directory_path() / ("ontime-journal-test-" + std::to_string(getpid()));
  fs::create_directory(own);
  in_child([&] {
    test::become_ordinary_user();
    set("XDG_RUNTIME_DIR", own);
    EXPECT_EQ(folder_path(), "/tmp/ontime-65534") << "as after su";
    ASSERT_EQ(seteuid(0), -1);
  });
  fs::remove(own);
}

}  // namespace
}  // namespace ontime::journal

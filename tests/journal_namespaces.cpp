// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <chrono>
#include <cstdlib>
#include <random>
#include <thread>

#include <linux/capability.h>
#include <sys/syscall.h>

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

// --- network namespaces

class Namespaces : public Journals {
 protected:
  void SetUp() override {
    if (!test::has_own_run) GTEST_SKIP() << "needs root";
    if (status_of(start_child([] { _exit(unshare(CLONE_NEWNET) == 0 ? 0 : 1); })) != 0)
      GTEST_SKIP() << "no network namespace may be made";
    if (!succeeds("ip -Version >/dev/null 2>&1")) GTEST_SKIP() << "iproute2 is not installed";
  }
  static bool succeeds(const std::string& command) {
    return std::system(command.c_str()) == 0;  // NOLINT(concurrency-mt-unsafe): there are no threads
  }
  static void ip(const std::string& arguments) { EXPECT_TRUE(succeeds("ip " + arguments)) << arguments; }
  static bool exists() { return fs::exists(namespace_path(name)); }
  static void drop(int capability) {
    __user_cap_header_struct header{_LINUX_CAPABILITY_VERSION_3, 0};
    std::array<__user_cap_data_struct, _LINUX_CAPABILITY_U32S_3> sets{};
    ASSERT_EQ(syscall(SYS_capget, &header, sets.data()), 0);
    sets[0].effective &= ~(1U << static_cast<unsigned>(capability));
    ASSERT_EQ(syscall(SYS_capset, &header, sets.data()), 0);
  }

  static constexpr const char* name = "ontime-test";
  const std::string inside_ = std::string("netns exec ") + name + " ";
};

TEST_F(Namespaces, AreThoseOfIpAndGo) {
  {
    Journal journal;
    add_namespace(journal, name);
    ip(inside_ + "ip link show lo >/dev/null");
    EXPECT_TRUE(succeeds("test \"$(readlink /proc/self/ns/net)\" != \"$(ip " + inside_ +
                         "readlink /proc/self/ns/net)\""));
    EXPECT_THAT(error_of([&] { add_namespace(journal, name); }), HasSubstr("did not make"));
  }
  EXPECT_FALSE(exists());
}

TEST_F(Namespaces, ForeignOneIsLeftAlone) {
  ip(std::string("netns add ") + name);
  {
    Journal journal;
    EXPECT_THAT(error_of([&] { add_namespace(journal, name); }),
                HasSubstr(std::string("sudo ip netns delete ") + name));
    EXPECT_THROW(namespace_kind.write(name, "", {}), MadeByAnother);
  }
  EXPECT_TRUE(exists());
  ip(std::string("netns delete ") + name);
}

TEST(NetworkIdentity, IsOfNetworkNamespacesOnly) {
  const auto identity_of = [](const char* path) {
    const Fd fd(open(path, O_RDONLY | O_CLOEXEC));
    EXPECT_GE(fd.get(), 0) << path;
    return network_identity(fd.get());
  };
  const auto as_this_user = [&] {
    EXPECT_NE(identity_of("/proc/self/ns/net"), "");
    for (const auto* path : {"/proc/self/ns/uts", "/proc/self/ns/mnt", "/proc/self/exe", "/"})
      EXPECT_EQ(identity_of(path), "") << path;
  };
  as_this_user();
  in_child([&] {
    if (geteuid() == 0) test::become_ordinary_user();
    prctl(PR_SET_DUMPABLE, 1);  // else its own /proc is closed to it
    as_this_user();
  });
}

// The kernel gives a new one the inode of the one before.
TEST_F(Namespaces, ReplacedByAnotherIsLeftAlone) {
  Victim victim([](Journal& journal) {
    add_namespace(journal, name);
    return *namespace_kind.read(name);
  });
  victim.kill_9();
  ip(std::string("netns delete ") + name);
  ip(std::string("netns add ") + name);
  const auto somebodys = namespace_kind.read(name);
  ASSERT_NE(somebodys, victim.said());
  EXPECT_THAT(revert_abandoned(), ElementsAre(AllOf(StartsWith("left"), HasSubstr("another program"))));
  EXPECT_EQ(namespace_kind.read(name), somebodys);
  EXPECT_THAT(revert_abandoned(), IsEmpty());
  ip(std::string("netns delete ") + name);
}

TEST_F(Namespaces, KilledAtAnyInstantNothingStays) {
  std::mt19937 random(5);
  for (int round = 0; round < 40; ++round) {
    const pid_t child = start_child([&] {
      for (;;) {
        Journal journal;
        add_namespace(journal, name);
      }
    });
    std::this_thread::sleep_for(std::chrono::microseconds(random() % 20000));
    kill(child, SIGKILL);
    waitpid(child, nullptr, 0);
    revert_abandoned();
    EXPECT_FALSE(exists());
    EXPECT_TRUE(there_is_no_folder());
  }
}

TEST_F(Namespaces, KilledBetweenNameAndNamespaceNothingStays) {
  Victim victim([](Journal& journal) {
    journal.change(namespace_kind, name, "");
    return "named";
  });
  victim.kill_9();
  EXPECT_THAT(revert_abandoned(), SizeIs(1));
  EXPECT_FALSE(exists());
}

TEST_F(Namespaces, InvisibleNamespaceIsNotGone) {
  Victim victim([](Journal& journal) {
    add_namespace(journal, name);
    return "made";
  });
  victim.kill_9();
  in_child([] {
    ASSERT_EQ(unshare(CLONE_NEWNS), 0);
    ASSERT_EQ(mount("none", "/", nullptr, MS_REC | MS_PRIVATE, nullptr), 0);
    ASSERT_EQ(mount("none", "/run/netns", "tmpfs", 0, nullptr), 0);
    EXPECT_THAT(revert_abandoned(), ElementsAre(HasSubstr("not visible")));
    EXPECT_THAT(revert_abandoned(), IsEmpty());
  });
  EXPECT_TRUE(exists());
  EXPECT_THAT(revert_abandoned(), ElementsAre(StartsWith(std::string("removed namespace ") + name)));
  EXPECT_FALSE(exists());
}

// As of a container, or `unshare --mount`, all of whose processes were killed.
TEST_F(Namespaces, WhatAnEndedMountNamespaceLeftIsRemoved) {
  if (!mount_namespace_ended("no place")) GTEST_SKIP() << "not all processes can be looked at";
  in_child([] {
    ASSERT_EQ(unshare(CLONE_NEWNS), 0);
    ASSERT_EQ(mount("none", "/", nullptr, MS_REC | MS_PRIVATE, nullptr), 0);
    Victim victim([](Journal& journal) {
      add_namespace(journal, name);
      return "made";
    });
    victim.kill_9();
  });
  EXPECT_TRUE(exists()) << "the file below the mount that has ended";
  EXPECT_THAT(revert_abandoned(), ElementsAre(StartsWith(std::string("removed namespace ") + name)));
  EXPECT_FALSE(exists());
}

TEST_F(Namespaces, FolderOnADiskOfAnEndedMountNamespaceIsToldOnce) {
  if (!mount_namespace_ended("no place")) GTEST_SKIP() << "not all processes can be looked at";
  in_child([&] {
    ASSERT_EQ(unshare(CLONE_NEWNS), 0);
    ASSERT_EQ(mount("none", "/", nullptr, MS_REC | MS_PRIVATE, nullptr), 0);
    ASSERT_EQ(mount("none", "/tmp", "tmpfs", 0, nullptr), 0);
    set("TMPDIR", "/tmp");
    Victim victim(make_folder);
    victim.kill_9();
  });
  EXPECT_THAT(revert_abandoned(), ElementsAre(HasSubstr("its mount namespace has ended")));
  EXPECT_TRUE(there_is_no_folder());
}

TEST_F(Namespaces, MountNamespaceOfALivingProcessHasNotEnded) {
  const auto here = place(Scope::mount_namespace);
  EXPECT_FALSE(mount_namespace_ended(here));
  Victim victim([](Journal&) {
    EXPECT_EQ(unshare(CLONE_NEWNS), 0);
    return place(Scope::mount_namespace);
  });
  EXPECT_NE(victim.said(), here);
  EXPECT_FALSE(mount_namespace_ended(victim.said()));
  victim.kill_9();
}

// From root without CAP_SYS_PTRACE, as of a service with ProtectProc=ptraceable.
TEST_F(Namespaces, MountNamespaceOfAHiddenProcessHasNotEnded) {
  Victim victim([](Journal&) {
    EXPECT_EQ(unshare(CLONE_NEWNS), 0);
    return place(Scope::mount_namespace);
  });
  in_child([&] {
    ASSERT_EQ(unshare(CLONE_NEWNS), 0);
    ASSERT_EQ(mount("none", "/", nullptr, MS_REC | MS_PRIVATE, nullptr), 0);
    if (mount("none", "/proc", "proc", 0, "hidepid=4") != 0) return;  // since Linux 5.8
    drop(CAP_SYS_PTRACE);
    EXPECT_FALSE(mount_namespace_ended(victim.said()));
  });
  victim.kill_9();
}

// Run by the next test, inside `ip netns exec`.
TEST(Inside, RevertsWhatAKilledProcessLeft) {
  if (!test::inside_another()) GTEST_SKIP() << "runs inside `ip netns exec` only";
  EXPECT_THAT(revert_abandoned(), ElementsAre(StartsWith("removed")));
}

TEST_F(Namespaces, AreGoneOutsideWhenRevertedFromInside) {
  Victim victim([](Journal& journal) {
    add_namespace(journal, name);
    return "made";
  });
  victim.kill_9();
  const auto self = fs::read_symlink("/proc/self/exe").string();
  in_child([&] {
    set(test::inside_variable, "1");
    ip(inside_ + self + " --gtest_filter=Inside.*");
  });
  EXPECT_FALSE(exists());
  EXPECT_THAT(revert_abandoned(), IsEmpty());
}

}  // namespace
}  // namespace ontime::journal

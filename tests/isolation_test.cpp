// SPDX-License-Identifier: Apache-2.0
#include "isolation/isolation.hpp"

#include <filesystem>
#include <fstream>
#include <thread>

#include "isolation/groups.hpp"
#include "own_run.hpp"
#include "realtime/realtime.hpp"

namespace ontime::isolation {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

// A tree as the kernel shows it, of files that do nothing.
class Tree : public testing::Test {
 protected:
  Tree() {
    std::string name = (fs::temp_directory_path() / "ontime-test-XXXXXX").string();
    root_ = mkdtemp(name.data());
  }
  ~Tree() override { fs::remove_all(root_); }
  void file(const std::string& path, const std::string& text) const {
    fs::create_directories((root_ / path).parent_path());
    std::ofstream(root_ / path) << text << '\n';
  }
  std::string at(const std::string& path) const { return root_ / path; }
  std::string mounts(const std::string& lines) const {
    std::string text = lines;
    for (auto found = text.find('@'); found != text.npos; found = text.find('@'))
      text.replace(found, 1, root_);
    file("mounts", text);
    return at("mounts");
  }
  static std::string refused(const std::string& controller, const std::string& mounts) {
    try {
      hierarchy_of(controller, mounts);
    } catch (const journal::Error& error) {
      return error.what();
    }
    return "";
  }
  fs::path root_;
};

TEST_F(Tree, HierarchyOfEitherVersionIsFoundByController) {
  file("unified/cgroup.controllers", "cpuset cpu memory");
  const auto two = mounts("cgroup2 @/unified cgroup2 rw,nosuid 0 0");
  EXPECT_EQ(hierarchy_of("cpuset", two).folder, at("unified"));
  EXPECT_TRUE(hierarchy_of("cpu", two).unified);

  file("unified/cgroup.controllers", "memory");
  file("cpuset/release_agent", "");
  file("cpu/release_agent", "");
  const auto both = mounts(
      "cgroup2 @/unified cgroup2 rw 0 0\ncgroup @/cpu cgroup rw,cpu,cpuacct 0 0\n"
      "cgroup @/cpuset cgroup rw,relatime,cpuset 0 0");
  EXPECT_EQ(hierarchy_of("cpuset", both).folder, at("cpuset"));
  EXPECT_FALSE(hierarchy_of("cpuset", both).unified);
  EXPECT_EQ(hierarchy_of("cpu", both).folder, at("cpu")) << "not that of cpuacct, nor of cpuset";
}

TEST_F(Tree, MissingOrPartialHierarchyIsRefused) {
  EXPECT_THAT(refused("cpuset", mounts("proc /proc proc rw 0 0")), HasSubstr("controller 'cpuset'"));
  file("unified/cgroup.controllers", "cpuset");
  file("unified/cgroup.type", "domain");
  EXPECT_THAT(refused("cpuset", mounts("cgroup2 @/unified cgroup2 rw 0 0")), HasSubstr("container"));
  file("cpuset/tasks", "");
  EXPECT_THAT(refused("cpuset", mounts("cgroup @/cpuset cgroup rw,cpuset 0 0")), HasSubstr("container"));
}

TEST_F(Tree, TellsWhoWasGivenCpus) {
  file("system.slice/a.service/cpuset.cpus", "2-3");
  file("system.slice/cpuset.cpus", "");
  file("docker/cpuset.cpus", "0-1");
  file("broken/cpuset.cpus", "x");
  const Hierarchy hierarchy{root_, true};
  EXPECT_THAT(owners_of(hierarchy, {3}), ElementsAre(at("system.slice/a.service")));
  EXPECT_THAT(owners_of(hierarchy, {1, 2}), ElementsAre(at("docker"), at("system.slice/a.service")));
  EXPECT_THAT(owners_of(hierarchy, {4}), IsEmpty());
}

TEST_F(Tree, OwnersThatCannotBeReadAreNotTakenForNone) {
  const Hierarchy missing{at("missing"), true}, unreadable{root_, true};
  EXPECT_THAT(test::error_of([&] { owners_of(missing, {0}); }), HasSubstr(at("missing")));
  fs::create_directories(at("a.slice/cpuset.cpus"));  // which no program can read
  EXPECT_THAT(test::error_of([&] { owners_of(unreadable, {0}); }), HasSubstr(at("a.slice/cpuset.cpus")));
}

// The control groups that a process and its children see: a hierarchy of version 2, of files that do nothing.
class Unified : public testing::Test {
 protected:
  static inline const fs::path root = "/sys/fs/cgroup";
  static void file(const std::string& path, const std::string& text) {
    fs::create_directories((root / path).parent_path());
    std::ofstream(root / path) << text << '\n';
  }
  static void inside(const std::function<void()>& body) {
    if (geteuid() != 0) GTEST_SKIP() << "needs root";
    test::in_child([&] {
      ASSERT_EQ(unshare(CLONE_NEWNS), 0);
      ASSERT_EQ(mount("none", "/", nullptr, MS_REC | MS_PRIVATE, nullptr), 0);
      ASSERT_EQ(mount("none", "/run", "tmpfs", 0, "mode=755"), 0);
      umount2(root.c_str(), MNT_DETACH);
      ASSERT_EQ(mount("none", root.c_str(), "cgroup2", 0, nullptr), 0);
      ASSERT_EQ(mount("none", root.c_str(), "tmpfs", 0, nullptr),
                0);  // and /proc/mounts still names that one
      file("cgroup.controllers", "cpuset cpu memory");
      body();
    });
  }
};

TEST_F(Unified, ControllerInUseByAnotherGroupIsNotOursToTurnOff) {
  inside([] {
    file("cgroup.subtree_control", "cpu memory");
    EXPECT_EQ(controller_kind.read("cpuset"), "off");
    for (const auto& [name, text] : {std::pair("cpu.weight", "100"), std::pair("cpu.max", "max 100000"),
                                     std::pair("cgroup.subtree_control", "memory")})
      file(fs::path("a.slice") / name, text);
    file("ontime-load/cpu.weight", "10");
    EXPECT_EQ(controller_kind.read("cpu"), "on");
    file("a.slice/cpu.weight", "200");
    EXPECT_EQ(controller_kind.read("cpu"), "on, for a.slice");
    file("a.slice/cpu.weight", "100");
    // A service in the slice has a weight or a limit. The kernel would refuse to turn the controller off.
    file("a.slice/cgroup.subtree_control", "cpu memory");
    EXPECT_EQ(controller_kind.read("cpu"), "on, for a.slice");
  });
}

TEST_F(Unified, GroupMadeByAnotherProgramIsLeft) {
  inside([] {
    const std::string load = "cpu/ontime-load";
    const auto folder = root / "ontime-load";
    journal::Journal journal(kinds());
    fs::create_directory(folder);
    EXPECT_THAT(test::error_of([&] { journal.change(group_kind, load, journal::to_be_made); }),
                HasSubstr("sudo rmdir " + folder.string()));
    EXPECT_THROW(group_kind.write(load, journal::to_be_made, {}), journal::MadeByAnother);
    EXPECT_THAT(journal.take_back(group_kind, load), IsEmpty());
    EXPECT_TRUE(fs::exists(folder));
    fs::remove(folder);
    journal.change(group_kind, load, journal::to_be_made);
    EXPECT_THAT(journal.take_back(group_kind, load), IsEmpty());
    EXPECT_FALSE(fs::exists(folder));
    journal.change(group_kind, load, journal::to_be_made);
    const auto ours = group_kind.read(load);
    fs::remove(folder);
    fs::create_directory(folder);
    EXPECT_THAT(test::error_of([&] { group_kind.write(load, {}, ours); }), HasSubstr("made it anew"));
    EXPECT_THAT(journal.revert(), ElementsAre(HasSubstr("another program has changed it")));
    EXPECT_TRUE(fs::exists(folder));
  });
}

TEST_F(Unified, RefusedIsolationLeavesNothing) {
  if (cpus_of_thread(0).size() < 2) GTEST_SKIP() << "needs two CPUs";
  inside([] {
    const auto cpus = cpus_of_thread(0);
    file("cpuset.cpus.effective", realtime::list_of(cpus));
    file("cgroup.subtree_control", "cpu");
    journal::Journal journal(kinds());
    const auto refused = [&](const Wish& wish) {
      return test::error_of([&] { const Isolation isolation(journal, wish); });
    };
    // The kernel of these groups has no limits.
    EXPECT_THAT(refused({.cpus = "", .load_quota = 0.5}),
                HasSubstr("isolation.load-quota: this kernel has no cpu.max"));
    EXPECT_THAT(refused({.cpus = "", .load_weight = 10}), HasSubstr("no cpu.weight"));
    // This thread would have no CPU left.
    set_cpus(0, {cpus.back()});
    EXPECT_THAT(refused({.cpus = std::to_string(cpus.back())}), HasSubstr("threads are bound to CPUs"));
    file("docker/cpuset.cpus", std::to_string(cpus.back()));
    EXPECT_THAT(refused({.cpus = std::to_string(cpus.back())}), HasSubstr((root / "docker").string()));
    for (const auto* group : {"ontime-robot", "ontime-load"}) EXPECT_FALSE(fs::exists(root / group)) << group;
    EXPECT_EQ(controller_kind.read("cpuset"), "off");
    EXPECT_THAT(journal.revert(), IsEmpty());
  });
}

TEST(Group, GroupOfAnotherNameIsNeverTouched) {
  EXPECT_TRUE(group_kind.accepts("cpuset/ontime-robot"));
  for (const auto* what :
       {"cpuset/", "cpuset/system.slice", "cpuset/ontime-/..", "cpuset/../ontime-x", "memory/ontime-x",
        "ontime-robot", "cpuset/ontime-robot/ontime-x", "/ontime-robot"})
    EXPECT_FALSE(group_kind.accepts(what)) << what;
  EXPECT_FALSE(controller_kind.accepts("memory"));
  EXPECT_FALSE(balance_kind.accepts("ontime-robot"));
}

TEST(Threads, ThreadsThatWouldLoseTheirCpusAreReported) {
  const std::vector<int> all = {0, 1, 2, 3}, kept = {2, 3};
  const auto forgotten = [&](const std::vector<int>& cpus, bool remembers, bool of_kernel = false) {
    return would_be_forgotten({7, "x", cpus, of_kernel, false}, all, kept, remembers);
  };
  EXPECT_FALSE(forgotten(all, true));
  EXPECT_FALSE(forgotten({0, 2}, true)) << "Linux 6.2 gives it 2 again";
  EXPECT_TRUE(forgotten({2}, true)) << "it would have none left";
  EXPECT_FALSE(forgotten(all, false));
  EXPECT_TRUE(forgotten({0}, false)) << "before, it would have all after that";
  EXPECT_FALSE(forgotten(all, true, true));
  EXPECT_TRUE(forgotten({0}, true, true)) << "the kernel asked for nothing that could be remembered";
  EXPECT_FALSE(would_be_forgotten({7, "irq/9-eth0", {0}, true, false}, all, kept, false));
  EXPECT_FALSE(would_be_forgotten({7, "migration/3", {3}, true, true}, all, kept, false));
  EXPECT_TRUE(would_be_forgotten({7, "irq/9-eth0", {0}, false, false}, all, kept, false))
      << "any process can take that name";
}

TEST(Threads, AreReadAsTheKernelHasThem) {
  const auto all = threads();
  const auto own = std::find_if(all.begin(), all.end(), [](const Thread& one) { return one.id == gettid(); });
  ASSERT_NE(own, all.end());
  EXPECT_FALSE(own->of_kernel);
  EXPECT_FALSE(own->bound);
  EXPECT_EQ(own->cpus, cpus_of_thread(0));
}

TEST(Threads, AreGivenCpus) {
  std::thread([] {
    const auto before = cpus_of_thread(0);
    set_cpus(0, {before.back()});
    EXPECT_THAT(cpus_of_thread(0), ElementsAre(before.back()));
  }).join();
}

}  // namespace
}  // namespace ontime::isolation

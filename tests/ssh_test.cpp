// SPDX-License-Identifier: Apache-2.0
#include "campaign/ssh.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "campaign/deploy.hpp"
#include "table/table.hpp"

namespace ontime::campaign {
namespace {

using testing::AllOf;
using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;

std::string what_a_shell_makes_of(const std::vector<std::string>& words) {
  const auto command = "printf '<%s>' " + table::shell_line(words);
  const std::unique_ptr<FILE, int (*)(FILE*)> shell(popen(command.c_str(), "r"), pclose);
  std::array<char, 512> text{};
  const auto count = std::fread(text.data(), 1, text.size(), shell.get());
  return {text.data(), count};
}

TEST(Ssh, WordsReachAShellUndividedAndUnchanged) {
  EXPECT_EQ(table::shell_line({"ip", "netns", "exec", "robot", "/usr/bin/ontime"}),
            "ip netns exec robot /usr/bin/ontime");
  EXPECT_EQ(what_a_shell_makes_of(
                {"it's", "", "$HOME", "a b", "*", "~", "`id`", "x;exit 1", "\"", "a\nb", "\\", "ä"}),
            "<it's><><$HOME><a b><*><~><`id`><x;exit 1><\"><a\nb><\\><ä>");
  EXPECT_EQ(table::shell_line({"a\\", "'; b"}), R"('a'\\'' ''\''; b')") << "no backslash in quotes, for fish";
}

TEST(Ssh, SessionsShareOneConnectionAndNoCheckIsSwitchedOff) {
  const Ssh ssh("robot");
  const auto first = ssh.first({"ontime", "keeper"}), another = ssh.another({"ontime", "agent"});
  EXPECT_THAT(first, AllOf(Contains("ControlMaster=yes"), Contains("BatchMode=yes"), Contains("robot"),
                           Contains("ontime keeper")));
  EXPECT_THAT(another,
              AllOf(Contains("ControlMaster=no"), Contains("BatchMode=yes"), Contains("ontime agent")));
  for (const auto& command : {first, another}) EXPECT_THAT(command, Not(Contains(HasSubstr("HostKey"))));
  const auto socket_of = [](const auto& command) {
    return *std::next(std::find(command.begin(), command.end(), "-S"));
  };
  EXPECT_EQ(socket_of(first), socket_of(another));
}

TEST(Ssh, WithoutATemporaryFolderNothingIsMade) {
  const char* own = std::getenv("TMPDIR");  // NOLINT(concurrency-mt-unsafe): one thread
  const std::string before = own != nullptr ? own : "/tmp";
  for (const auto* bad : {"/nonexistent/folder", "."}) {
    setenv("TMPDIR", bad, 1);  // NOLINT(concurrency-mt-unsafe)
    try {
      const Ssh ssh("robot");
      ADD_FAILURE() << ssh.folder();
    } catch (const orders::Error& error) {
      EXPECT_EQ(error.exit, 3);
      EXPECT_THAT(error.what(), HasSubstr("TMPDIR"));
    }
  }
  setenv("TMPDIR", before.c_str(), 1);  // NOLINT(concurrency-mt-unsafe)
}

TEST(Ssh, FolderIsPrivateAndRemovedWithTheConnection) {
  std::string folder;
  {
    const Ssh ssh("robot");
    folder = ssh.first({"x"}).at(3);
    EXPECT_EQ(std::filesystem::status(folder).permissions(), std::filesystem::perms::owner_all);
  }
  EXPECT_FALSE(std::filesystem::exists(folder));
}

TEST(Ssh, EachFailureNamesHostAndFix) {
  const auto reason = [](int code, const std::string& said = "") {
    return reason_of("me@robot", "ontime", code, said);
  };
  EXPECT_THAT(reason(125), HasSubstr("apt install openssh-client"));
  EXPECT_THAT(reason(126), AllOf(HasSubstr("me@robot"), HasSubstr("not executable")));
  EXPECT_THAT(reason(127), AllOf(HasSubstr("me@robot"), HasSubstr("--deploy")));
  EXPECT_THAT(reason(255, "Host key verification failed."),
              AllOf(HasSubstr("does not know"), HasSubstr(": ssh me@robot")));
  EXPECT_THAT(reason(255,
                     "@@@@@@\n@    WARNING: REMOTE HOST IDENTIFICATION HAS CHANGED!     @\n…\nHost key "
                     "verification failed."),
              AllOf(HasSubstr("host key of me@robot"), HasSubstr("ssh-keygen -R")));
  EXPECT_THAT(reason(255, "me@10.0.0.2: Permission denied (publickey)."),
              AllOf(HasSubstr("ssh-copy-id me@robot"), HasSubstr("Permission denied (publickey)")));
  for (const auto* why :
       {"Connection refused", "No route to host", "Connection timed out", "Network is unreachable"})
    EXPECT_THAT(reason(255, std::string("ssh: connect to host 10.0.0.2 port 22: ") + why),
                AllOf(HasSubstr("me@robot"), HasSubstr(why)));
  EXPECT_THAT(reason(255, "ssh: Could not resolve hostname robot: Name or service not known"),
              AllOf(HasSubstr("me@robot"), HasSubstr("Could not resolve")));
  EXPECT_THAT(reason(255, "hostname contains invalid characters\n"),
              AllOf(HasSubstr("'me@robot' is not a host"), Not(HasSubstr("lost"))));
  EXPECT_EQ(reason(255), "the connection to me@robot was lost");
  EXPECT_EQ(reason(255, "client_loop: send disconnect: Broken pipe\n"),
            "the connection to me@robot was lost (client_loop: send disconnect: Broken pipe)");
  EXPECT_THAT(reason(-1, "Welcome!\nToday"), AllOf(HasSubstr("\"Welcome!\""), Not(HasSubstr("Today"))));
  EXPECT_EQ(reason(3), "");
}

TEST(Ssh, SudoThatAsksForAPasswordIsNamedWithAFix) {
  const auto reason = [](const std::string& destination) {
    return reason_of_prefix(destination, {"sudo", "-n"}, 1);
  };
  EXPECT_THAT(reason("pw@c1"),
              AllOf(HasSubstr("sudo on pw@c1"), HasSubstr("NOPASSWD"), HasSubstr("ssh: root@c1")));
  EXPECT_THAT(reason("ssh://pw@c1:22"), Not(HasSubstr("root@")));
  EXPECT_THAT(reason(""), AllOf(HasSubstr("`sudo ontime`"), Not(HasSubstr(" on "))));
  EXPECT_EQ(reason_of_prefix("c1", {"sudo"}, 3), "") << "of ontime";
  EXPECT_EQ(reason_of_prefix("c1", {"docker", "exec", "x"}, 1), "");
  EXPECT_EQ(reason_of_prefix("c1", {}, 1), "");
  const auto between = Ssh("pw@c1").between("ontime", {"sudo"}, "sudo ontime keeper");
  EXPECT_EQ(between.shown, "sudo ontime keeper on pw@c1");
  EXPECT_THAT(between.reason(1, "Shared connection closed"), HasSubstr("NOPASSWD"));
}

TEST(Ssh, PrefixThatEndsWithTheExitCodeOfSshIsNamed) {
  const Ssh ssh("c1");
  const std::vector<std::string> prefix{"ip", "netns", "exec", "robot"};
  const auto between = ssh.between("ontime", prefix, "ip netns exec robot ontime agent");
  EXPECT_THAT(between.reason(255, ""),
              AllOf(HasSubstr("was lost"), HasSubstr("`ip netns exec robot` failed")));
  EXPECT_THAT(between.reason(255, "client_loop: send disconnect: Broken pipe"), Not(HasSubstr("netns")));
  EXPECT_EQ(ssh.between("ontime", {}, "ontime agent").reason(255, ""), "the connection to c1 was lost");
}

// The session that holds the connection was killed, and its folder is gone.
TEST(Ssh, SessionAfterTheLastOneSaysNothingOfItsFiles) {
  const Ssh ssh("robot");
  const auto command = ssh.another({"ontime", "agent"});
  const auto bin = std::filesystem::path(ssh.folder()) / "bin";
  std::filesystem::create_directory(bin);
  std::ofstream(bin / "ssh") << "#!/bin/sh\nrm -r " << ssh.folder() << "\nexit 255\n";
  std::filesystem::permissions(bin / "ssh", std::filesystem::perms::owner_all);
  for (const auto* when : {"while it lives", "before it begins"}) {
    const auto line = fmt::format("PATH={}:$PATH {} 2>&1; echo $?", bin.string(), table::shell_line(command));
    const std::unique_ptr<FILE, int (*)(FILE*)> shell(popen(line.c_str(), "r"), pclose);
    std::array<char, 512> text{};
    const auto count = std::fread(text.data(), 1, text.size(), shell.get());
    EXPECT_EQ(std::string(text.data(), count), "255\n") << when;
  }
}

TEST(Ssh, LinkOfSshIsNotedOnlyIfItMayBeTheOneUnderTest) {
  EXPECT_EQ(note_of_ssh_link("component", {}), "");
  EXPECT_EQ(note_of_ssh_link("component", record::SshLink{"eth0", false}), "");
  EXPECT_THAT(note_of_ssh_link("component", record::SshLink{"eth1", true}), HasSubstr("eth1"));
  EXPECT_THAT(note_of_ssh_link("component", record::SshLink{{}, true}), HasSubstr("unknown"));
}

TEST(Deploy, NamesPackagesOfLibrariesAndRunsNoForeignText) {
  const auto never = [] { return false; };
  EXPECT_THAT(packages_of({"libc.so.6", "libc.so.6"}, never), ElementsAre("libc6"));
  EXPECT_THAT(packages_of({"'; touch /tmp/x; '", "libnone.so.99"}, never), testing::IsEmpty());
}

TEST(Deploy, AsksForNoPackageOnceItIsInterrupted) {
  EXPECT_THAT(packages_of({"libc.so.6"}, [] { return true; }), testing::IsEmpty());
}

}  // namespace
}  // namespace ontime::campaign

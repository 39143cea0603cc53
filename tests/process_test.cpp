// SPDX-License-Identifier: Apache-2.0
#include "process/process.hpp"

#include <csignal>
#include <fstream>
#include <sstream>

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

namespace ontime::process {
namespace {

// As of a process that ends while its file is read.
TEST(Proc, UnreadableFileGivesNoValue) { EXPECT_EQ(text_of("/proc"), std::nullopt); }

TEST(Proc, FieldsAreFoundByTheirWholeName) {
  const std::string text =
      "vendor_id\t: A\nmodel\t\t: 17\nmodel name\t: AMD EPYC: 7\nempty :\nmodel name : second\n";
  EXPECT_EQ(field(text, "model name"), "AMD EPYC: 7");
  EXPECT_EQ(field(text, "model"), "17");
  EXPECT_EQ(field(text, "empty"), "");
  EXPECT_FALSE(field(text, "name"));
  EXPECT_FALSE(field("", "model"));
}

TEST(Proc, NumbersAreWholeOrNothing) {
  EXPECT_EQ(number("-1\n"), -1);
  EXPECT_EQ(number("950000\n"), 950000);
  for (const auto* text : {"", "\n", "max", "1 2", "1x", "99999999999999999999"})
    EXPECT_FALSE(number(text)) << text;
  EXPECT_FALSE(number(std::nullopt));
}

TEST(Stat, IsReadByTheKernelsOrderOfFields) {
  const auto stat = parse_stat(
      "7 (a) S 5 6 8 0 -1 2129984 11 12 13 14 150 50 17 18 20 0 1 0 99 10 20 30 1 2 3 4 5 6 7 8 9 0 0 0 17 3 "
      "50 "
      "2 0 0");
  ASSERT_TRUE(stat);
  EXPECT_EQ(stat->pid, 7);
  EXPECT_EQ(stat->state, 'S');
  EXPECT_EQ(stat->parent, 5);
  EXPECT_EQ(stat->group, 6);
  EXPECT_TRUE(stat->is_of_kernel());
  EXPECT_EQ(stat->minor_faults, 11u);
  EXPECT_EQ(stat->major_faults, 13u);
  EXPECT_EQ(stat->start_ticks, 99u);
  EXPECT_EQ(stat->priority, 50);
  EXPECT_EQ(stat->policy, 2);
}

std::string own_text() {
  std::ostringstream text;
  text << std::ifstream("/proc/self/stat").rdbuf();
  return text.str();
}

TEST(Stat, OwnProcessIsAsItKnowsItself) {
  const auto stat = parse_stat(own_text());
  ASSERT_TRUE(stat);
  EXPECT_EQ(stat->pid, getpid());
  EXPECT_EQ(stat->parent, getppid());
  EXPECT_EQ(stat->group, getpgrp());
  EXPECT_FALSE(stat->is_of_kernel() || stat->has_ended());
}

TEST(Stat, NameMayHoldParenthesesAndSpaces) {
  auto text = own_text();
  text.replace(text.find('(') + 1, text.rfind(')') - text.find('(') - 1, "a) Z 1 (b");
  const auto stat = parse_stat(text);
  ASSERT_TRUE(stat);
  EXPECT_EQ(stat->name, "a) Z 1 (b");
  EXPECT_FALSE(stat->has_ended());
}

TEST(Stat, CutTextIsRefused) {
  const auto whole = own_text();
  std::size_t policy = whole.rfind(')') + 1;  // where the 41st field begins
  for (int field = 3; field <= 41; ++field) policy = whole.find(' ', policy) + 1;
  ASSERT_TRUE(parse_stat(whole.substr(0, policy + 1)));
  for (std::size_t length = 0; length < policy; ++length)
    EXPECT_FALSE(parse_stat(whole.substr(0, length))) << length;
}

// As some programs that start others leave it to these.
TEST(Start, EndIsReportedAlsoWhereTheCallerIgnoredTheEndOfChildren) {
  const pid_t child = fork();
  if (child == 0) {
    std::signal(SIGCHLD, SIG_IGN);
    const auto started = start({"sh", "-c", "exit 7"}, {0, 1, 2});
    const int status = wait_for(started.pid);
    _exit(WIFEXITED(status) ? WEXITSTATUS(status) : 1);
  }
  EXPECT_EQ(WEXITSTATUS(wait_for(child)), 7);
}

// As gnuplot, which ends with 0 where its figure may not grow.
TEST(Start, ProgramEndsByASignalThatTheCallerIgnores) {
  const pid_t child = fork();
  if (child == 0) {
    for (const int signal : {SIGPIPE, SIGXFSZ}) std::signal(signal, SIG_IGN);
    bool ended = true;
    for (const int signal : {SIGPIPE, SIGXFSZ}) {
      const auto started = start({"sh", "-c", "kill -" + std::to_string(signal) + " $$"}, {0, 1, 2});
      const int status = wait_for(started.pid);
      ended = ended && WIFSIGNALED(status) && WTERMSIG(status) == signal;
    }
    _exit(ended ? 0 : 1);
  }
  EXPECT_EQ(WEXITSTATUS(wait_for(child)), 0);
}

}  // namespace
}  // namespace ontime::process

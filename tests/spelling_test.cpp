// SPDX-License-Identifier: Apache-2.0
#include "spelling/spelling.hpp"

#include <gtest/gtest.h>

namespace {

using ontime::spelling::nearest;
using Words = std::vector<std::string>;

const Words commands = {"run", "ping", "pong", "report", "compare", "export"};

TEST(Spelling, OneLetterTooManyTooFewOrOtherIsFound) {
  EXPECT_EQ(nearest("reprot", commands), "report");
  EXPECT_EQ(nearest("comapre", commands), "compare");
  EXPECT_EQ(nearest("exprt", commands), "export");
  EXPECT_EQ(nearest("ruun", commands), "run");
  EXPECT_EQ(nearest("pimg", commands), "ping");
}

TEST(Spelling, TheNearerOfTwoIsTaken) { EXPECT_EQ(nearest("pongg", commands), "pong"); }

TEST(Spelling, AnotherCaseIsNearerThanAnotherLetter) {
  EXPECT_EQ(nearest("Test1.b", {"Test1.A", "Test1.B"}), "Test1.B");
  EXPECT_EQ(nearest("UDP", {"udp", "xdp"}), "udp");
}

TEST(Spelling, TheBeginningOfAWordIsEnough) {
  EXPECT_EQ(nearest("cyclone", {"udp", "cyclonedds"}), "cyclonedds");
  EXPECT_EQ(nearest("comp", commands), "compare");
  EXPECT_EQ(nearest("tun", {"run", "tune"}), "tune");  // and not another letter
}

TEST(Spelling, AnotherWordIsNotFound) {
  EXPECT_EQ(nearest("tune", commands), "");
  EXPECT_EQ(nearest("frobnicate", commands), "");
  EXPECT_EQ(nearest("x", commands), "");
  EXPECT_EQ(nearest("", commands), "");
  EXPECT_EQ(nearest("ping", {}), "");
}

TEST(Spelling, SuggestionIsEmptyWithoutAWord) {
  EXPECT_EQ(ontime::spelling::suggestion("udpp", {"udp"}), " (did you mean 'udp'?)");
  EXPECT_EQ(ontime::spelling::suggestion("frobnicate", {"udp"}), "");
}

}  // namespace

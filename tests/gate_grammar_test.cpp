// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "gate/gate.hpp"

namespace ontime::gate {
namespace {

using statistics::Figure;
using statistics::Times;
using ::testing::HasSubstr;

std::string error_of(const std::string& text, Use use = Use::fail_if_compared) {
  try {
    parse(text, use);
  } catch (const Error& error) {
    return error.what();
  }
  return "no error";
}

TEST(Parse, KnowsEveryFigureAndUnit) {
  const auto gate = parse("p99.9 > 2 ms", Use::fail_if);
  EXPECT_EQ(gate.figure, Figure::p99_9);
  EXPECT_EQ(gate.times, Times::round_trip);
  EXPECT_EQ(gate.kind, Gate::Limit::absolute);
  EXPECT_DOUBLE_EQ(gate.limit, 2e6);
  const std::pair<const char*, Figure> figures[] = {
      {"mean", Figure::mean},   {"p50", Figure::p50},       {"p90", Figure::p90}, {"p99", Figure::p99},
      {"p99.9", Figure::p99_9}, {"p99.99", Figure::p99_99}, {"max", Figure::max}};
  for (const auto& [name, figure] : figures)
    EXPECT_EQ(parse(std::string(name) + ">1us", Use::fail_if).figure, figure) << name;
  const std::pair<const char*, double> units[] = {
      {"ns", 1}, {"us", 1e3}, {"µs", 1e3}, {"ms", 1e6}, {"s", 1e9}};
  for (const auto& [unit, ns] : units)
    EXPECT_DOUBLE_EQ(parse(std::string("max > 1.5") + unit, Use::fail_if).limit, 1.5 * ns) << unit;
  EXPECT_EQ(parse("max > 1.001 ms", Use::fail_if).limit, 1'001'000) << "such a maximum is not beyond it";
}

TEST(Parse, CountsAndShares) {
  EXPECT_EQ(parse("late > 0", Use::fail_if).kind, Gate::Limit::count);
  const auto share = parse("lost > 0.1%", Use::fail_if);
  EXPECT_EQ(share.kind, Gate::Limit::absolute);
  EXPECT_DOUBLE_EQ(share.limit, 0.001);
  EXPECT_EQ(parse("response late > 3", Use::fail_if).times, Times::response);
  EXPECT_EQ(parse("lost > 0 %", Use::fail_if).kind, Gate::Limit::count);
}

TEST(Parse, Changes) {
  const auto ratio = parse("p99.9 > +10%", Use::fail_if_compared);
  EXPECT_EQ(ratio.kind, Gate::Limit::ratio);
  EXPECT_DOUBLE_EQ(ratio.limit, 1.1);
  EXPECT_DOUBLE_EQ(parse("p50 > -5 %", Use::fail_if_compared).limit, 0.95);
  const auto difference = parse("response p99 > +500 us", Use::fail_if_compared);
  EXPECT_EQ(difference.kind, Gate::Limit::difference);
  EXPECT_DOUBLE_EQ(difference.limit, 5e5);
  const auto points = parse("late > +0.5 points", Use::fail_if_compared);
  EXPECT_EQ(points.kind, Gate::Limit::difference);
  EXPECT_DOUBLE_EQ(points.limit, 0.005);
}

TEST(Parse, ErrorsNameTheColumnAndTheCause) {
  const std::pair<const char*, const char*> cases[] = {
      {"", "column 1: a metric is missing"},
      {"p98 > 2 ms", "column 1: 'p98' is not a metric"},
      {"min > 2 ms", "column 1: 'min' is not a metric"},
      {"  response p1", "column 12: 'p1' is not a metric"},
      {"response lost > 1", "column 10: a lost message"},
      {"p99", "column 4: expected '>'"},
      {"p99 < 2 ms", "column 5: expected '>', not '<'"},
      {"p99 >= 2 ms", "column 5: expected '>', not '>='"},
      {"p99 <= 2 ms", "column 5: expected '>', not '<='"},
      {"p99 > ", "column 7: expected a number"},
      {"p99 > x ms", "column 7: expected a number"},
      {"p99 > nan ms", "column 7: expected a number"},
      {"p99 > inf ms", "column 7: expected a number"},
      {"p99 > --1 ms", "column 8: expected a number"},
      {"p99 > 1e99 ms", "column 8: 'e99'"},
      {"p99 > 9999999999999999999 ms", "column 7: expected a number"},
      {"p99 > 2", "column 8: a unit"},
      {"p99 > 2 %", "column 7: a limit in %"},
      {"p99 > 2 h", "column 9: 'h'"},
      {"p99 > 2 µm", "column 9: 'µm'"},
      {"p99 > 2 µs x", "column 12: unexpected 'x'"},
      {"late > 0.5", "column 8: a number of messages"},
      {"late > +1", "column 10: a unit"},
      {"late > 1 ms", "column 10: late and lost"},
      {"late > 101 %", "column 8: at most 100 %"},
      {"p99 > -100 %", "column 7: a value cannot fall"},
      {"max > +10%", "column 7: each max"},
  };
  for (const auto& [text, expected] : cases) EXPECT_THAT(error_of(text), HasSubstr(expected)) << text;
  EXPECT_THAT(error_of(std::string(1000, 'x')), HasSubstr("at most 200"));
  EXPECT_THAT(error_of("p99 > +10%", Use::fail_if), HasSubstr("column 7: a limit with + or -"));
  EXPECT_THAT(error_of("p99 > 2 ms", Use::require), HasSubstr("column 5: expected '<=', not '>'"));
  EXPECT_THAT(error_of("p99 <= +2 ms", Use::require), HasSubstr("column 8: a limit with + or -"));
}

}  // namespace
}  // namespace ontime::gate

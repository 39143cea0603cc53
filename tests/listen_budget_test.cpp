// SPDX-License-Identifier: Apache-2.0
#include <vector>

#include <gtest/gtest.h>

#include "listen/budget.hpp"

namespace ontime::listen {
namespace {

using namespace std::chrono_literals;
using Step = Budget::Step;

// Listens for so long, with a look each 200 ms, while probes and ontime take such a share of one CPU; nothing
// in pauses.
struct Course {
  explicit Course(double share, bool records_kernel_events = false)
      : budget(share, records_kernel_events, now, taken) {}
  void go(Budget::Time time, double share) {
    for (const auto until = now + time; now < until;) {
      now += 200ms;
      if (!budget.is_paused()) taken += std::chrono::duration_cast<Budget::Time>(200ms * share);
      if (const auto step = budget.look(now, taken); step != Step::none) steps.push_back(step);
    }
  }
  static constexpr Budget::Time begin = 1h;
  Budget::Time now = begin, taken = 5s;
  Budget budget;
  std::vector<Step> steps;
};

TEST(Budget, SufficientBudgetLeavesOutNothing) {
  Course course(0.01, true);
  course.go(10min, 0.009);
  EXPECT_TRUE(course.steps.empty());
  EXPECT_EQ(course.budget.listened_share(course.now), 1);
}

TEST(Budget, ShortBurstLeavesOutNothing) {
  Course course(0.01);
  course.go(2s, 0.04);
  course.go(8s, 0.001);
  EXPECT_TRUE(course.steps.empty());
}

TEST(Budget, ExceededBudgetFirstStopsKernelEvents) {
  Course course(0.01, true);
  course.go(10s, 0.03);
  ASSERT_FALSE(course.steps.empty());
  EXPECT_EQ(course.steps.front(), Step::drop_kernel_events);
  // Without them it suffices.
  Course enough(0.01, true);
  enough.go(4s, 0.03);
  enough.go(10min, 0.005);
  EXPECT_EQ(enough.steps, std::vector{Step::drop_kernel_events});
}

TEST(Budget, ExceededBudgetWithoutKernelEventsPauses) {
  Course course(0.01);
  course.go(10min, 0.03);
  EXPECT_EQ(course.steps[0], Step::pause);
  EXPECT_EQ(course.steps[1], Step::resume);
  EXPECT_EQ(course.steps[2], Step::pause);
  EXPECT_NEAR(course.budget.listened_share(course.now), 1. / 3, 0.02);
}

TEST(Budget, LongRunStaysWithinBudget) {
  for (const double load : {0.011, 0.02, 0.5, 3.0}) {
    Course course(0.01);
    course.go(2h, load);
    const auto whole = std::chrono::duration<double>(course.now - Course::begin);
    const auto taken = std::chrono::duration<double>(course.taken - 5s);
    // The last span may not be made up for yet.
    EXPECT_LE(taken.count(), 0.01 * whole.count() + 10 * load) << load;
    EXPECT_GT(course.budget.listened_share(course.now), 0.7 * 0.01 / load) << load;
  }
}

TEST(Budget, FirstPauseComesAfterThreeSecondsAtAnyLoad) {
  Course course(0.0001);
  course.go(2800ms, 10);
  EXPECT_TRUE(course.steps.empty());
  course.go(200ms, 10);
  EXPECT_EQ(course.steps, std::vector{Step::pause});
}

TEST(Budget, UnusedBudgetIsNotSaved) {
  Course course(0.01);
  course.go(1h, 0);
  course.go(6s, 0.03);
  EXPECT_EQ(course.steps, std::vector{Step::pause});
}

}  // namespace
}  // namespace ontime::listen

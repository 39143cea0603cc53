// SPDX-License-Identifier: Apache-2.0
// `ontime listen --reader`: what a transport hears becomes flows.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "listen/listen.hpp"
#include "listen_times.hpp"

namespace ontime::listen {
namespace {

using namespace std::chrono_literals;
using testing::Contains;
using testing::HasSubstr;
using transport::Heard;

class Script final : public transport::Hearing {
 public:
  explicit Script(std::vector<Heard> all) : all_(std::move(all)) {}
  void take(const std::function<void(const Heard&)>& hear) override {
    for (const auto& heard : std::exchange(all_, {})) hear(heard);
  }
  std::vector<std::string> remarks() override { return {"a remark"}; }

 private:
  std::vector<Heard> all_;
};

constexpr std::int64_t begin_ns = 1'700'000'000'000 * ms;

Heard heard(std::uint64_t sequence, std::int64_t age_ns = ms, bool is_one_host = true) {
  const auto stamp_ns = begin_ns + static_cast<std::int64_t>(sequence) * 10 * ms;
  return {.topic = "rt/cmd_vel",
          .writer = {1, 2, 3},
          .sequence = sequence,
          .stamp_ns = stamp_ns,
          .at_ns = stamp_ns + age_ns,
          .is_one_host = is_one_host};
}

Findings findings_of(std::vector<Heard> all, const Limits& limits = {}, std::vector<Row>* rows = nullptr) {
  const auto sensor = as_reader(std::make_unique<Script>(std::move(all)), limits);
  if (rows != nullptr) sensor->keep_rows([rows](const Row& row) { rows->push_back(row); });
  EXPECT_TRUE(sensor->listen_for(1ms));
  return sensor->findings();
}

TEST(Reader, NumbersThatDoNotComeAreLost) {
  const auto flows = findings_of({heard(5), heard(6), heard(9), heard(10)}).flows;
  ASSERT_EQ(flows.size(), 1U);
  EXPECT_EQ(flows[0].topic, "/cmd_vel");
  EXPECT_EQ(flows[0].messages, 4U);
  EXPECT_EQ(flows[0].lost, 2U);
  EXPECT_THAT(flows[0].writer.name, HasSubstr("at this machine"));
}

TEST(Reader, OldMessagesAndGapsAreLate) {
  const auto flow = findings_of({heard(1), heard(2, 8 * ms), heard(3), heard(6)},
                                {.deadline = 25ms, .period = {}, .age = 5ms})
                        .flows.at(0);
  EXPECT_EQ(flow.late, 2U);
  ASSERT_TRUE(flow.age);
  EXPECT_EQ(flow.age->max_ns(), 8 * ms);
}

TEST(Reader, MessagesOfAnotherMachineHaveNoAge) {
  EXPECT_FALSE(findings_of({heard(1, ms, false), heard(2, ms, false)}).flows.at(0).age);
}

TEST(Reader, EachLossHasARow) {
  std::vector<Row> rows;
  const auto flow = findings_of({heard(5), heard(6), heard(9), heard(8), heard(10)}, {}, &rows).flows.at(0);
  EXPECT_EQ(flow.lost, 1U);
  std::int64_t lost = 0;
  for (const auto& row : rows)
    if (row.quantity == Row::Quantity::age) lost += (row.to_ns == 0 ? 1 : 0) - (row.was_lost ? 1 : 0);
  EXPECT_EQ(lost, 1);
}

TEST(Reader, RowsBeginNearZero) {
  std::vector<Row> rows;
  findings_of({heard(1), heard(2), heard(3)}, {}, &rows);
  ASSERT_EQ(rows.size(), 5U) << "three ages and two periods";
  for (const auto& row : rows) {
    EXPECT_GE(row.from_ns, 0);
    EXPECT_LT(row.to_ns, 2'000 * ms);
  }
}

TEST(Reader, RemarksIncludeThoseOfTheTransport) {
  const auto remarks = findings_of({}).remarks;
  EXPECT_THAT(remarks, Contains("a remark"));
  EXPECT_THAT(remarks, Contains(HasSubstr("--reader")));
}

}  // namespace
}  // namespace ontime::listen

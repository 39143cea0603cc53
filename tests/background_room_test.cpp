// SPDX-License-Identifier: Apache-2.0
// How much load fits into this machine's memory and disk.
#include <string>

#include <gmock/gmock.h>

#include "background/background.hpp"

namespace ontime::background {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr std::uint64_t mib = 1 << 20;

TEST(LoadsRoom, DefaultsAreThoseOfThePaper) {
  Room room{4096 * mib, 8192 * mib, false};
  const auto fitted = fit({.vm = 2, .hdd = 2}, room);
  EXPECT_EQ(fitted.workers.vm_bytes, 256 * mib);
  EXPECT_EQ(fitted.workers.hdd_bytes, 1024 * mib);
  EXPECT_EQ(fitted.scaled, "");
  EXPECT_EQ(room.memory_bytes, (4096 - 512) * mib);
  EXPECT_EQ(room.disk_bytes, (8192 - 2048) * mib);
}

TEST(LoadsRoom, DefaultsAreReducedAndReportedIfRoomIsSmall) {
  Room room{300 * mib, 900 * mib, false};
  const auto fitted = fit({.vm = 4, .hdd = 3}, room);
  EXPECT_EQ(fitted.workers.vm_bytes, 75 * mib);
  EXPECT_EQ(fitted.workers.hdd_bytes, 300 * mib);
  EXPECT_THAT(fitted.scaled,
              AllOf(HasSubstr("75 MiB"), HasSubstr("256 MiB"), HasSubstr("300 MiB"), HasSubstr("1024 MiB")));
}

TEST(LoadsRoom, IsNotMoreThanItsControlGroupHasLeft) {
  EXPECT_EQ(room_for("/", machine::GroupMemory{100 * mib, 30 * mib}).memory_bytes, 60 * mib);
  EXPECT_EQ(room_for("/", machine::GroupMemory{100 * mib, 200 * mib}).memory_bytes, 0u);
  EXPECT_GT(room_for("/", {}).memory_bytes, 60 * mib);
  EXPECT_GT(room_for("/", machine::GroupMemory{UINT64_MAX, 30 * mib}).memory_bytes, 60 * mib);
}

TEST(LoadsRoom, HddWorkersThatWriteToMemoryAreReported) {
  Room room{4096 * mib, 8192 * mib, true};
  EXPECT_THAT(fit({.hdd = 1}, room).scaled, AllOf(HasSubstr("tmpfs"), HasSubstr("TMPDIR")));
  EXPECT_EQ(fit({.vm = 1}, room).scaled, "");
}

TEST(LoadsRoom, StatedSizesThatHaveNoRoomAreRefused) {
  const auto refused = [](const Workers& workers, Room room) {
    try {
      fit(workers, room);
    } catch (const Error& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  const Room small{300 * mib, 300 * mib, false};
  EXPECT_THAT(refused({.vm = 4, .vm_bytes = 256 * mib}, small),
              AllOf(HasSubstr("4 vm workers of 256 MiB each"), HasSubstr("300 MiB")));
  EXPECT_THAT(refused({.hdd = 2, .hdd_bytes = 2048 * mib}, small), HasSubstr("more disk"));
  EXPECT_THAT(refused({.vm = 2, .vm_bytes = UINT64_MAX / 2 + 1}, small), HasSubstr("more memory"));
  // On a tmpfs what is written is memory, too.
  EXPECT_THAT(refused({.vm = 1, .hdd = 1, .vm_bytes = 200 * mib, .hdd_bytes = 200 * mib},
                      {300 * mib, 900 * mib, true}),
              HasSubstr("tmpfs"));
  EXPECT_EQ(refused({.vm = 1, .vm_bytes = 256 * mib}, small), "");
}

}  // namespace
}  // namespace ontime::background

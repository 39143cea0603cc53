// SPDX-License-Identifier: Apache-2.0
// Concurrent traffic, by iperf3 over loopback.
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "background/background.hpp"
#include "background/iperf.hpp"
#include "background_processes.hpp"

namespace ontime::background {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;
using testing::AllOf;
using testing::HasSubstr;
using testing::IsEmpty;

TEST(Iperf, IntervalsOfBothEndsAreRead) {
  const auto sent = parse_interval("[  5]   0.20-0.40   sec  1953 KBytes  80010 Kbits/sec  1361  ");
  ASSERT_TRUE(sent);
  EXPECT_DOUBLE_EQ(sent->to_s, 0.4);
  EXPECT_NEAR(sent->bits, 16'002'000, 1);
  const auto received =
      parse_interval("[  6]   1.00-1.50   sec  24.4 KBytes   999 Kbits/sec  0.004 ms  0/17 (0%)  ");
  ASSERT_TRUE(received);
  EXPECT_NEAR(received->bits, 499'500, 1);
  const auto nothing =
      parse_interval("[  6]   1.50-1.70   sec  0.00 Bytes  0.00 Kbits/sec  0.004 ms  0/0 (0%)  ");
  ASSERT_TRUE(nothing);
  EXPECT_EQ(nothing->bits, 0);
}

TEST(Iperf, SumsAndOtherLinesAreIgnored) {
  for (const auto* line :
       {"", "Server listening on 5201 (test #1)",
        "[ ID] Interval           Transfer     Bitrate         Total Datagrams",
        "[  6]   0.00-2.00   sec  19.1 MBytes  80000 Kbits/sec  0.000 ms  0/13600 (0%)  sender",
        "[  6]   0.00-2.00   sec  19.1 MBytes  80000 Kbits/sec  0.001 ms  0/13600 (0%)  receiver",
        "[  5] local 127.0.0.1 port 44468 connected to 127.0.0.1 port 5201",
        "[  5]   2.00-1.00   sec  19.1 MBytes  80000 Kbits/sec  7"})
    EXPECT_FALSE(parse_interval(line)) << line;
}

// On loopback, each test on ports of its own.
class Iperf3 : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!fs::exists("/usr/bin/iperf3")) GTEST_SKIP() << "iperf3 is not installed";
  }
  static Stream serving(int port) { return {.serves = true, .address = "127.0.0.1", .port = port}; }
  static Stream asking(int port, bool receives) {
    return {.receives = receives,
            .address = "127.0.0.1",
            .port = port,
            .bits_per_s = 4'000'000,
            .datagram_bytes = 1000};
  }
  static std::string error_of(const Stream& stream) {
    try {
      const auto running = traffic(stream);
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  }
  static std::vector<process::Stat> left() {
    return where([](const process::Stat& process) { return process.parent == getpid(); });
  }
};

TEST_F(Iperf3, BothEndsReportTheRate) {
  for (const bool receives : {false, true}) {
    const auto server = traffic(serving(7801));
    const auto client = traffic(asking(7801, receives));
    // An end that a busy machine held up at first has the rate later.
    const auto has_rate = [](auto& end) {
      const auto moved = end.moved();
      return moved.seconds > 0.5 && std::abs(moved.bits / moved.seconds - 4e6) < 2e6;
    };
    const auto enough = [&] { return has_rate(*client) && has_rate(*server); };
    for (int look = 0; look < 1000 && !enough(); ++look) std::this_thread::sleep_for(10ms);
    for (const auto* end : {&client, &server}) {
      const auto moved = (*end)->moved();
      EXPECT_NEAR(moved.bits / moved.seconds, 4e6, 2e6);
      EXPECT_TRUE((*end)->running());
    }
  }
  EXPECT_THAT(left(), IsEmpty());
}

TEST_F(Iperf3, OfRootRunsAsNobodyWithoutPrivileges) {
  if (geteuid() != 0) GTEST_SKIP() << "needs root";
  const auto server = traffic(serving(7806));
  const auto client = traffic(asking(7806, true));
  const auto ours = where([](const process::Stat& process) {
    return process.parent == getpid() && process.name.starts_with("iperf3");
  });
  ASSERT_EQ(ours.size(), 2u);
  for (const auto& process : ours) {
    std::ifstream status("/proc/" + std::to_string(process.pid) + "/status");
    for (std::string line; std::getline(status, line);) {
      if (line.starts_with("Uid:")) {
        EXPECT_EQ(line, "Uid:\t65534\t65534\t65534\t65534");
      }
      if (line.starts_with("CapPrm:") || line.starts_with("CapEff:")) {
        EXPECT_THAT(line, HasSubstr("\t0000000000000000"));
      }
      if (line.starts_with("NoNewPrivs:")) {
        EXPECT_EQ(line, "NoNewPrivs:\t1");
      }
    }
  }
}

TEST_F(Iperf3, ServerEndsWithItsClient) {
  const auto server = traffic(serving(7802));
  { const auto client = traffic(asking(7802, false)); }
  for (int look = 0; look < 1000 && server->running(); ++look) std::this_thread::sleep_for(10ms);
  EXPECT_FALSE(server->running());
}

TEST_F(Iperf3, ForeignClientGetsAtMostTwiceTheRate) {
  auto serves = serving(7805), greedy = asking(7805, true);
  serves.bits_per_s = 4'000'000;
  greedy.bits_per_s = 9'000'000;
  const auto server = traffic(serves);
  EXPECT_THAT(error_of(greedy), HasSubstr("ended at once"));
}

TEST_F(Iperf3, ErrorQuotesOutputOfIperf3) {
  EXPECT_THAT(error_of(asking(7803, false)), AllOf(HasSubstr("ended at once"), HasSubstr("refused")));
  const auto server = traffic(serving(7803));
  EXPECT_THAT(error_of(serving(7803)), HasSubstr("in use"));
}

TEST_F(Iperf3, SaysWhatToInstall) {
  // NOLINTBEGIN(concurrency-mt-unsafe): there is no other thread
  const auto* const path = std::getenv("PATH");
  const std::string before = path != nullptr ? path : "";
  setenv("PATH", "/nonexistent", 1);
  const auto alone = error_of(serving(7804));
  setenv("PATH", before.c_str(), 1);
  // NOLINTEND(concurrency-mt-unsafe)
  EXPECT_THAT(alone, HasSubstr("apt install iperf3"));
  auto elsewhere = serving(7804);
  elsewhere.place = {"env", "PATH=/nonexistent"};  // where the end lives, another program looks for it
  EXPECT_THAT(error_of(elsewhere), HasSubstr("apt install iperf3"));
  elsewhere.place = {"sh", "-c", "echo 'setpriv: Datei nicht gefunden'; exit 127"};
  EXPECT_THAT(error_of(elsewhere), HasSubstr("apt install iperf3")) << "in any language";
  elsewhere.place = {
      "sh", "-c",
      "echo 'iperf3: error while loading shared libraries: libsctp.so.1: cannot open shared object "
      "file: No such file or directory'; exit 127"};
  EXPECT_THAT(error_of(elsewhere),
              testing::AllOf(HasSubstr("libsctp.so.1"), testing::Not(HasSubstr("apt install"))));
}

}  // namespace
}  // namespace ontime::background

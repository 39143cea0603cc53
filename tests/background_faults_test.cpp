// SPDX-License-Identifier: Apache-2.0
// The link's faults, on the loopback of network namespaces of their own.
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <optional>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include "background/background.hpp"
#include "background/child.hpp"
#include "background/kinds.hpp"
#include "own_run.hpp"

namespace ontime::background {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

constexpr const char* netns = "ontime-faults";

class LinkFaults : public testing::Test {
 protected:
  void SetUp() override {
    if (geteuid() != 0) GTEST_SKIP() << "the link's faults need root";
    journal::add_namespace(journal_, netns);
    journal::within_namespace(netns, [] { output_of({"ip", "link", "set", "lo", "up"}, "iproute2"); });
  }
  // What is there, as nft says it.
  static std::string tables() {
    std::string found;
    journal::within_namespace(netns, [&] { found = nft("list ruleset"); });
    return found;
  }
  // Sends so many datagrams to itself; returns how many came.
  static int exchange(int datagrams) {
    int came = 0;
    journal::within_namespace(netns, [&] {
      const int fd = socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
      sockaddr_in self{};
      self.sin_family = AF_INET;
      self.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
      self.sin_port = htons(7900);
      const auto* const address = reinterpret_cast<const sockaddr*>(&self);
      EXPECT_EQ(bind(fd, address, sizeof self), 0);
      char message[100] = {};
      for (int i = 0; i < datagrams; ++i) {
        EXPECT_EQ(sendto(fd, message, sizeof message, 0, address, sizeof self), ssize_t{sizeof message})
            << "sending succeeds although the link loses the datagram";
        while (recv(fd, message, sizeof message, 0) > 0) ++came;
      }
      close(fd);
    });
    return came;
  }
  static std::string error_of(const Faults& faults) {
    try {
      check(faults);
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  }

  journal::Journal journal_{kinds()};
  const Link::Place here_{"controller", netns, "lo"};
};

TEST_F(LinkFaults, AreRemovedWithTheLink) {
  {
    const Link link(journal_, here_, {.loss = 0.01, .duplicates = 0.02, .cut = true}, {5201, 5202});
    EXPECT_THAT(tables(), HasSubstr("table netdev ontime-controller"));
    EXPECT_THAT(tables(), HasSubstr("table inet ontime-controller"));
  }
  EXPECT_THAT(tables(), IsEmpty());
}

// The qdiscs themselves are tried in the lab: this kernel may have none of them.
TEST_F(LinkFaults, QdiscIsAppliedOrRefusedByName) {
  for (const auto* name : {"prio", "taprio"}) {
    const auto words = std::string(name) + (name == std::string("prio") ? " bands 3" : "");
    const auto said = error_of({.qdisc = words});
    EXPECT_THAT(said, testing::AnyOf(IsEmpty(), testing::AllOf(HasSubstr("link.qdisc"),
                                                               HasSubstr(std::string("sch_") + name))));
    if (said.empty()) continue;
    EXPECT_ANY_THROW(Link(journal_, here_, {.qdisc = words}, {}));
    EXPECT_THAT(tables(), IsEmpty()) << "nothing is left of what was made before";
  }
  EXPECT_FALSE(conditions::is_qdisc("pfifo limit 3"));
  EXPECT_FALSE(conditions::is_qdisc(""));
  EXPECT_TRUE(conditions::is_qdisc("cbs idleslope 5000 sendslope -995000 hicredit 30 locredit -1470"));
  for (const auto* words : {"prio -batch x", "prio -b", "prio -", "cbs idleslope 5/6"})
    EXPECT_FALSE(conditions::is_qdisc(words)) << words;
  EXPECT_TRUE(conditions::is_qdisc("prio bands 3 priomap 1 2 2 2 1 2 0 0 1 1 1 1 1 1 1 1"));
}

TEST(Discipline, HasOthersBelowItsClasses) {
  const std::string etf = "etf clockid CLOCK_TAI delta 300000", words = "prio bands 3 below 1 " + etf;
  EXPECT_TRUE(conditions::is_qdisc(words));
  EXPECT_TRUE(conditions::is_qdisc(
      words + " below 2 cbs idleslope 5000 sendslope -995000 hicredit 30 locredit -1470"));
  EXPECT_TRUE(conditions::has_etf(words));
  EXPECT_TRUE(conditions::has_etf(etf));
  for (const auto* without : {"", "prio bands 3", "prio below 1 cbs etf"})
    EXPECT_FALSE(conditions::has_etf(without)) << without;
  for (const auto* wrong :
       {"below 1 etf", "prio below", "prio below 1", "prio below etf", "prio below 0 etf",
        "prio below 12345 etf", "prio below 1: etf", "prio below 1 pfifo", "prio below 1 etf below"})
    EXPECT_FALSE(conditions::is_qdisc(wrong)) << wrong;
}

TEST_F(LinkFaults, GiveMessagesAndTrafficAPriority) {
  {
    const Link link(journal_, here_, {.message_priority = 6, .traffic_priority = 11}, {5201, 5202});
    EXPECT_THAT(tables(),
                HasSubstr("udp dport != { 5201, 5202 } udp sport != { 5201, 5202 } meta priority set 0:6"));
    EXPECT_THAT(tables(), HasSubstr("udp sport { 5201, 5202 } meta priority set 0:b"));
    EXPECT_EQ(exchange(3), 3);
  }
  EXPECT_THAT(tables(), IsEmpty());
}

TEST_F(LinkFaults, MarkMessagesWithTheirDscp) {
  const Link link(journal_, here_, {.dscp = 46}, {5201});
  journal::within_namespace(netns, [] {
    nft("table inet seen {\n counter marked { }\n"
        " chain coming {\n  type filter hook input priority 0\n  udp dport 7900 ip dscp 46 counter name "
        "marked\n }\n}\n");
  });
  EXPECT_EQ(exchange(3), 3);
  EXPECT_THAT(tables(), HasSubstr("counter marked {\n\t\tpackets 3 "));
  journal::within_namespace(netns, [] { nft("delete table inet seen"); });
}

TEST_F(LinkFaults, LossDropsItsShareAndCountsIt) {
  const Link link(journal_, here_, {.loss = 0.25}, {});
  const int came = exchange(4000);
  EXPECT_NEAR(came, 3000, 200);  // seven standard deviations
  EXPECT_EQ(link.counts().lost, 4000U - static_cast<unsigned>(came)) << "each has its place";
}

TEST_F(LinkFaults, FullLossDropsAll) {
  const Link link(journal_, here_, {.loss = 1}, {});
  EXPECT_EQ(exchange(10), 0);
}

TEST_F(LinkFaults, DuplicatesAreSentOnceMore) {
  const Link link(journal_, here_, {.duplicates = 1}, {});
  EXPECT_EQ(exchange(100), 200);
  EXPECT_EQ(link.counts().duplicated, 100U);
}

TEST_F(LinkFaults, CutEndsByItself) {
  const Link link(journal_, here_, {.cut = true}, {});
  EXPECT_EQ(exchange(10), 10);
  link.cut(1h);
  EXPECT_EQ(exchange(10), 0);
  EXPECT_EQ(link.counts().cut_off, 10U);
  const Link::Place other{"component", netns, "lo"};
  {
    const Link again(journal_, other, {.cut = true}, {});
    again.cut(1ms);
  }
  EXPECT_THAT(tables(), Not(HasSubstr("ontime-component")));
}

TEST_F(LinkFaults, TrafficPortsAreNotCounted) {
  const Link link(journal_, here_, {}, {5201, 5202}), none(journal_, {"component", netns, "lo"}, {}, {7900});
  exchange(10);
  EXPECT_EQ(link.counts().sent_bytes, 10U * (100 + 28));
  EXPECT_EQ(link.counts().received_bytes, 10U * (100 + 28));
  EXPECT_EQ(none.counts().sent_bytes, 0U);
  EXPECT_THAT(tables(), Not(HasSubstr("netdev"))) << "who only counts has no part in what comes and goes";
}

TEST_F(LinkFaults, RemovedCountersAreAnError) {
  const Link link(journal_, here_, {.loss = 0.01}, {}), other(journal_, {"component", netns, "lo"}, {}, {});
  EXPECT_NO_THROW(link.counts());
  journal::within_namespace(netns, [] { nft("delete table netdev ontime-controller"); });
  EXPECT_THROW(link.counts(), Error);
  EXPECT_NO_THROW(other.counts());
  journal::within_namespace(netns, [] { nft("flush ruleset"); });
  EXPECT_THROW(other.counts(), Error);
}

TEST_F(LinkFaults, TableReplacedByAnotherProcessIsLeft) {
  const auto what = table_what(netns, "netdev", "controller");
  // What a journal says is made, by its name and its handle; one that was made anew since is another
  // process's.
  journal_.change(table_kind, what, journal::to_be_made);
  const auto first = table_kind.read(what);
  ASSERT_TRUE(first);
  journal::within_namespace(
      netns, [] { nft("delete table netdev ontime-controller; add table netdev ontime-controller"); });
  EXPECT_NE(table_kind.read(what), first);
  EXPECT_THROW(table_kind.write(what, journal::to_be_made, {}), journal::MadeByAnother);
  EXPECT_THAT(journal_.take_back(table_kind, what),
              testing::ElementsAre(HasSubstr("another program has changed it")));
  EXPECT_TRUE(table_kind.read(what)) << "it is left";
}

// Of the keeper's own network namespace: another ontime may be started in another one.
TEST(LocalFaults, AreNotGoneInAnotherNetworkNamespace) {
  if (geteuid() != 0) GTEST_SKIP() << "the link's faults need root";
  test::in_child([] {
    ASSERT_EQ(unshare(CLONE_NEWNET | CLONE_NEWNS), 0);
    ASSERT_EQ(mount("none", "/", nullptr, MS_REC | MS_PRIVATE, nullptr), 0);
    ASSERT_EQ(mount("none", "/run", "tmpfs", 0, "mode=755"), 0);
    test::Victim victim(
        [](journal::Journal& journal) {
          static std::optional<Link> link;  // until it is killed
          link.emplace(journal, Link::Place{"controller", "", "lo"}, Faults{.loss = 0.01},
                       std::vector<int>{});
          return "linked";
        },
        kinds());
    ASSERT_EQ(victim.said(), "linked");
    victim.kill_9();
    test::in_child([] {
      ASSERT_EQ(unshare(CLONE_NEWNET), 0);
      EXPECT_THAT(journal::revert_abandoned(kinds()), testing::Each(HasSubstr("not visible here")));
    });
    EXPECT_THAT(nft("list ruleset"), HasSubstr("table inet ontime-controller"));
    EXPECT_THAT(journal::revert_abandoned(kinds()), testing::SizeIs(2));
    EXPECT_THAT(nft("list ruleset"), IsEmpty());
  });
}

// A tc that keeps the root qdisc of all interfaces in a file, and refuses one below it. After the first try
// on loopback, what is in /run/meanwhile comes first.
class Disciplines : public testing::Test {
 protected:
  void inside(const std::function<void()>& body) const {
    if (geteuid() != 0) GTEST_SKIP() << "the link's faults need root";
    test::in_child([&] {
      ASSERT_EQ(unshare(CLONE_NEWNET | CLONE_NEWNS), 0);
      ASSERT_EQ(mount("none", "/", nullptr, MS_REC | MS_PRIVATE, nullptr), 0);
      ASSERT_EQ(mount("none", "/run", "tmpfs", 0, "mode=755"), 0);
      std::filesystem::create_directory("/run/bin");
      std::ofstream("/run/bin/tc") << R"(#!/bin/sh
case "$*" in
  "-statistics -json qdisc show dev lo") cat /run/statistics ;;
  "-json qdisc show dev lo") cat /run/qdiscs ;;
  "qdisc add dev lo root handle 6f74: "*)
    if [ -e /run/meanwhile ]; then
      cat /run/meanwhile >/run/qdiscs; echo "Exclusivity flag on"; exit 2
    fi
    echo "[{\"kind\": \"$8\", \"handle\": \"6f74:\", \"root\": true}]" >/run/qdiscs ;;
  "qdisc del dev lo root") echo '[]' >/run/qdiscs ;;
  "qdisc del dev lo root handle 6f74:") grep -q '"6f74:"' /run/qdiscs && echo '[]' >/run/qdiscs ;;
  *) echo "refused: $*"; exit 2 ;;
esac
)";
      std::filesystem::permissions("/run/bin/tc", std::filesystem::perms::owner_all);
      test::set("PATH", std::string("/run/bin:") + std::getenv("PATH"));  // NOLINT(concurrency-mt-unsafe)
      qdiscs("[]");
      body();
    });
  }
  static void qdiscs(const std::string& json) { std::ofstream("/run/qdiscs") << json << '\n'; }
  static std::string qdiscs() {
    std::ifstream file("/run/qdiscs");
    std::string line;
    std::getline(file, line);
    return line;
  }
  static constexpr const char* etf = "etf clockid CLOCK_TAI delta 300000";
  const Link::Place here_{"controller", "", "lo"};
};

TEST_F(Disciplines, OneThatIsRefusedBelowAnotherLeavesNone) {
  inside([&] {
    journal::Journal journal(kinds());
    const Faults faults{.qdisc = std::string("prio bands 3 below 1 ") + etf};
    EXPECT_THAT(
        test::error_of([&] { Link(journal, here_, faults, {}); }),
        testing::AllOf(HasSubstr("below 1: "),
                       HasSubstr("refused: qdisc add dev lo parent 6f74:1 handle 6f75: etf clockid")));
    EXPECT_EQ(qdiscs(), "[]");
    EXPECT_THAT(nft("list ruleset"), IsEmpty());
    EXPECT_THAT(journal.revert(), IsEmpty());
  });
}

TEST_F(Disciplines, OneThatAnotherProgramMakesJustBeforeIsLeft) {
  inside([&] {
    journal::Journal journal(kinds());
    const std::string others = R"([{"kind": "tbf", "handle": "8001:", "root": true}])";
    std::ofstream("/run/meanwhile") << others << '\n';
    EXPECT_THAT(test::error_of([&] { Link(journal, here_, {.qdisc = etf}, {}); }),
                HasSubstr("Exclusivity flag on"));
    EXPECT_EQ(qdiscs(), others);
  });
}

TEST_F(Disciplines, OneOfAnotherProgramIsLeft) {
  inside([&] {
    journal::Journal journal(kinds());
    const std::string others = R"([{"kind": "tbf", "handle": "8001:", "root": true}])";
    qdiscs(others);
    EXPECT_THAT(test::error_of([&] { Link(journal, here_, {.qdisc = etf}, {}); }),
                HasSubstr("tc qdisc del dev lo root"));
    EXPECT_EQ(qdiscs(), others);
    qdiscs("[]");
    {
      const Link link(journal, here_, {.qdisc = etf}, {});
      qdiscs(others);
    }
    EXPECT_EQ(qdiscs(), others);
  });
}

TEST_F(Disciplines, MessagesAreCountedOverAllEtfUntilAnotherRemovesThem) {
  inside([&] {
    {
      journal::Journal journal(kinds());
      const Link link(journal, here_, {.qdisc = etf}, {});
      EXPECT_THAT(qdiscs(), HasSubstr("etf"));
      std::ofstream("/run/statistics") << R"([{"kind": "mqprio", "packets": 90, "drops": 9},
        {"kind": "etf", "packets": 5, "drops": 1}, {"kind": "etf", "packets": 7, "drops": 2}])";
      const auto counts = link.counts();
      ASSERT_TRUE(counts.etf);
      EXPECT_EQ(counts.etf->launched, 12U);
      EXPECT_EQ(counts.etf->dropped, 3U);
      for (const auto& [said, words] : {std::pair("[]", "another process removed it"), {"", "not JSON"}}) {
        std::ofstream("/run/statistics") << said;
        EXPECT_THAT(test::error_of([&] { link.counts(); }), HasSubstr(words));
      }
    }
    EXPECT_EQ(qdiscs(), "[]");
  });
}

TEST_F(LinkFaults, NothingElseIsEverTouched) {
  for (const auto* what : {"", "/netdev/mine", "x/ip/ontime-a", "../netdev/ontime-a", "a/b/netdev/ontime-a",
                           "x/inet/ontime-", "x/inet/ontime-a;flush ruleset", "x y/inet/ontime-a"})
    EXPECT_FALSE(table_kind.accepts(what)) << what;
  EXPECT_TRUE(table_kind.accepts("/inet/ontime-controller"));
  for (const auto* what : {"", "eth0", "/", "/eth 0", "/..", "/a/b", "../eth0/"})
    EXPECT_FALSE(qdisc_kind.accepts(what)) << what;
  EXPECT_TRUE(qdisc_kind.accepts("ontime-controller/eth0"));
  EXPECT_TRUE(qdisc_kind.accepts("ontime-controller/eth0/prio bands 3"));
  for (const auto* what :
       {"x/eth0/", "x/eth0/pfifo", "x/eth0/prio -batch", "x/eth0/prio bands 3;", "x/eth0/prio/a"})
    EXPECT_FALSE(qdisc_kind.accepts(what)) << what;
  EXPECT_EQ(table_kind.read("no-such-namespace/inet/ontime-a"), std::nullopt) << "gone with its namespace";
}

TEST_F(LinkFaults, FaultThatTheKernelLacksIsNamed) {
  EXPECT_EQ(error_of({.loss = 0.5, .duplicates = 0.5, .cut = true}), "");
  const auto said = error_of({.delay = 1ms, .jitter = 100us, .reordered = 0.1});
  if (said.empty()) GTEST_SKIP() << "this kernel has netem";
  EXPECT_THAT(said, HasSubstr("link.delay"));
  EXPECT_THAT(said, HasSubstr("sch_netem"));
}

TEST_F(LinkFaults, CheckWithoutRootSaysThatItNeedsIt) {
  test::in_child([] {
    test::become_ordinary_user();
    EXPECT_THROW(check({.loss = 0.5}), NeedsRoot);
  });
}

TEST_F(LinkFaults, InvalidInterfaceIsRefused) {
  EXPECT_THROW(Link(journal_, {"controller", netns, "lo; flush ruleset"}, {.loss = 1}, {}), Error);
  EXPECT_ANY_THROW(Link(journal_, {"controller", netns, "eth9"}, {.loss = 1}, {}));
  EXPECT_THAT(tables(), IsEmpty()) << "half of it would be worse than nothing";
}

}  // namespace
}  // namespace ontime::background

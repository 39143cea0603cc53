// SPDX-License-Identifier: Apache-2.0
// Two machines on one.
#include <filesystem>
#include <string>
#include <thread>

#include <arpa/inet.h>
#include <fcntl.h>
#include <gmock/gmock.h>
#include <netinet/in.h>
#include <poll.h>
#include <sched.h>
#include <sys/socket.h>
#include <unistd.h>

#include "journal/journal.hpp"
#include "machine/command.hpp"
#include "machine/machine.hpp"
#include "own_run.hpp"

namespace ontime::machine {
namespace {

namespace fs = std::filesystem;
using test::error_of;
using test::in_child;
using test::set;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

class Namespaces : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!may_join_namespaces()) GTEST_SKIP() << "needs root with CAP_SYS_ADMIN and CAP_NET_ADMIN";
    if (!test::has_own_run) GTEST_SKIP() << "no mount namespace of its own";
    if (!there_is_ip()) GTEST_SKIP() << "iproute2 is not installed";
  }
  static bool there_is_ip() {
    return error_of([] { iproute2({"ip", "-Version"}); }).empty();
  }
};

bool exist() {
  return fs::exists("/run/netns/ontime-controller") || fs::exists("/run/netns/ontime-component");
}

// A UDP socket that lives in that namespace, which any process may use.
int socket_in(const std::string& name, const std::string& address) {
  int fd = -1;
  std::thread([&] {
    const int other = open(("/run/netns/" + name).c_str(), O_RDONLY | O_CLOEXEC);
    EXPECT_EQ(setns(other, CLONE_NEWNET), 0);
    close(other);
    fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    sockaddr_in local{};
    local.sin_family = AF_INET;
    local.sin_port = htons(7411);
    inet_pton(AF_INET, address.c_str(), &local.sin_addr);
    EXPECT_EQ(bind(fd, reinterpret_cast<sockaddr*>(&local), sizeof local), 0);
  }).join();
  return fd;
}

void send_to(int fd, const std::string& address) {
  sockaddr_in peer{};
  peer.sin_family = AF_INET;
  peer.sin_port = htons(7411);
  inet_pton(AF_INET, address.c_str(), &peer.sin_addr);
  EXPECT_EQ(sendto(fd, "x", 1, 0, reinterpret_cast<sockaddr*>(&peer), sizeof peer), 1) << address;
}

bool arrives(int fd) {
  pollfd readable{fd, POLLIN, 0};
  char byte = 0;
  return poll(&readable, 1, 60'000) == 1 && recv(fd, &byte, 1, 0) == 1;
}

TEST_F(Namespaces, TheFirstMessageArrivesAndNothingStays) {
  {
    journal::Journal journal;
    const auto ends = join_namespaces(journal);
    ASSERT_THAT(ends, SizeIs(2));
    EXPECT_THAT(ends[0].prefix, ElementsAre("ip", "netns", "exec", "ontime-controller"));
    EXPECT_EQ(ends[1].name, "ontime-component");
    for (const auto& end : ends) {
      EXPECT_LE(end.interface.size(), 15u);
      const auto shown =
          iproute2({"ip", "-netns", end.name, "-oneline", "address", "show", "dev", end.interface});
      EXPECT_THAT(shown, HasSubstr(end.address + "/24"));
    }
    const int controller = socket_in("ontime-controller", ends[0].address);
    const int component = socket_in("ontime-component", "0.0.0.0");
    send_to(controller, ends[1].address);
    EXPECT_TRUE(arrives(component));
    send_to(component, ends[0].address);
    EXPECT_TRUE(arrives(controller));

    const int discovery = socket_in("ontime-controller", "239.255.0.1");
    ip_mreq group{};
    inet_pton(AF_INET, "239.255.0.1", &group.imr_multiaddr);
    EXPECT_EQ(setsockopt(discovery, IPPROTO_IP, IP_ADD_MEMBERSHIP, &group, sizeof group), 0);
    send_to(component, "239.255.0.1");
    EXPECT_TRUE(arrives(discovery));
    for (const int fd : {controller, component, discovery}) close(fd);
  }
  EXPECT_FALSE(exist());
}

// Seen in the lab as well, for a kernel may lack either.
TEST_F(Namespaces, HaveAWireOfARateAndAVlan) {
  for (const auto& [wire, lacking] :
       {std::pair{Wire{.bits_per_s = 10'000'000}, "wire.rate: this kernel has not"},
        std::pair{Wire{.vlan = 5}, "wire.vlan: "}}) {
    try {
      journal::Journal journal;
      const auto ends = join_namespaces(journal, {"component"}, {}, wire);
      EXPECT_EQ(ends[0].interface, wire.vlan > 0 ? "vlan5" : "to-component");
      if (wire.vlan > 0) {
        EXPECT_THAT(
            iproute2({"ip", "-netns", ends[0].name, "-details", "link", "show", "vlan5"}),
            AllOf(HasSubstr("id 5 "), HasSubstr("numtxqueues 8"), HasSubstr("egress-qos-map { 1:1 2:2")));
      } else {
        EXPECT_THAT(iproute2({"tc", "-netns", ends[0].name, "qdisc", "show", "dev", ends[0].interface}),
                    AllOf(HasSubstr("netem"), HasSubstr("rate 10Mbit")));
      }
      const int component = socket_in(ends[1].name, ends[1].address);
      const int controller = socket_in(ends[0].name, ends[0].address);
      send_to(controller, ends[1].address);
      EXPECT_TRUE(arrives(component));
      for (const int fd : {controller, component}) close(fd);
    } catch (const Error& error) {
      EXPECT_THAT(error.what(), HasSubstr(lacking));
    }
    EXPECT_FALSE(exist());
  }
}

TEST_F(Namespaces, SeveralComponentsAreOnOneWire) {
  {
    journal::Journal journal;
    const auto ends = join_namespaces(journal, {"left_arm", "base"});
    ASSERT_THAT(ends, SizeIs(3));
    EXPECT_EQ(ends[1].name, "ontime-left-arm");
    EXPECT_EQ(ends[0].interface, "to-components");
    const int controller = socket_in(ends[0].name, ends[0].address);
    for (const auto& other : {ends[1], ends[2]}) {
      EXPECT_EQ(interface_to(other.address, ends[0].name), "to-components");
      const int component = socket_in(other.name, "0.0.0.0");
      send_to(controller, other.address);
      EXPECT_TRUE(arrives(component)) << other.host;
      send_to(component, ends[0].address);
      EXPECT_TRUE(arrives(controller)) << other.host;
      close(component);
    }
    close(controller);
  }
  for (const auto* name : {"ontime-controller", "ontime-left-arm", "ontime-base"})
    EXPECT_FALSE(fs::exists(fs::path("/run/netns") / name)) << name;
}

TEST_F(Namespaces, HaveTheirInterfacesFoundByTheRoute) {
  journal::Journal journal;
  const auto ends = join_namespaces(journal);
  const auto &own = ends[0], &other = ends[1];
  EXPECT_EQ(interface_to(other.address, own.name), own.interface);
  EXPECT_EQ(interface_to(own.address, own.name), "lo") << "a machine sends so to itself";
  EXPECT_EQ(interface_of(own.address, own.name), own.interface);
  EXPECT_THAT(error_of([&] { interface_to("10.1.1.1", own.name); }), HasSubstr("10.1.1.1"));
  EXPECT_THAT(error_of([&] { interface_of(other.address, own.name); }), HasSubstr(other.address));
  EXPECT_THAT(error_of([&] { interface_to(other.address, "ontime-none"); }), HasSubstr("ontime-none"));
}

TEST_F(Namespaces, TellWhenTheirLinkIsDown) {
  journal::Journal journal;
  const auto ends = join_namespaces(journal);
  const auto watch_of = [&](const NamespaceEnd& end) {
    std::unique_ptr<LinkWatch> watch;
    journal::within_namespace(end.name, [&] { watch = std::make_unique<LinkWatch>(end.interface); });
    return watch;
  };
  const auto own = watch_of(ends[0]), other = watch_of(ends[1]);
  // Within ten seconds: of a carrier the kernel tells once a second.
  const auto told = [](const LinkWatch& watch, std::size_t count, bool is_over) {
    const auto is_told = [&] {
      return watch.downs().size() == count && (watch.downs().back().to_ns != 0) == is_over;
    };
    for (int tries = 0; tries < 1000 && !is_told(); ++tries)
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    return is_told();
  };
  for (std::size_t times = 1; times <= 2; ++times) {
    for (const auto* what : {"down", "up"}) {
      iproute2({"ip", "-netns", ends[1].name, "link", "set", ends[1].interface, what});
      for (const auto* watch : {own.get(), other.get()})
        ASSERT_TRUE(told(*watch, times, what == std::string("up"))) << what << " " << times;
    }
    const auto taken = other->downs().back(), without = own->downs().back();
    EXPECT_TRUE(taken.taken);
    EXPECT_FALSE(without.taken) << "the peer has no carrier meanwhile";
    EXPECT_LT(taken.from_ns, taken.to_ns);
  }
  iproute2({"ip", "-netns", ends[1].name, "link", "delete", ends[1].interface});
  EXPECT_TRUE(told(*other, 3, false)) << "for ever";
  EXPECT_TRUE(other->downs().back().taken);
}

TEST_F(Namespaces, CanBeMadeAgainAtOnce) {
  for (int round = 0; round < 3; ++round) {
    journal::Journal journal;
    EXPECT_EQ(error_of([&] { join_namespaces(journal); }), "");
  }
}

TEST_F(Namespaces, ForeignOneIsLeftAlone) {
  iproute2({"ip", "netns", "add", "ontime-component"});
  {
    journal::Journal journal;
    EXPECT_THAT(error_of([&] { join_namespaces(journal); }), HasSubstr("ip netns delete ontime-component"));
  }
  EXPECT_TRUE(fs::exists("/run/netns/ontime-component"));
  EXPECT_FALSE(fs::exists("/run/netns/ontime-controller"));
  iproute2({"ip", "netns", "delete", "ontime-component"});
}

TEST_F(Namespaces, AreNotJoinedByWhatWouldNotComeBack) {
  iproute2({"ip", "link", "add", "ontime-left", "type", "veth", "peer", "name", "ontime-right"});
  {
    journal::Journal journal;
    EXPECT_THAT(error_of([&] {
                  join_namespaces(journal, {"component"}, Cable{"ontime-left", "ontime-right"});
                }),
                AllOf(HasSubstr("ontime-left"), HasSubstr("not hardware")));
    EXPECT_FALSE(exist());
  }
  iproute2({"ip", "link", "delete", "ontime-left"});
}

// A veth pair, which /sys shows as hardware: two network cards with a cable between them.
TEST_F(Namespaces, CableIsUsedUnlessAProgramMayUseAnEnd) {
  in_child([] {
    ASSERT_EQ(unshare(CLONE_NEWNET | CLONE_NEWNS), 0);
    ASSERT_EQ(mount("none", "/sys/class/net", "tmpfs", 0, nullptr), 0);
    for (const auto* name : {"card0", "card1"})
      fs::create_directories(fs::path("/sys/class/net") / name / "device");
    iproute2({"ip", "link", "add", "card0", "type", "veth", "peer", "name", "card1"});
    const Cable cable{"card0", "card1"};
    journal::Journal journal;
    const auto refused = [&] { return error_of([&] { join_namespaces(journal, {"component"}, cable); }); };
    iproute2({"ip", "link", "set", "card1", "up"});
    EXPECT_THAT(refused(), HasSubstr("ip link set card1 down"));
    iproute2({"ip", "link", "set", "card1", "down"});
    iproute2({"ip", "address", "add", "10.9.8.1/24", "dev", "card0"});
    EXPECT_THAT(refused(), HasSubstr("ip address flush dev card0"));
    EXPECT_FALSE(exist());
    iproute2({"ip", "address", "flush", "dev", "card0"});
    fs::create_symlink("../br0", "/sys/class/net/card0/master");
    EXPECT_THAT(refused(), AllOf(HasSubstr("card0"), HasSubstr("br0"), HasSubstr("nomaster")));
    EXPECT_FALSE(exist());
    fs::remove("/sys/class/net/card0/master");

    const auto ends = join_namespaces(journal, {"component"}, cable);
    EXPECT_EQ(interface_to(ends[1].address, ends[0].name), "card0");
    EXPECT_EQ(interface_to(ends[0].address, ends[1].name), "card1");
    const int component = socket_in(ends[1].name, ends[1].address);
    const int controller = socket_in(ends[0].name, ends[0].address);
    send_to(controller, ends[1].address);
    EXPECT_TRUE(arrives(component));
    for (const int fd : {controller, component}) close(fd);
    EXPECT_THAT(journal.revert(), IsEmpty());
    EXPECT_FALSE(exist());
  });
}

TEST_F(Namespaces, NamespacesOfAKilledProcessAreRemoved) {
  test::Victim victim([](journal::Journal& journal) { return join_namespaces(journal)[1].name; });
  ASSERT_EQ(victim.said(), "ontime-component");
  EXPECT_TRUE(exist());
  victim.kill_9();
  EXPECT_THAT(journal::revert_abandoned(),
              ElementsAre(HasSubstr("ontime-component"), HasSubstr("ontime-controller")));
  EXPECT_FALSE(exist());
}

TEST_F(Namespaces, SaysWhatToInstall) {
  in_child([] {
    set("PATH", "/there/is/none");
    journal::Journal journal;
    EXPECT_THAT(error_of([&] { join_namespaces(journal); }), HasSubstr("apt install iproute2"));
    EXPECT_THAT(journal.revert(), IsEmpty());
    EXPECT_FALSE(exist());
  });
}

TEST(NamespacesOfOthers, NeedPrivilege) {
  in_child([] {
    if (geteuid() == 0) test::become_ordinary_user();
    EXPECT_FALSE(may_join_namespaces());
    journal::Journal journal;
    EXPECT_THAT(error_of([&] { join_namespaces(journal); }), HasSubstr("run as root"));
  });
}

}  // namespace
}  // namespace ontime::machine

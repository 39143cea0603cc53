// SPDX-License-Identifier: Apache-2.0
// The user's own XML, of either vendor, and the link under test.
#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <set>

#include <net/if.h>
#include <sched.h>
#include <sys/socket.h>
#include <unistd.h>

#include "dds_ends.hpp"
#include "dds_library.hpp"
#include "transport/fastdds/profiles.hpp"

namespace {

constexpr const char* fast_load =
    "_ZN8eprosima7fastdds3dds24DomainParticipantFactory24load_XML_profiles_stringEPKcm";
constexpr const char* fast_log =
    "_ZN8eprosima7fastdds3dds3Log8QueueLogERKNSt7__cxx1112basic_stringIcSt11char_traitsIcESaIcEEERKNS2_"
    "7ContextENS2_4KindE";

bool another_participant_speaks = false;  // while profiles are loaded

}  // namespace

// This program stands between the transport and its middleware's function that loads profiles.
extern "C" std::uint32_t load_profiles(void* factory, const char* xml, std::size_t bytes) asm(
    "_ZN8eprosima7fastdds3dds24DomainParticipantFactory24load_XML_profiles_stringEPKcm");
extern "C" std::uint32_t load_profiles(void* factory, const char* xml, std::size_t bytes) {
  using ontime::transport::test::in_library;
  struct Context {
    const char* file;
    int line;
    const char *function, *category;
  };
  enum class Kind { error };
  const auto result =
      in_library<decltype(load_profiles)>("lib" ONTIME_TEST_FASTDDS ".so", fast_load)(factory, xml, bytes);
  if (another_participant_speaks)
    in_library<void(const std::string&, const Context&, Kind)>("lib" ONTIME_TEST_FASTDDS ".so", fast_log)(
        "its network is gone", {"", 0, "", "RTPS_MSG_OUT"}, Kind::error);
  return result;
}

namespace ontime::transport::test {
namespace {

constexpr bool is_3 = std::string_view(ONTIME_TEST_FASTDDS) == "fastdds";
constexpr auto names = is_3 ? fastdds::names_of_3 : fastdds::names_of_2;

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

void expect_contains(const std::string& text, const std::string& part) {
  EXPECT_TRUE(contains(text, part)) << "\"" << part << "\" is not in: " << text;
}

class UsersXml : public testing::Test {
 protected:
  explicit UsersXml(std::string transport) : transport_(std::move(transport)) {}
  ~UsersXml() override {
    for (const char* variable : variables_) unsetenv(variable);  // NOLINT(concurrency-mt-unsafe)
    std::filesystem::remove_all(folder_);
  }
  void SetUp() override {
    if (!have(transport_)) GTEST_SKIP() << transport_ << " is not built";
    std::filesystem::create_directories(folder_);
  }

  std::string write(const std::string& xml, const std::string& name = "users.xml") const {
    std::ofstream(folder_ / name) << xml;
    return folder_ / name;
  }
  static Config without_link() {
    Config config = config_of(Role::client);
    config.interface = config.address = "";
    return config;
  }
  std::string facts_of(const Config& config, const std::string& fact) const {
    return in_own_process([&] {
      Answers answers;
      End end(transport_, config, answers);
      throw std::runtime_error(end->facts()[fact]);
    });
  }
  void set_environment(const char* variable, const std::string& value) {
    setenv(variable, value.c_str(), 1);  // NOLINT(concurrency-mt-unsafe): no other threads here
    variables_.push_back(variable);
  }

  const std::string transport_;
  std::vector<const char*> variables_;
  const std::filesystem::path folder_ = testing::TempDir() + "ontime_dds_" + std::to_string(getpid());
};

class CycloneXml : public UsersXml {
 protected:
  CycloneXml() : UsersXml("cyclonedds") {}
  static std::string domain(const std::string& elements) {
    return "<CycloneDDS><Domain id='any'>" + elements + "</Domain></CycloneDDS>";
  }
};

TEST_F(CycloneXml, TheRecordTellsAnotherContentOfTheSameFile) {
  const auto source_of = [&](const std::string& elements) {
    set_environment("CYCLONEDDS_URI", "file://" + write(domain(elements)));
    return facts_of(without_link(), "configuration");
  };
  const auto first = source_of("");
  EXPECT_NE(source_of("<General><MaxMessageSize>4000B</MaxMessageSize></General>"), first);
  EXPECT_EQ(source_of(""), first);
}

TEST_F(CycloneXml, UsersXmlIsUsedExceptForItsInterfaces) {
  Config config = config_of(Role::client);
  const auto path =
      write(R"(<?xml version="1.0"?>)" +
            domain("<General><Interfaces><NetworkInterface name='no-such-if'/></Interfaces>"
                   "<ExternalNetworkAddress>10.9.8.7</ExternalNetworkAddress></General>"
                   "<SharedMemory><Enable>true</Enable></SharedMemory>"
                   "<Internal><MultipleReceiveThreads>false</MultipleReceiveThreads></Internal>"));
  config.options["config"] = "file://" + path;
  expect_contains(facts_of(config, "configuration"), path + " (content ");
  expect_contains(facts_of(config, "configuration"), ") without its interfaces");
  EXPECT_EQ(in_own_process([&] {
              Answers answers;
              End end(transport_, config, answers);
              for (const Thread& thread : end->threads()) require(thread.name != "recvUC", "not honoured");
            }),
            "");
}

TEST_F(CycloneXml, AnotherCarrierIsToldAndNotKeptToAnInterface) {
  set_environment("CYCLONEDDS_URI", domain("<General><Transport>tcp</Transport></General>"));
  expect_contains(refusal(transport_, config_of(Role::client)), "TCPv4");
  EXPECT_EQ(facts_of(without_link(), "carrier"), "TCPv4");
}

TEST_F(CycloneXml, InvalidXmlIsRefusedWithItsLine) {
  const auto path = write("<CycloneDDS>\n<Domain>\n<General></Domain></CycloneDDS>");
  Config config = config_of(Role::client);
  config.options["config"] = path;
  expect_contains(refusal(transport_, config), path + ", line 3");
  config.options["config"] = path + ".no";
  expect_contains(refusal(transport_, config),
                  "wrong input: cyclonedds: cannot open the configuration " + path + ".no");
}

TEST_F(CycloneXml, FolderOrEmptyFileIsRefusedByName) {
  Config config = config_of(Role::client);
  config.options["config"] = "/proc";
  expect_contains(refusal(transport_, config),
                  "wrong input: cyclonedds: cannot open the configuration /proc");
  config.options["config"] = write("");
  expect_contains(refusal(transport_, config), "named by option config");
  set_environment("CYCLONEDDS_URI", "file:///proc");
  expect_contains(refusal(transport_, config_of(Role::client)), "/proc, named by CYCLONEDDS_URI");
}

TEST_F(CycloneXml, AnElementThatThereIsNotIsNamed) {
  const auto said = [&](const std::string& elements) {
    set_environment("CYCLONEDDS_URI", domain(elements));
    return refusal(transport_, config_of(Role::client));
  };
  expect_contains(said("<Generall/>"), "): <Domain> has no element <Generall>");
  expect_contains(said("<General colour='red'/>"), "<General> has no attribute <colour>");
  const auto value = said("<General><AllowMulticast>sure</AllowMulticast></General>");
  expect_contains(value, "CycloneDDS/Domain/General/AllowMulticast: 'sure'");
  EXPECT_FALSE(contains(value, "line ")) << "a line of a file that is not there: " << value;
}

TEST_F(CycloneXml, NodeWithoutALinkIsFoundOnLoopback) {
  for (const std::string transport : {"cyclonedds", "fastdds"})
    for (const std::string lo :
         {"", "<General><Interfaces><NetworkInterface name='lo' multicast='true'/></Interfaces></General>"}) {
      if (!have(transport)) continue;
      Config node = without_link();
      node.role = Role::server;
      node.options["config"] =
          domain("<Discovery><ParticipantIndex>none</ParticipantIndex></Discovery>" + lo);
      Process serving([&](const auto& await_end) { serve("cyclonedds", node, await_end); });
      EXPECT_EQ(in_own_process([&] {
                  Answers answers;
                  End end(transport, config_of(Role::client), answers);
                  await_match(end);
                  exchange(end, answers, 1, {});
                }),
                "")
          << transport << " " << lo;
    }
}

TEST_F(CycloneXml, AnOptionMayNotWriteFilesLoadLibrariesOrOpenPorts) {
  const auto log = folder_ / "cyclonedds.log";
  const std::string tracing =
      "<Tracing><Verbosity>config</Verbosity><OutputFile>" + log.string() + "</OutputFile></Tracing>";
  for (const std::string& elements : {tracing, std::string("<Security/>"), std::string("<DDSSecurity/>"),
                                      std::string("<Internal><monitorport>0</monitorport></Internal>")}) {
    Config config = config_of(Role::client);
    config.options["config"] = domain(elements);
    const auto said = refusal(transport_, config);
    EXPECT_EQ(said.find("wrong input: cyclonedds: option config has <"), 0U) << said;
    expect_contains(said, "CYCLONEDDS_URI");
  }
  EXPECT_FALSE(exists(log));
  set_environment("CYCLONEDDS_URI", domain(tracing));
  EXPECT_EQ(refusal(transport_, config_of(Role::client)), "");
  EXPECT_TRUE(exists(log)) << "the user's own";
}

int priority_of_timer(End& end) {
  for (const Thread& thread : end->threads()) {
    sched_param parameter{};
    if (thread.role == "timer" && sched_getparam(thread.tid, &parameter) == 0)
      return parameter.sched_priority;
  }
  return -1;
}

TEST_F(CycloneXml, PrioritiesOfTheRunWinOverIts) {
  const sched_param wanted{.sched_priority = 7};
  if (sched_setscheduler(0, SCHED_FIFO, &wanted) != 0) GTEST_SKIP() << "no real-time priorities here";
  const sched_param ordinary{};
  sched_setscheduler(0, SCHED_OTHER, &ordinary);
  set_environment(
      "CYCLONEDDS_URI",
      domain("<Threads><Thread Name='tev'><Scheduling><Class>realtime</Class><Priority>5</Priority>"
             "</Scheduling></Thread></Threads>"));
  const auto priority = [&](const Config& config) {
    return in_own_process([&] {
      Answers answers;
      End end(transport_, config, answers);
      throw std::runtime_error(std::to_string(priority_of_timer(end)));
    });
  };
  Config config = config_of(Role::client);
  EXPECT_EQ(priority(config), "5");
  config.fifo_priority["timer"] = 7;
  EXPECT_EQ(priority(config), "7");
  expect_contains(facts_of(config, "configuration"), "without its thread priorities");
}

class FastXml : public UsersXml {
 protected:
  FastXml() : UsersXml("fastdds") {}
  // With the vendor's shared memory beside a UDP of its own.
  static std::string profile(const std::string& name) {
    return R"(<?xml version="1.0"?><dds xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles"><profiles>
      <transport_descriptors>
      <transport_descriptor><transport_id>udp</transport_id><type>UDPv4</type></transport_descriptor>
      <transport_descriptor><transport_id>shm</transport_id><type>SHM</type></transport_descriptor>
      </transport_descriptors>
      <participant profile_name=")" +
           name + R"(" is_default_profile="true"><rtps><userTransports><transport_id>udp</transport_id>
      <transport_id>shm</transport_id></userTransports><useBuiltinTransports>false</useBuiltinTransports>
      </rtps></participant></profiles></dds>)";
  }
  // Whether the end has shared memory of Fast DDS's, or what it says if it does not open.
  std::string shares_memory(const Config& config) const {
    return in_own_process([&] {
      Answers answers;
      End end(transport_, config, answers);
      std::ifstream maps("/proc/self/maps");
      for (std::string line; std::getline(maps, line);)
        if (contains(line, "/" ONTIME_TEST_FASTDDS "_")) throw std::runtime_error("shares");
    });
  }
};

TEST_F(FastXml, KeepsItsTransportsWhereNoLinkIsNamed) {
  Config config = without_link();
  EXPECT_EQ(shares_memory(config), "");
  EXPECT_EQ(facts_of(config, "carrier"), "UDPv4");
  config.options["profiles"] = write(profile("p"));
  EXPECT_EQ(shares_memory(config), "shares");
  EXPECT_EQ(facts_of(config, "carrier"), "the profile's transports");
}

// They sleep on an event as its timer does, and as what sends again, which no message passes through on its
// way.
TEST_F(FastXml, SharedMemoryThreadHasRoleReceive) {
  Config config = without_link();
  config.options["profiles"] = write(profile("p"));
  // What sends again (3 has one more for its statistics), the participant's own and shared memory's watchdog.
  const std::string beside = is_3 ? "resend, resend, timer, timer, " : "resend, timer, timer, ";
  const std::string roles = in_own_process([&] {
    Answers answers;
    End end(transport_, config, answers);
    std::string all;
    // One that waits for a CPU or a lock as it is looked at is taken for another: once.
    eventually([&] {
      std::multiset<std::string> found;
      for (const auto& thread : end->threads())
        found.insert(thread.role + (contains(thread.name, ":shm") || contains(thread.name, ".shm.7")
                                        ? " in shared memory"
                                        : ""));
      all.clear();
      for (const auto& role : found) all += role + ", ";
      return contains(all, beside) && !contains(all, "resend, " + beside) && !contains(all, "unknown");
    });
    throw std::runtime_error(all);
  });
  if (!is_3) expect_contains(roles, "discovery in shared memory");  // 3 discovers over UDP, if it has that
  expect_contains(roles, "receive in shared memory");
  expect_contains(roles, "receive, ");
  expect_contains(roles, beside);
  EXPECT_FALSE(contains(roles, "resend, " + beside)) << roles;
}

TEST_F(FastXml, ItsTransportsGiveWayToTheLink) {
  Config config = config_of(Role::client);
  const auto path = write(profile("p"));
  config.options["profiles"] = path;
  EXPECT_EQ(shares_memory(config), "");
  EXPECT_EQ(facts_of(config, "carrier"), "UDPv4");
  expect_contains(facts_of(config, "configuration"), path + " (content ");
  expect_contains(facts_of(config, "configuration"), ") without its transports");
}

TEST_F(FastXml, TheRestOfItIsHonoured) {
  const auto path = write(
      "<profiles><participant profile_name='p' is_default_profile='true'><rtps>"
      "<sendSocketBufferSize>not a number</sendSocketBufferSize></rtps></participant></profiles>");
  Config config = config_of(Role::client);
  config.options["profiles"] = path;
  const auto said = refusal(transport_, config);
  expect_contains(said, "cannot use the profiles of ontime, " + path);
  expect_contains(said, "sendSocketBufferSize");
}

TEST_F(FastXml, InvalidXmlIsRefusedWithItsLine) {
  const auto path = write("<dds>\n<profiles><participant>");
  Config config = config_of(Role::client);
  config.options["profiles"] = path;
  const auto said = refusal(transport_, config);
  expect_contains(said, "wrong input: fastdds: " + path + ", line 2");
}

TEST_F(FastXml, MessagesOfAnotherParticipantAreNoFault) {
  another_participant_speaks = true;
  const auto said = refusal(transport_, config_of(Role::client));
  another_participant_speaks = false;
  EXPECT_EQ(said, "");
}

TEST_F(FastXml, MissingNamedFileIsRefused) {
  set_environment(names.variable, "/no/such.xml");
  expect_contains(refusal(transport_, config_of(Role::client)),
                  std::string("cannot open the configuration /no/such.xml, named by ") + names.variable);
}

TEST_F(FastXml, DefaultFileInTheFolderIsUsedUnlessSkipped) {
  const auto before = std::filesystem::current_path();
  write(profile("here"), names.file);
  set_environment(names.variable, write(profile("named"), "named.xml"));
  std::filesystem::current_path(folder_);
  const auto both = refusal(transport_, without_link());
  set_environment("SKIP_DEFAULT_XML_FILE", "1");
  const auto source = facts_of(without_link(), "configuration");
  std::filesystem::current_path(before);
  expect_contains(both, "udp");  // both describe a transport of that name
  EXPECT_TRUE(source.starts_with("ontime, " + (folder_ / "named.xml").string() + " (content ")) << source;
}

TEST_F(FastXml, AnOptionMayNotWriteFiles) {
  Config config = config_of(Role::client);
  config.options["profiles"] = write(
      "<dds><log><consumer><class>FileConsumer</class></consumer></log><profiles><participant "
      "profile_name='p'/>"
      "</profiles></dds>");
  const auto said = refusal(transport_, config);
  expect_contains(said, "wrong input: fastdds: ");
  expect_contains(said, "has <log>, which writes files");
  expect_contains(said, names.variable);
}

class Link : public testing::TestWithParam<const char*> {
  void SetUp() override {
    if (!have(GetParam())) GTEST_SKIP() << GetParam() << " is not built";
  }
};
INSTANTIATE_TEST_SUITE_P(All, Link, testing::Values("cyclonedds", "fastdds", "opendds"),
                         [](const auto& of) { return std::string(of.param); });

TEST_P(Link, TheKernelKeepsEverySocketToIt) {
  EXPECT_EQ(in_own_process([&] {
              Answers answers;
              End end(GetParam(), config_of(Role::client), answers);
              int sockets = 0;
              for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd")) {
                const int descriptor = std::stoi(entry.path().filename());
                int family = 0;
                socklen_t bytes = sizeof family;
                if (getsockopt(descriptor, SOL_SOCKET, SO_DOMAIN, &family, &bytes) != 0) continue;
                if (family != AF_INET && family != AF_INET6) continue;
                char device[IFNAMSIZ] = {};
                bytes = sizeof device;
                getsockopt(descriptor, SOL_SOCKET, SO_BINDTODEVICE, device, &bytes);
                require(std::string(device) == "lo", "a socket is not bound");
                ++sockets;
              }
              require(sockets > 2, "no sockets are seen");
            }),
            "");
}

TEST_P(Link, PeerOnAnotherLinkIsSeen) {
  // NOLINTBEGIN(concurrency-mt-unsafe): no other threads here
  if (free_domain() != 0 ||
      std::system("ip link add ontime0 type veth peer ontime1 2>/dev/null && "
                  "ip address add 10.77.77.1/24 dev ontime0 && ip link set ontime1 up && "
                  "ip link set ontime0 up") != 0)
    GTEST_SKIP() << "no second link can be made here";
  Config elsewhere = config_of(Role::server);
  elsewhere.interface = "ontime0";
  elsewhere.address = "10.77.77.1";
  Process serving([&](const auto& await_end) { serve("cyclonedds", elsewhere, await_end); });
  EXPECT_EQ(in_own_process([&] {
              Answers answers;
              End end(GetParam(), config_of(Role::client), answers);
              require(eventually([&] { return contains(end->seen(), "uses multicast on ontime0"); }),
                      "seen: " + end->seen());
            }),
            "");
  EXPECT_EQ(serving.finish(), "");
  EXPECT_EQ(std::system("ip link delete ontime0"), 0);
  // NOLINTEND(concurrency-mt-unsafe)
}

}  // namespace
}  // namespace ontime::transport::test

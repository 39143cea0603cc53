// SPDX-License-Identifier: Apache-2.0
// DDS Security: each vendor lets in peers with an identity of the same authority, no others, and do
// to each payload what was asked, as the wire shows.
#include <algorithm>
#include <array>
#include <ctime>
#include <memory>

#include <gmock/gmock.h>
#include <linux/if_ether.h>
#include <netinet/in.h>
#include <openssl/pem.h>
#include <openssl/x509.h>
#include <sys/socket.h>
#include <unistd.h>

#include "dds_ends.hpp"
#include "security/security.hpp"

namespace ontime::transport::test {
namespace {

using security::Authority;
using security::Level;

// All that goes over the links of this thread's network namespace.
class Wire {
 public:
  Wire() : fd_(socket(AF_PACKET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, htons(ETH_P_ALL))) {
    const int bytes = 16 << 20;
    setsockopt(fd_, SOL_SOCKET, SO_RCVBUFFORCE, &bytes, sizeof bytes);
  }
  ~Wire() { close(fd_); }
  Wire(const Wire&) = delete;
  Wire& operator=(const Wire&) = delete;

  bool can() const { return fd_ >= 0; }
  bool carried(const std::vector<std::byte>& what) {
    bool found = false;
    for (ssize_t got = 0; (got = recv(fd_, frame_.data(), frame_.size(), 0)) >= 0;)
      found |=
          std::search(frame_.begin(), frame_.begin() + got, what.begin(), what.end()) != frame_.begin() + got;
    return found;
  }

 private:
  const int fd_;
  std::vector<std::byte> frame_ = std::vector<std::byte>(70'000);
};

struct Case {
  std::string transport;
  Level level;
};
void PrintTo(const Case& value, std::ostream* out) { *out << value.transport; }

std::vector<Case> cases() {
  std::vector<Case> all;
  for (const char* transport : {"cyclonedds", "fastdds"})
    for (const auto level : {Level::authenticate, Level::sign, Level::encrypt})
      all.push_back({transport, level});
  return all;
}

class DdsSecurity : public testing::TestWithParam<Case> {
  void SetUp() override {
    if (!have(GetParam().transport)) GTEST_SKIP() << GetParam().transport << " is not built";
  }
};
INSTANTIATE_TEST_SUITE_P(, DdsSecurity, testing::ValuesIn(cases()), [](const auto& one) {
  return one.param.transport + "_" + security::word_of(one.param.level);
});

Config config_with(const Authority& authority, Role role, const std::string& name, Level level) {
  auto config = config_of(role);
  config.security = authority.identity(name, level, config.domain);
  return config;
}

TEST_P(DdsSecurity, IsAsAskedOnTheWire) {
  const auto& transport = GetParam().transport;
  const auto level = GetParam().level;
  const Authority authority;
  const auto served = config_with(authority, Role::server, "component", level);
  const auto asking = config_with(authority, Role::client, "controller", level);
  Process serving([&](const auto& await_end) { serve(transport, served, await_end); });
  EXPECT_EQ(
      in_own_process([&] {
        Wire wire;
        Answers answers;
        End end(transport, asking, answers);
        await_match(end);
        std::vector<std::byte> payload(500);
        for (std::size_t i = 16; i < payload.size(); ++i) payload[i] = static_cast<std::byte>(i * i + 3);
        wire.carried({});
        exchange(end, answers, 1, payload);
        require(end->facts().at("security") == security::word_of(level), "it says nothing of its level");
        if (!wire.can()) return;
        const bool legible = wire.carried({payload.begin() + 100, payload.begin() + 200});
        require(legible == (level != Level::encrypt), legible ? "it could be read" : "it could not be read");
      }),
      "");
  EXPECT_EQ(serving.finish(), "");
}

class DdsStrangers : public testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(, DdsStrangers, testing::Values("cyclonedds", "fastdds"),
                         [](const auto& one) { return one.param; });

// A peer with another authority's certificate stays out; one of ours that comes later is let in; a message
// says so.
TEST_P(DdsStrangers, AreNotLetIn) {
  if (!have(GetParam())) GTEST_SKIP() << GetParam() << " is not built";
  const Authority ours, other;
  const auto served = config_with(ours, Role::server, "component", Level::encrypt);
  const auto asking = config_with(ours, Role::client, "controller", Level::encrypt);
  const auto stranger = config_with(other, Role::client, "controller", Level::encrypt);
  Process serving([&](const auto& await_end) { serve(GetParam(), served, await_end); });
  EXPECT_EQ(in_own_process([&] {
              Process later([&](const auto& await_stranger) {
                await_stranger();
                Answers answers;
                End end(GetParam(), asking, answers);
                await_match(end);
              });
              Answers answers;
              End end(GetParam(), stranger, answers);
              if (const auto wrong = later.finish(); !wrong.empty()) throw std::runtime_error(wrong);
              require(!end->matched().both(), "they matched");
              require(end->seen().find("DDS Security") != std::string::npos, "seen: " + end->seen());
            }),
            "");
  EXPECT_EQ(serving.finish(), "");
}

TEST_P(DdsStrangers, InvalidIdentityIsRefusedByName) {
  if (!have(GetParam())) GTEST_SKIP() << GetParam() << " is not built";
  auto config = config_with(Authority(), Role::client, "controller", Level::sign);
  config.security->identity_ca =
      config_with(Authority(), Role::client, "controller", Level::sign).security->identity_ca;
  EXPECT_THAT(refusal(GetParam(), config), testing::HasSubstr(GetParam() + ": cannot open"));
}

TEST(Security, IdentitiesAreOfOneAuthorityAndHaveAKeyEach) {
  const Authority authority;
  const auto one = authority.identity("controller", Level::encrypt, 7),
             other = authority.identity("component", Level::sign, 7);
  EXPECT_EQ(one.identity_ca, other.identity_ca);
  EXPECT_EQ(one.identity_ca, one.permissions_ca);
  EXPECT_NE(one.private_key, other.private_key);
  EXPECT_THAT(one.governance,
              testing::AllOf(testing::HasSubstr("<data_protection_kind>ENCRYPT<"),
                             testing::HasSubstr("<id>7<"), testing::HasSubstr("multipart/signed")));
  EXPECT_THAT(other.governance, testing::HasSubstr("<data_protection_kind>SIGN<"));
  EXPECT_THAT(other.permissions, testing::HasSubstr("CN=component"));
  EXPECT_NE(Authority().identity("controller", Level::sign, 7).identity_ca, one.identity_ca);
}

TEST(Security, IdentitiesHoldByAClockThatWasNeverSet) {
  const auto identity = Authority().identity("controller", Level::sign, 0);
  EXPECT_THAT(identity.permissions, testing::HasSubstr("<not_before>1970-01-01T00:00:00<"));
  for (const auto& text : {identity.identity_ca, identity.identity_certificate}) {
    const std::unique_ptr<BIO, decltype(&BIO_free)> bytes(
        BIO_new_mem_buf(text.data(), static_cast<int>(text.size())), BIO_free);
    const std::unique_ptr<X509, decltype(&X509_free)> certificate(
        PEM_read_bio_X509(bytes.get(), nullptr, nullptr, nullptr), X509_free);
    std::time_t just_booted = 1;
    EXPECT_LT(X509_cmp_time(X509_get0_notBefore(certificate.get()), &just_booted), 0);
    EXPECT_GT(X509_cmp_time(X509_get0_notAfter(certificate.get()), &just_booted), 0);
  }
}

}  // namespace
}  // namespace ontime::transport::test

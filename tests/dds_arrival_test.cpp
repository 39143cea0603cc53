// SPDX-License-Identifier: Apache-2.0
// When a message has arrived, and what became of those that did not.
#include <algorithm>
#include <atomic>
#include <chrono>
#include <filesystem>
#include <iterator>

#include <linux/filter.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include "dds_ends.hpp"
#include "dds_library.hpp"
#include "transport/clock.hpp"

namespace {

using ontime::transport::test::in_library;

std::atomic<std::int64_t> taken_ns{0};  // when the middleware last handed us a message

constexpr const char* fast_take =
    "_ZN8eprosima7fastdds3dds10DataReader16take_next_sampleEPvPNS1_10SampleInfoE";
constexpr const char* open_took = "_ZN7OpenDDS4DCPS14DataReaderImpl17post_read_or_takeEv";

}  // namespace

// This program stands between the transports and their middleware's function that takes a message.
extern "C" std::int32_t dds_takecdr(std::int32_t reader, void** messages, std::uint32_t count, void* infos,
                                    std::uint32_t mask) {
  static auto* const real = in_library<decltype(dds_takecdr)>("libddsc.so", "dds_takecdr");
  const std::int32_t taken = real(reader, messages, count, infos, mask);
  if (taken > 0) taken_ns = ontime::transport::now_ns();
  return taken;
}

extern "C" std::uint32_t take_next_sample(void* reader, void* sample, void* info) asm(
    "_ZN8eprosima7fastdds3dds10DataReader16take_next_sampleEPvPNS1_10SampleInfoE");
extern "C" std::uint32_t take_next_sample(void* reader, void* sample, void* info) {
  static auto* const real =
      in_library<decltype(take_next_sample)>("lib" ONTIME_TEST_FASTDDS ".so", fast_take);
  const std::uint32_t result = real(reader, sample, info);
  if (result == 0) taken_ns = ontime::transport::now_ns();
  return result;
}

// OpenDDS's own is a template in the transport itself; this is the last that it calls of the library.
extern "C" void post_read_or_take(void* reader) asm("_ZN7OpenDDS4DCPS14DataReaderImpl17post_read_or_takeEv");
extern "C" void post_read_or_take(void* reader) {
  static auto* const real = in_library<decltype(post_read_or_take)>("libOpenDDS_Dcps.so", open_took);
  real(reader);
  taken_ns = ontime::transport::now_ns();
}

namespace ontime::transport::test {
namespace {

using namespace std::chrono_literals;

struct Reader {
  const char* transport;
  Receive receive;
  Reliability reliability;
};

std::string name_of_reader(const testing::TestParamInfo<Reader>& info) {
  return std::string(info.param.transport) +
         (info.param.reliability == Reliability::reliable ? "_reliable" : "_best_effort") +
         (info.param.receive == Receive::listener ? "_listener" : "_waitset");
}

// Answers each message by as many as its sequence number says, with its payload.
class Many final : public Sink {
 public:
  void arrived(std::uint64_t sequence, std::span<std::byte> payload, std::int64_t) noexcept override {
    if (Endpoint* const to = endpoint)
      for (std::uint64_t i = 0; i < sequence; ++i) to->send(++sent_, payload);
  }
  std::atomic<Endpoint*> endpoint{nullptr};

 private:
  std::uint64_t sent_ = 0;
};

class DdsReader : public testing::TestWithParam<Reader> {
 protected:
  void SetUp() override {
    if (!have(GetParam().transport)) GTEST_SKIP() << GetParam().transport << " is not built";
  }
  static Config client() { return config_of(Role::client, GetParam().reliability, GetParam().receive); }
  static void serve_many(const std::function<void()>& await_end) {
    Many many;
    End end(GetParam().transport, config_of(Role::server, GetParam().reliability), many);
    many.endpoint = end.operator->();
    await_end();
  }
};

// Slow, so that messages queue up behind it.
class Stamps final : public Sink {
 public:
  void arrived(std::uint64_t, std::span<std::byte>, std::int64_t arrival_ns) noexcept override {
    if (arrival_ns < taken_ns) wrong = "stamped before the message was taken";
    if (arrival_ns < left_ns_) wrong = "stamped while the message before it was being read";
    if (arrival_ns > now_ns()) wrong = "stamped in the future";
    std::this_thread::sleep_for(2ms);
    left_ns_ = now_ns();
    ++count;
  }
  std::atomic<const char*> wrong{nullptr};
  std::atomic<int> count{0};

 private:
  std::int64_t left_ns_ = 0;
};

TEST_P(DdsReader, AMessageHasArrivedWhenItCanBeRead) {
  Process serving([&](const auto& await_end) { serve_many(await_end); });
  EXPECT_EQ(in_own_process([&] {
              Config config = client();
              config.qos.depth = 10;
              Stamps stamps;
              End end(GetParam().transport, config, stamps);
              await_match(end);
              const bool enough = eventually([&] {
                end->send(10, {});
                std::this_thread::sleep_for(10ms);
                return stamps.count > 40;
              });
              require(enough, "nothing arrives");
              require(taken_ns > 0, "this test does not see what is taken");
              require(stamps.wrong == nullptr, stamps.wrong == nullptr ? "" : stamps.wrong.load());
            }),
            "");
}

// Holds its thread with a message in hand, if told to.
class Held final : public Sink {
 public:
  void arrived(std::uint64_t sequence, std::span<std::byte>, std::int64_t) noexcept override {
    ++taken;
    last = sequence;
    for (; held; std::this_thread::sleep_for(1ms)) holds = true;
    holds = false;
  }
  std::atomic<bool> held{false}, holds{false};
  std::atomic<std::uint64_t> taken{0}, last{0};  // the sequence number is how many the server has sent
};

// Of what the server sent from the message in hand on. What comes late of what was asked before is in it.
class Account {
 public:
  Account(End& end, Held& sink) : end_(end), sink_(sink) {
    await_match(end);
    sink.held = true;
    const bool holds = eventually([&] {
      end->send(1, {});
      std::this_thread::sleep_for(10ms);
      return sink.holds.load();
    });
    require(holds, "no answer");
    taken_ = sink.taken;
    last_ = sink.last;
    before_ = end->losses();
  }
  std::uint64_t sent() const { return sink_.last - last_; }
  std::uint64_t taken() const { return sink_.taken - taken_; }
  std::uint64_t overwritten() const { return *end_->losses().overwritten - *before_.overwritten; }
  std::uint64_t on_the_way() const { return *end_->losses().on_the_way - *before_.on_the_way; }
  bool adds_up() const { return taken() + overwritten() + on_the_way() == sent(); }
  std::string text() const {
    return std::to_string(sent()) + " sent, " + std::to_string(taken()) + " taken, " +
           std::to_string(overwritten()) + " overwritten, " + std::to_string(on_the_way()) +
           " lost on the way";
  }

 private:
  End& end_;
  Held& sink_;
  std::uint64_t taken_ = 0, last_ = 0;
  Losses before_;
};

// By waitset, for with a listener it is the middleware's thread that would be held up.
class DdsHeldReader : public DdsReader {};

TEST_P(DdsHeldReader, TellsWhatWasOverwrittenWhileItsThreadWasHeldUp) {
  Process serving([&](const auto& await_end) { serve_many(await_end); });
  EXPECT_EQ(in_own_process([&] {
              Held sink;
              End end(GetParam().transport, client(), sink);
              constexpr std::uint64_t burst = 20;
              const bool some = eventually([&] {
                const Account account(end, sink);
                end->send(burst, {});
                std::this_thread::sleep_for(50ms);  // for all of them to come; if not, once more
                sink.held = false;
                require(eventually([&] { return account.sent() >= burst && account.adds_up(); }),
                        account.text());
                require(account.on_the_way() == 0, account.text());
                return account.overwritten() > 0;
              });
              require(some, "nothing was overwritten");
            }),
            "");
}

// Makes the sockets that receive users' data drop datagrams of more than so many bytes.
void drop_datagrams_above(std::uint32_t bytes) {
  sock_filter code[] = {BPF_STMT(BPF_LD | BPF_W | BPF_LEN, 0),
                        BPF_JUMP(BPF_JMP | BPF_JGT | BPF_K, bytes, 0, 1), BPF_STMT(BPF_RET | BPF_K, 0),
                        BPF_STMT(BPF_RET | BPF_K, 0xFFFFFFFF)};
  const sock_fprog program{static_cast<unsigned short>(std::size(code)), code};
  int found = 0;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd")) {
    sockaddr_in address{};
    socklen_t length = sizeof address;
    const int socket = std::stoi(entry.path().filename());
    if (getsockname(socket, reinterpret_cast<sockaddr*>(&address), &length) != 0) continue;
    const int offset = ntohs(address.sin_port) - 7400 - 250 * free_domain();
    if (address.sin_family != AF_INET || offset < 0 || offset >= 250 || offset % 2 == 0) continue;
    found += setsockopt(socket, SOL_SOCKET, SO_ATTACH_FILTER, &program, sizeof program) == 0 ? 1 : 0;
  }
  require(found > 0, "no socket to filter");
}

TEST_P(DdsReader, TellsWhatWasLostOnTheWay) {
  if (GetParam().transport == std::string("opendds") && GetParam().reliability == Reliability::reliable)
    GTEST_SKIP() << "a reliable writer of OpenDDS 3.13 keeps unacknowledged messages, and gives none up";
  Process serving([&](const auto& await_end) { serve_many(await_end); });
  EXPECT_EQ(in_own_process([&] {
              Held sink;
              End end(GetParam().transport, client(), sink);
              const auto lost = [&] { return end->losses().on_the_way.value(); };
              const auto small_ones_until = [&](const std::function<bool()>& done) {
                return eventually([&] {
                  end->send(1, {});
                  std::this_thread::sleep_for(10ms);
                  return done();
                });
              };
              await_match(end);
              require(small_ones_until([&] { return sink.taken > 0; }), "no answer");
              require(lost() == 0, "some are lost already");
              drop_datagrams_above(600);
              // A busy server may take the next small one in place of the large one, which is sent again.
              std::uint64_t before = 0;
              int small_ones = 0;
              require(small_ones_until([&] {
                        if (lost() == before + 10) return true;
                        if (small_ones++ % 100 == 0) {
                          before = lost();
                          end->send(10, std::vector<std::byte>(600));
                        }
                        return false;
                      }),
                      std::to_string(lost()) + " are lost");
            }),
            "");
}

TEST_P(DdsReader, TellsWhoComesAndGoes) {
  Process staying([&](const auto& await_end) { serve_many(await_end); });
  Process leaving([&](const auto&) {
    Held sink;
    End end(GetParam().transport, config_of(Role::server, GetParam().reliability), sink);
    require(eventually([&] { return sink.taken > 0; }), "no message");
  });
  EXPECT_EQ(in_own_process([&] {
              Held sink;
              End end(GetParam().transport, client(), sink);
              const auto matched = [&](int count) {
                return eventually([&] {
                  const Matched now = end->matched();
                  return now.readers == count && now.writers == count;
                });
              };
              require(matched(2), "not both are seen");
              const std::int64_t changed_ns = end->matched().changed_ns;
              require(changed_ns > 0 && changed_ns <= now_ns(), "a wrong time");
              const bool left = eventually([&] {
                end->send(1, {});
                return end->matched().readers == 1;
              });
              require(left && matched(1), "one left, and it is not seen");
              require(end->matched().changed_ns > changed_ns, "the time does not change");
            }),
            "");
  EXPECT_EQ(leaving.finish(), "");
}

constexpr Reader readers[] = {
    {"cyclonedds", Receive::waitset, Reliability::best_effort},
    {"cyclonedds", Receive::waitset, Reliability::reliable},
    {"fastdds", Receive::waitset, Reliability::best_effort},
    {"fastdds", Receive::waitset, Reliability::reliable},
    {"opendds", Receive::waitset, Reliability::best_effort},
    {"opendds", Receive::waitset, Reliability::reliable},
    {"cyclonedds", Receive::listener, Reliability::best_effort},
    {"fastdds", Receive::listener, Reliability::best_effort},
    {"opendds", Receive::listener, Reliability::best_effort},
};
INSTANTIATE_TEST_SUITE_P(All, DdsReader, testing::ValuesIn(readers), name_of_reader);
INSTANTIATE_TEST_SUITE_P(All, DdsHeldReader, testing::ValuesIn(std::begin(readers), std::begin(readers) + 6),
                         name_of_reader);

}  // namespace
}  // namespace ontime::transport::test

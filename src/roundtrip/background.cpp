// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <ctime>
#include <limits>
#include <thread>

#include <pthread.h>
#include <unistd.h>

#include "message/message.hpp"
#include "roundtrip/alarm.hpp"
#include "roundtrip/cycles.hpp"
#include "roundtrip/receiver.hpp"
#include "roundtrip/roundtrip.hpp"
#include "transport/clock.hpp"

namespace ontime::roundtrip {
namespace {

using transport::Config;
using transport::Endpoint;
using transport::now_ns;

constexpr int depth = 10;             // ROS 2's own choice
constexpr std::uint32_t counted = 1;  // in a session: whether its messages are

// Of the topic of that number: as the critical one's, and of the background topic's size and reliability.
Config config_of(Config config, const BackgroundOptions& options, int number) {
  for (auto* topic : {&config.ping_topic, &config.pong_topic}) *topic = background_topic(*topic, number);
  config.max_payload_bytes = options.payload_bytes;
  config.qos = {.reliability = options.reliability, .depth = depth};
  config.fifo_priority.clear();
  config.background = true;
  return config;
}

void check(const transport::Plugin& plugin, Where where) {
  const auto& can = plugin.capabilities;
  const auto refuse = [&](const std::string& why) {
    throw transport::WrongInput(std::string("transport ") + plugin.name + " has no " + why);
  };
  if (!can.background) refuse("background topics: it opens only the critical topic");
  if (!can.nodes && transport::is_of_nodes(where))
    refuse(std::string("nodes, callback groups or executors (background.where: ") + word_of(where) +
           "); it has same-participant, same-process and other-process");
}

// The others are beside the first, which outlives them: also where one of them could not be opened.
struct Endpoints : std::vector<std::unique_ptr<Endpoint>> {
  ~Endpoints() {
    while (!empty()) pop_back();
  }
};

}  // namespace

const char* word_of(Where where) {
  constexpr std::array words{
      "same-callback-group", "same-node",    "same-executor", "own-executor",
      "same-participant",    "same-process", "other-process"};  // in the enumeration's order
  return words.at(static_cast<std::size_t>(where));
}

std::string background_topic(std::string critical, int number) {
  return critical.insert(critical.rfind('/'), "/background_" + std::to_string(number));
}

std::uint64_t messages_asked(const BackgroundOptions& options, std::chrono::nanoseconds duration) {
  // A period is in whole ns: a hundredth of a cycle is what it may have been rounded up by in all.
  const auto due = (duration * options.topics + options.period / 100) / options.period;
  return static_cast<std::uint64_t>(std::max<std::int64_t>(due, 1));
}

class BackgroundTopics::Group final : public transport::Sink {
  friend class BackgroundTopics;

 public:
  Group(const transport::Plugin& plugin, Endpoint* critical, const Config& config,
        const BackgroundOptions& options, std::chrono::nanoseconds duration)
      : sends_(config.role == transport::Role::client ? options.there : options.back),
        topics_(options.topics),
        period_ns_(options.period.count()),
        duration_ns_(duration.count()),
        cycles_(static_cast<std::int64_t>(messages_asked(options, duration))),
        callback_ns_(options.callback.count()),
        turn_ns_(config.receive == transport::Receive::listener ? period_ns_ / topics_ : period_ns_),
        payload_(options.payload_bytes),
        session_(options.session & ~counted) {
    check(plugin, options.where);
    for (int number = 1; number <= topics_; ++number) {
      const auto own = config_of(config, options, number);
      if (number > 1)  // with the first, wherever that is
        endpoints_.push_back(endpoints_.front()->beside(own, *this, Where::same_callback_group));
      else
        endpoints_.push_back(critical == nullptr ? plugin.open(own, *this)
                                                 : critical->beside(own, *this, options.where));
    }
    for (auto& endpoint : endpoints_)
      receivers_.push_back(std::make_unique<Receiver>(*endpoint, config.receive));
    if (!sends_) return;
    sender_ = std::thread([this] { send(); });
    sender_tid_.wait(0);
  }

  ~Group() {
    stop();
    leaving_ = true;
    leave_.ring();
    if (sender_.joinable()) sender_.join();
  }

  // Real-time: on the transport's thread, or on a receiver's.
  void arrived(std::uint64_t sequence, std::span<std::byte>, std::int64_t arrival_ns) noexcept override {
    const auto session = message::session_of(sequence);
    if ((session & ~counted) != session_) {
      strays_.fetch_add(1, std::memory_order_relaxed);
      return;
    }
    if ((session & counted) != 0) received_.fetch_add(1, std::memory_order_relaxed);
    if (callback_ns_ == 0) return;
    compute();
    if ((session & counted) != 0 && now_ns() - arrival_ns > turn_ns_)
      overruns_.fetch_add(1, std::memory_order_relaxed);
  }

  bool matched() {
    return std::ranges::all_of(endpoints_, [](auto& endpoint) { return endpoint->matched().both(); });
  }
  void stop() {
    for (auto* alarm : {&stop_, &start_, &go_}) alarm->ring();
  }
  BackgroundCounters counters() const {
    return {.sent = sent_,
            .refused = refused_,
            .skipped_cycles = skipped_,
            .received = received_,
            .strays = strays_,
            .overruns = overruns_};
  }

  std::vector<Thread> threads() {
    std::vector<Thread> all;
    if (sends_) all.push_back({sender_tid_, "send", sender_name});
    for (const auto& receiver : receivers_)
      for (auto& thread : receiver->threads()) all.push_back(std::move(thread));
    for (auto& endpoint : endpoints_)
      for (auto& thread : endpoint->threads()) all.push_back(std::move(thread));
    return all;
  }

 private:
  static constexpr const char* sender_name = "ontime-beside";
  static constexpr auto never_ns = std::numeric_limits<std::int64_t>::max();

  // What walk() asks of a sender. Each cycle is another topic's turn: so their messages are spread evenly.
  struct Sender {
    Group& self;
    Alarm& end;
    std::uint32_t session;
    std::int64_t first_ns, step_ns;
    void sleep_until(std::int64_t due_ns) noexcept { end.sleep_until(due_ns); }
    std::int64_t now_ns() const noexcept { return transport::now_ns(); }
    std::int64_t stopped_ns() const noexcept { return end.rung() ? transport::now_ns() : never_ns; }
    bool may_send(std::int64_t) const noexcept { return true; }
    void post(const Turn& turn) noexcept {
      const auto turns = (turn.due_ns - first_ns) / step_ns;
      const auto taken = self.endpoints_[static_cast<std::size_t>(turns % self.topics_)]->send(
          message::sequence_of(session, self.index_++), self.payload_);
      if ((session & counted) == 0) return;
      (taken ? self.sent_ : self.refused_).fetch_add(1, std::memory_order_relaxed);
      self.skipped_.fetch_add(turn.skipped_cycles, std::memory_order_relaxed);
    }
  };

  // The CPU's time, not the clock's: while another thread runs, nothing is computed.
  void compute() const noexcept {
    const auto until_ns = computed_ns() + callback_ns_;
    while (computed_ns() < until_ns && !leaving_.load(std::memory_order_relaxed)) {
    }
  }
  static std::int64_t computed_ns() noexcept {
    timespec time{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
    return std::int64_t{time.tv_sec} * 1'000'000'000 + time.tv_nsec;
  }

  void send() noexcept {
    pthread_setname_np(pthread_self(), sender_name);
    sender_tid_ = gettid();
    sender_tid_.notify_one();
    start_.wait();
    wake_as_precisely_as_the_policy_allows();
    const auto step_ns = std::max<std::int64_t>(period_ns_ / topics_, 1);
    const auto walk_until = [&](Alarm& end, std::uint32_t session, std::int64_t for_ns) {
      // Also the only one of a duration that is shorter than its cycle is due within it.
      const auto first_ns = now_ns() + std::min(step_ns, duration_ns_ / 2);
      Sender sender{*this, end, session, first_ns, step_ns};
      return walk(sender, first_ns, step_ns, for_ns == never_ns ? never_ns : first_ns + for_ns);
    };
    walk_until(go_, session_, never_ns);
    if (!stop_.rung()) {
      const auto rest = walk_until(stop_, session_ | counted, cycles_ * step_ns);
      skipped_.fetch_add(rest.cycles, std::memory_order_relaxed);
    }
    leave_.wait();  // until then it is still there to be read
  }

  const bool sends_;
  const int topics_;
  const std::int64_t period_ns_, duration_ns_, cycles_, callback_ns_, turn_ns_;
  const std::vector<std::byte> payload_;
  const std::uint32_t session_;
  std::uint64_t index_ = 0;
  std::atomic<std::uint64_t> sent_{0}, refused_{0}, skipped_{0}, received_{0}, strays_{0}, overruns_{0};
  std::atomic<bool> leaving_{false};
  Alarm start_, go_, stop_, leave_;
  std::atomic<pid_t> sender_tid_{0};
  Endpoints endpoints_;
  std::vector<std::unique_ptr<Receiver>> receivers_;
  std::thread sender_;
};

BackgroundTopics::BackgroundTopics(const transport::Plugin& plugin, Endpoint* critical, const Config& config,
                                   const BackgroundOptions& options, std::chrono::nanoseconds duration)
    : group_(std::make_unique<Group>(plugin, critical, config, options, duration)) {}
BackgroundTopics::~BackgroundTopics() = default;
Endpoint& BackgroundTopics::endpoint() { return *group_->endpoints_.front(); }
std::vector<Thread> BackgroundTopics::threads() { return group_->threads(); }
bool BackgroundTopics::matched() { return group_->matched(); }
void BackgroundTopics::start() { group_->start_.ring(); }
void BackgroundTopics::go() { group_->go_.ring(); }
void BackgroundTopics::stop() { group_->stop(); }
BackgroundCounters BackgroundTopics::counters() const { return group_->counters(); }

}  // namespace ontime::roundtrip

// SPDX-License-Identifier: Apache-2.0
// The agent itself: one thread, ordinary, which turns orders into the rooms' doings and reports what comes of
// them.
#include <algorithm>
#include <array>
#include <atomic>
#include <csignal>
#include <memory>
#include <set>

#include <fcntl.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>

#include "agent/agent.hpp"
#include "agent/frames.hpp"
#include "machine/machine.hpp"

namespace ontime::agent {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;
using Clock = std::chrono::steady_clock;

// Enough for a middleware's own allocations from set-up to end, so that none of them has to fault pages in.
constexpr unsigned middleware_patience_s = 3;
constexpr std::size_t heap_bytes = std::size_t{32} << 20;

std::atomic<bool> terminated{false};

json to_json(const roundtrip::Counters& counters) {
  return {{"sent", counters.sent},
          {"on_time", counters.on_time},
          {"late", counters.late},
          {"lost", counters.lost},
          {"duplicates", counters.duplicates},
          {"strays", counters.strays},
          {"reordered", counters.reordered},
          {"skipped_cycles", counters.skipped_cycles},
          {"refused_sends", counters.refused_sends},
          {"dropped_records", counters.dropped_records}};
}

// Finds the address of the interface that was asked for.
void resolve(transport::Config& config) {
  if (config.interface.empty()) return;
  std::vector<std::string> others;
  for (const auto& interface : machine::interfaces()) {
    others.push_back(interface.name);
    if (interface.name != config.interface) continue;
    if (!interface.up)
      throw Error(
          3, fmt::format("interface '{0}' is down; bring it up: sudo ip link set {0} up", interface.name));
    if (interface.address.empty())
      throw Error(
          3, fmt::format(
                 "interface '{0}' has no IPv4 address; give it one: sudo ip address add A.B.C.D/N dev {0}",
                 interface.name));
    config.address = interface.address;
    return;
  }
  throw Error(2, fmt::format("there is no interface '{}' on this host; there are: {}", config.interface,
                             fmt::join(others, ", ")));
}

void check(const transport::Plugin& plugin, const Task& task) {
  const auto& can = plugin.capabilities;
  if (task.config.max_payload_bytes > can.max_payload_bytes)
    throw Error(2, fmt::format("transport {} carries at most {} bytes of payload; {} were asked for",
                               plugin.name, can.max_payload_bytes, task.config.max_payload_bytes));
  const bool listener = task.config.receive == transport::Receive::listener;
  if (listener ? !can.listener : !can.waitset)
    throw Error(2,
                fmt::format("transport {} cannot receive by {}", plugin.name, word_of(task.config.receive)));
  for (const auto& [name, value] : task.config.options) {
    const bool known = std::any_of(plugin.options.begin(), plugin.options.end(),
                                   [&asked = name](const auto& option) { return asked == option.name; });
    if (known) continue;
    std::vector<std::string> others;
    for (const auto& option : plugin.options)
      others.push_back(fmt::format("{} ({})", option.name, option.values));
    throw Error(2, fmt::format("transport {} has no option '{}'; it has: {}", plugin.name, name,
                               others.empty() ? "none" : fmt::format("{}", fmt::join(others, ", "))));
  }
}

// One end of one run, from `open` on.
class End {
 public:
  explicit End(Task task) : task_(std::move(task)) {
    resolve(task_.config);
    task_.config.deadline_ns = task_.client.deadline.count();
    // Memory first: what is created afterwards is born locked, and touched.
    if (task_.realtime.lock_memory) refuse(realtime::lock_memory(heap_bytes));
    if (task_.realtime.cpu_latency) {
      latency_ = std::make_unique<realtime::CpuLatencyRequest>(*task_.realtime.cpu_latency);
      if (latency_->refusal()) refuse({*latency_->refusal()});
    }
    plugin_ = &transport::load(task_.transport);
    check(*plugin_, task_);
    for (const auto& [role, settings] : task_.realtime.threads)
      if (settings.policy == realtime::Policy::fifo && realtime::may_use_fifo(settings.priority))
        task_.config.fifo_priority[role] = settings.priority;
    if (task_.config.role == transport::Role::client)
      client_ = std::make_unique<roundtrip::Client>(*plugin_, task_.config, task_.client);
    else
      server_ = std::make_unique<roundtrip::Server>(*plugin_, task_.config);
    set_threads();
  }

  roundtrip::Client* client() { return client_.get(); }
  transport::Endpoint& endpoint() { return client_ ? client_->endpoint() : server_->endpoint(); }
  const Task& task() const { return task_; }
  std::uint64_t answered() const { return server_ ? server_->answered() : 0; }

  // A middleware starts threads when it likes, so this is done again once peers have matched.
  void set_threads() {
    for (const auto& thread : threads()) {
      if (!task_.realtime.on || !set_.insert(thread.tid).second) continue;
      auto settings = task_.realtime.threads.find(thread.role);
      if (settings == task_.realtime.threads.end()) settings = task_.realtime.threads.find("other");
      if (settings == task_.realtime.threads.end()) continue;
      refuse(realtime::apply(thread.tid, thread.role, settings->second));
    }
  }

  // From here on is "during the run".
  void begin() {
    set_threads();
    before_.clear();
    instructions_.clear();
    for (const auto& thread : threads()) {
      if (const auto state = realtime::read(thread.tid)) before_[thread.tid] = *state;
      if (task_.count_instructions) instructions_.emplace(thread.tid, thread.tid);
    }
    activity_ = machine::activity();
    threads_during_ = nullptr;
  }

  void end() {
    if (!threads_during_.is_null()) return;
    conditions_ = machine::between(activity_, machine::activity());
    threads_during_ = json::array();
    for (const auto& thread : threads())
      if (const auto now = realtime::read(thread.tid)) threads_during_.push_back(during(thread, *now));
  }

  json opened() {
    return {{"machine", machine::describe()},
            {"refusals", refusals()},
            {"transport",
             {{"name", plugin_->name}, {"version", plugin_->version()}, {"facts", endpoint().facts()}}}};
  }

  json closed() {
    end();
    return {{"threads", threads_during_},
            {"conditions", conditions_},
            {"refusals", refusals()},
            {"facts", endpoint().facts()},
            {"answered", answered()}};
  }

 private:
  std::vector<transport::Thread> threads() { return client_ ? client_->threads() : server_->threads(); }

  void refuse(const std::vector<realtime::Refusal>& refusals) {
    for (const auto& refusal : refusals) {
      const bool known = std::any_of(refusals_.begin(), refusals_.end(),
                                     [&](const auto& other) { return other.asked == refusal.asked; });
      if (!known) refusals_.push_back(refusal);
    }
  }

  json refusals() const {
    auto result = json::array();
    for (const auto& refusal : refusals_)
      result.push_back({{"asked", refusal.asked}, {"found", refusal.found}, {"remedy", refusal.remedy}});
    return result;
  }

  json instructions_of(pid_t tid) const {
    const auto counter = instructions_.find(tid);
    const auto value = counter == instructions_.end() ? std::nullopt : counter->second.value();
    return value ? json(*value) : json(nullptr);
  }

  json during(const transport::Thread& thread, const realtime::ThreadState& now) const {
    const auto found = before_.find(thread.tid);
    const auto before = found == before_.end() ? realtime::ThreadState{} : found->second;
    return {{"role", thread.role},
            {"name", thread.name},
            {"tid", thread.tid},
            {"policy", realtime::word_of(now.policy)},
            {"priority", now.priority},
            {"cpus", now.cpus},
            {"minor_faults", now.minor_faults - before.minor_faults},
            {"major_faults", now.major_faults - before.major_faults},
            {"voluntary_switches", now.voluntary_switches - before.voluntary_switches},
            {"involuntary_switches", now.involuntary_switches - before.involuntary_switches},
            {"cpu_time_us", static_cast<double>((now.cpu_time - before.cpu_time).count()) / 1e3},
            {"instructions", instructions_of(thread.tid)}};
  }

  Task task_;
  std::unique_ptr<realtime::CpuLatencyRequest> latency_;
  const transport::Plugin* plugin_ = nullptr;
  std::unique_ptr<roundtrip::Client> client_;
  std::unique_ptr<roundtrip::Server> server_;
  std::set<pid_t> set_;
  std::vector<realtime::Refusal> refusals_;
  std::map<pid_t, realtime::ThreadState> before_;
  std::map<pid_t, realtime::InstructionCounter> instructions_;
  machine::Activity activity_;
  json threads_during_, conditions_;
};

class Agent {
 public:
  Agent(int in, int out) : frames_(in, out), batch_(8192) {}

  void run() {
    while (!terminated) {
      if (const auto order = frames_.receive(stage_ == Stage::idle ? 500ms : 10ms)) obey(*order);
      go_on();
    }
  }

  void fail(int code, const std::string& message) {
    frames_.send({{"event", "failed"}, {"exit", code}, {"message", message}});
  }

  // Takes back what this host was made to do, before the middleware is asked to leave.
  void give_back() {
    stress_.reset();
    journal_.reset();
    machine::revert_abandoned();  // of a coordinator that was killed, namespaces are still there
  }

 private:
  // What a client is at.
  enum class Stage { idle, matching, warming_up, measuring };

  void answer(const char* event, json body = json::object()) {
    body["event"] = event;
    frames_.send(body);
  }

  void obey(const json& order) {
    const std::string name = order.at("order");
    if (name == "open") {
      const auto notes = machine::revert_abandoned();
      end_ = std::make_unique<End>(order.at("task").get<Task>());
      auto opened = end_->opened();
      opened["notes"] = notes;
      answer("opened", opened);
    } else if (name == "load") {
      journal_ = std::make_unique<machine::Journal>();
      stress_ = std::make_unique<background::Stress>(end_->task().load, journal_->add_directory("stress"));
      answer("loaded");
    } else if (name == "start") {
      start(std::chrono::nanoseconds(order.at("wait_ns").get<std::int64_t>()));
    } else if (name == "stop") {
      stop();
    } else if (name == "close") {
      auto closed = end_->closed();
      closed["load_running"] = stress_ ? json(stress_->running()) : json(nullptr);
      answer("closed", closed);
    } else {
      throw Broken("no such order: " + name);
    }
  }

  void start(std::chrono::nanoseconds wait) {
    if (end_->client() == nullptr) {
      end_->begin();
      answer("started");
      return;
    }
    wait_ = wait;
    until_ = Clock::now() + wait;
    stage_ = Stage::matching;
  }

  void stop() {
    if (stage_ == Stage::idle || end_->client() == nullptr) return;
    end_->client()->stop();
    if (stage_ != Stage::measuring) finish();
  }

  void go_on() {
    switch (stage_) {
      case Stage::idle:
        return;
      case Stage::matching:
        return match();
      case Stage::warming_up:
        return warm_up();
      case Stage::measuring:
        return measure();
    }
  }

  void match() {
    if (!end_->endpoint().matched().both()) {
      if (Clock::now() < until_) return;
      const auto seen = end_->endpoint().seen();
      throw Error(
          3,
          fmt::format("no pong was found over {} within {:g} s{}. Is `ontime pong --transport {}` running on "
                      "the other machine, in the same domain ({}), on the same link?",
                      end_->task().transport, seconds(wait_), seen.empty() ? "" : "; seen: " + seen,
                      end_->task().transport, end_->task().config.domain));
    }
    answer("matched");
    end_->set_threads();
    end_->client()->start();
    // What the warm-up may take: its own messages' time, and what is left of the wait.
    const auto& options = end_->task().client;
    until_ = Clock::now() + wait_ + options.period * static_cast<std::int64_t>(options.warm_up);
    stage_ = Stage::warming_up;
  }

  void warm_up() {
    auto& client = *end_->client();
    if (client.state() >= roundtrip::Client::State::measuring) {
      end_->begin();
      last_progress_ = last_samples_ = Clock::now();
      answer("measuring");
      stage_ = Stage::measuring;
    } else if (Clock::now() > until_) {
      throw Error(
          3,
          fmt::format("pong was found over {}, but it answered {} of the {} messages of the warm-up within "
                      "{:g} s. Is the payload larger than it serves (pong --payload SIZE) or than the link "
                      "carries, or does a firewall drop it?",
                      end_->task().transport, client.warm_up_answers(), end_->task().client.warm_up,
                      seconds(wait_)));
    }
  }

  void measure() {
    auto& client = *end_->client();
    const bool finished = client.state() == roundtrip::Client::State::finished;
    const auto now = Clock::now();
    if (finished || now - last_samples_ >= 100ms) {
      last_samples_ = now;
      send_samples();
    }
    if (finished) return finish();
    if (now - last_progress_ < 250ms) return;
    last_progress_ = now;
    answer("progress", {{"counters", to_json(client.counters())}});
  }

  void send_samples() {
    while (const auto count = end_->client()->drain(batch_)) {
      const auto* bytes = reinterpret_cast<const std::uint8_t*>(batch_.data());
      answer("samples", {{"samples", json::binary({bytes, bytes + count * sizeof(roundtrip::Sample)})}});
    }
  }

  void finish() {
    end_->end();
    stage_ = Stage::idle;
    answer("finished", {{"counters", to_json(end_->client()->counters())}});
  }

  static double seconds(std::chrono::nanoseconds time) { return std::chrono::duration<double>(time).count(); }

  Frames frames_;
  std::vector<roundtrip::Sample> batch_;
  std::unique_ptr<machine::Journal> journal_;
  std::unique_ptr<End> end_;
  std::unique_ptr<background::Stress> stress_;
  Stage stage_ = Stage::idle;
  std::chrono::nanoseconds wait_{0};
  Clock::time_point until_, last_progress_, last_samples_;
};

void on_terminate(int) { terminated = true; }

}  // namespace

int serve() {
  struct sigaction action {};
  action.sa_handler = on_terminate;
  for (const int signal : {SIGTERM, SIGHUP, SIGINT}) sigaction(signal, &action, nullptr);
  action.sa_handler = SIG_IGN;
  sigaction(SIGPIPE, &action, nullptr);
  // Whatever a middleware prints must not get between the frames.
  const int out = fcntl(STDOUT_FILENO, F_DUPFD_CLOEXEC, 3);
  dup2(STDERR_FILENO, STDOUT_FILENO);

  static std::atomic<int> code{0};
  action.sa_handler = [](int) { _exit(code); };
  sigaction(SIGALRM, &action, nullptr);
  {
    Agent agent(STDIN_FILENO, out);
    const auto fail = [&](int exit, const std::string& message) {
      code = exit;
      try {
        agent.fail(exit, message);
      } catch (const Broken&) {  // nobody is left to be told
      }
    };
    try {
      agent.run();
    } catch (const Broken&) {
      // The coordinator is gone. What we changed is taken back as for any end.
    } catch (const Error& error) {
      fail(error.exit, error.what());
    } catch (const std::exception& error) {
      fail(3, error.what());
    }
    agent.give_back();
    // Cyclone DDS waits without end for threads that it wakes by a datagram to itself, where the link has
    // gone.
    alarm(middleware_patience_s);
  }
  return code;
}

}  // namespace ontime::agent

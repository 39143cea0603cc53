// SPDX-License-Identifier: Apache-2.0
// The agent itself: one ordinary thread, which carries out orders with the other modules and reports the
// results.
#include <algorithm>
#include <array>
#include <cstdlib>
#include <memory>
#include <sstream>
#include <tuple>

#include <fmt/format.h>
#include <sched.h>
#include <unistd.h>

#include "agent/agent.hpp"
#include "agent/end.hpp"
#include "agent/recorder.hpp"
#include "orders/orders.hpp"

namespace ontime::agent {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;
using orders::Error;
using orders::Unanswered;
using std::chrono::milliseconds;
using Clock = std::chrono::steady_clock;

constexpr auto progress_period = 1s;

// SSH_CONNECTION, which sshd sets: the client's address and port, then the server's.
record::SshLink ssh_link(const std::string& under_test) {
  // NOLINTNEXTLINE(concurrency-mt-unsafe): nothing here sets the environment
  const char* connection = std::getenv("SSH_CONNECTION");
  std::istringstream words(connection != nullptr ? connection : "");
  std::string client, client_port, address;
  words >> client >> client_port >> address;
  const auto interface = address.empty() ? std::nullopt : machine::interface_with(address);
  const bool apart = interface && !under_test.empty() && *interface != under_test;
  return {interface, !apart};
}

// All of this place: a container or network namespace has its own.
std::vector<std::string> addresses() {
  std::vector<std::string> all;
  for (const auto& interface : machine::interfaces())
    all.insert(all.end(), interface.addresses.begin(), interface.addresses.end());
  return all;
}

// A likely cause where a peer does not answer. It decides nothing: several links may lead there.
std::string by_another_link(const transport::Config& config, bool served) {
  if (config.interface.empty() || config.peers.empty()) return "";
  const auto peer = config.peers.front().substr(0, config.peers.front().find(':'));
  try {
    const auto route = machine::interface_to(peer, "");
    if (route == config.interface) return "";
    return fmt::format("; the route to {} is by {}, not by {}. Fix: {}{}", peer, route, config.interface,
                       served ? "controller's interface: " : "--interface ", route);
  } catch (const machine::Error& error) {
    return fmt::format("; {}", error.what());
  }
}

class Agent final : public orders::Worker {
 public:
  explicit Agent(orders::Events& events) : events_(events) {}

  void obey(const std::string& order, const json& body) override {
    if (order == "identify") return events_.tell("identified", {{"pid", getpid()}});
    if (order == "open") {
      end_ = std::make_unique<End>(task_of(body.at("task")));
      end_->drop_privileges();
      auto opened = end_->opened();
      if (body.value("ssh", false)) opened.ssh_link = ssh_link(end_->task().config.interface);
      shares_link_ = opened.ssh_link && opened.ssh_link->shared;
      auto answer = record::to_json(opened);
      answer["addresses"] = addresses();
      answer["mtu"] = machine::mtu_of(end_->task().config.interface).value_or(0);
      return events_.tell("opened", std::move(answer));
    }
    if (!end_) throw Error(3, "order '" + order + "' came before 'open' (a bug: please report)");
    if (order == "start" && body.value("note_answers", false)) {
      end_->server()->note_answers();
      notes_answers_ = true;
    }
    if (order == "start")
      start(std::chrono::nanoseconds(body.at("wait_ns").get<std::int64_t>()), body.value("served", false));
    else if (order == "begin")
      begin();
    else if (order == "go")
      go();
    else if (order == "stop")
      stop();
    else if (order == "end")
      tell_end();
    else
      throw Error(3, "unknown order '" + order + "' (a bug: please report)");
  }

  milliseconds go_on() override {
    if (stage_ == Stage::matching) return match();
    if (stage_ == Stage::warming_up) return warm_up();
    if (stage_ == Stage::measuring) return measure();
    if (notes_answers_) tell_answers();
    return 500ms;
  }

  // An end changes nothing that does not end with its process.
  std::vector<std::string> give_back() noexcept override { return {}; }

 private:
  // What a client does at the moment.
  enum class Stage { idle, matching, warming_up, measuring };

  void start(std::chrono::nanoseconds wait, bool served) {
    served_ = served;
    if (end_->client() == nullptr && end_->background() == nullptr) return events_.tell("ready");
    wait_ = wait;
    until_ = Clock::now() + wait;
    stage_ = Stage::matching;
  }

  void tell_answers() {
    std::array<roundtrip::Server::Answer, 512> answers{};
    while (const auto count = end_->server()->drain(answers))
      events_.tell("answered", json::object(),
                   {reinterpret_cast<const std::uint8_t*>(answers.data()), count * sizeof answers.front()});
  }

  // After `ended` the coordinator takes no more answers.
  void tell_end() {
    if (notes_answers_) tell_answers();
    events_.tell("ended", record::to_json(end_->ended()));
  }

  std::string unfound() {
    const auto& [transport, config] = std::tie(end_->task().transport, end_->task().config);
    const auto seen = end_->endpoint().seen();
    auto text = fmt::format(
        "{} over {} within {:g} s{}{}",
        served_ ? "the component's server (pong) runs, but was not found" : "no server (pong) found",
        transport, seconds(wait_), seen.empty() ? "" : "; seen: " + seen,
        end_->opened().transport.below_ip.value_or(false) ? "" : by_another_link(config, served_));
    if (served_) return text;
    return fmt::format(
        "{}. Check that `ontime pong --transport {}` runs on the other machine, in domain {}, on the same "
        "link",
        text, transport, config.domain);
  }

  milliseconds match() {
    if (end_->client() != nullptr && !end_->endpoint().matched().both()) {
      if (Clock::now() < until_) return 5ms;
      throw Unanswered(unfound());
    }
    if (auto* background = end_->background(); background != nullptr && !background->matched()) {
      if (Clock::now() < until_) return 5ms;
      throw Unanswered(fmt::format("background topics ({} …) found no peer over {} within {:g} s",
                                   roundtrip::background_topic(end_->task().config.ping_topic, 1),
                                   end_->task().transport, seconds(wait_)));
    }
    end_->set_threads();
    if (end_->background() != nullptr) end_->background()->start();
    if (end_->client() == nullptr) {
      stage_ = Stage::idle;
      events_.tell("ready");
      return 500ms;
    }
    recorder_ =
        std::make_unique<Recorder>(*end_->client(), events_, end_->task().client.schedule,
                                   shares_link_ ? Recorder::Waiting::for_the_end : Recorder::Waiting::no);
    end_->client()->start();
    limit_ = wait_;
    until_ = Clock::now() + limit_;  // each answer moves it on
    answered_ = 0;
    stage_ = Stage::warming_up;
    return 5ms;
  }

  milliseconds warm_up() {
    auto& client = *end_->client();
    if (client.state() >= roundtrip::Client::State::ready) {
      stage_ = Stage::idle;
      events_.tell("ready");
    } else if (const auto answers = client.warm_up_answers(); answers > answered_) {
      answered_ = answers;
      limit_ = std::max(wait_, end_->task().client.timeout);
      until_ = Clock::now() + limit_;
    } else if (Clock::now() > until_) {
      throw Unanswered(fmt::format(
          "the server (pong) over {} answered {} of {} warm-up messages, and none for {:g} s. Possible "
          "causes: the payload is larger than {}the link carries; a firewall drops it{}{}",
          end_->task().transport, answers, end_->task().client.warm_up, seconds(limit_),
          served_ ? "" : "the server accepts (pong --payload SIZE) or ",
          client.counters().wrong_size > 0 ? "; another program answers (with payloads of another size)" : "",
          end_->task().background.callback.count() > 0
              ? "; callbacks of background topics (background.callback) keep its thread busy"
              : ""));
    }
    return 5ms;
  }

  void begin() {
    end_->begin();
    // SCHED_BATCH: this thread must not pre-empt a measuring thread.
    const sched_param none{};
    sched_setscheduler(0, SCHED_BATCH, &none);
    events_.tell("begun");
  }

  void go() {
    if (end_->background() != nullptr) end_->background()->go();
    if (end_->client() == nullptr) return;
    auto& client = *end_->client();
    peers_ = {.readers = 1, .writers = 1, .changed_ns = end_->endpoint().matched().changed_ns};
    next_progress_ = Clock::now() + progress_period;
    finish_ = Clock::now() + end_->task().client.duration;
    stage_ = Stage::measuring;
    client.go();
  }

  // Reads nothing but what the measuring threads publish.
  milliseconds measure() {
    auto& client = *end_->client();
    tell_of_peers();
    if (client.state() == roundtrip::Client::State::finished) {
      finish();
      return 500ms;
    }
    const auto now = Clock::now();
    if (now >= next_progress_) {
      next_progress_ = now + progress_period;
      events_.tell("progress", {{"counters", to_json(client.counters())}});
    }
    return std::clamp(std::chrono::ceil<milliseconds>(finish_ - now), milliseconds(5),
                      milliseconds(progress_period));
  }

  void tell_of_peers() {
    const auto now = end_->endpoint().matched();
    const bool as_before = now.readers == peers_.readers && now.writers == peers_.writers;
    if (as_before && now.changed_ns == peers_.changed_ns) return;
    peers_ = now;
    events_.tell("peer", {{"readers", now.readers},
                          {"writers", now.writers},
                          {"as_before", as_before},
                          {"at_ns", now.changed_ns}});
  }

  void stop() {
    if (end_->background() != nullptr) end_->background()->stop();
    auto* client = end_->client();
    if (client == nullptr) return;
    client->stop();
    finish_ = Clock::now();
    if (stage_ != Stage::measuring) finish();
  }

  void finish() {
    stage_ = Stage::idle;
    const auto waited = recorder_ ? recorder_->finish() : 0;
    recorder_.reset();
    events_.tell("finished", {{"counters", to_json(end_->client()->counters())}, {"waited_bytes", waited}});
  }

  static double seconds(std::chrono::nanoseconds time) { return std::chrono::duration<double>(time).count(); }

  orders::Events& events_;
  std::unique_ptr<End> end_;
  std::unique_ptr<Recorder> recorder_;  // before the end whose samples it hands over
  Stage stage_ = Stage::idle;
  bool shares_link_ = false, notes_answers_ = false;
  std::chrono::nanoseconds wait_{0}, limit_{0};  // limit: of the warm-up, for the next answer
  bool served_ = false;                          // ontime started the server
  std::uint64_t answered_ = 0;                   // of the warm-up
  transport::Matched peers_;
  Clock::time_point until_, next_progress_, finish_;
};

}  // namespace

int serve() {
  return orders::serve(sample_layout(),
                       [](orders::Events& events) { return std::make_unique<Agent>(events); });
}

}  // namespace ontime::agent

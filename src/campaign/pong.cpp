// SPDX-License-Identifier: Apache-2.0
// The server (pong) by hand. With `explain` its machine is traced. Only the client knows which messages were
// late; the server keeps what the kernel did around the messages that came, or were answered, longest after
// the one before.
#include <algorithm>
#include <deque>
#include <map>
#include <set>
#include <utility>

#include "agent/agent.hpp"
#include "campaign/campaign.hpp"
#include "campaign/machines.hpp"
#include "campaign/pair.hpp"
#include "campaign/windows.hpp"
#include "message/message.hpp"

namespace ontime::campaign {
namespace {

using nlohmann::json;
using roundtrip::Server;

constexpr std::size_t pong_max_payload_bytes = 60'000;  // where none is stated: what every transport carries
constexpr std::size_t most_messages = 48, most_pings = 8;
constexpr std::int64_t around_ns = 1'000'000;  // in which a thread was woken, or the answer left
constexpr std::int64_t longest_ns = 1'000'000'000;

// The messages of one client that are worth a look.
class Ping {
 public:
  explicit Ping(std::uint32_t session) : session_(session) {}
  std::uint32_t session() const { return session_; }

  std::optional<trace::Span> add(const Server::Answer& answer) {
    const auto before = std::exchange(last_, answer);
    if (!before || answer.sequence <= before->sequence) return {};
    const Chosen candidate{answer.sent_ns - before->received_ns, message::index_of(answer.sequence)};
    const bool is_next = answer.sequence == before->sequence + 1;
    auto &alike = is_next ? next_ : after_a_gap_, &others = is_next ? after_a_gap_ : next_;
    if (alike.size() + others.size() == most_messages) {
      auto& too_many = alike.size() < most_messages / 2 ? others : alike;
      if (&too_many == &alike && candidate < *alike.begin()) return {};
      windows_.erase(too_many.begin()->message);
      too_many.erase(too_many.begin());
    }
    alike.insert(candidate);
    return trace::Span{candidate.message,
                       std::max(before->received_ns, answer.received_ns - longest_ns) - around_ns,
                       answer.sent_ns + around_ns};
  }
  void take(const trace::Window& window) {
    const auto message = window.span.message;
    for (const auto* chosen : {&next_, &after_a_gap_})
      if (std::ranges::count(*chosen, message, &Chosen::message) > 0) windows_[message] = window;
  }
  std::vector<trace::Window> windows() const {
    std::vector<trace::Window> all;
    for (const auto& [message, window] : windows_) all.push_back(window);
    return all;
  }

 private:
  std::uint32_t session_;
  std::optional<Server::Answer> last_;
  // Where messages were lost or skipped the time since the one before is long of itself: each of the two has
  // half of the places, and more where the other needs fewer.
  std::set<Chosen> next_, after_a_gap_;
  std::map<std::uint64_t, trace::Window> windows_;
};

// This machine, and the last pings that came.
class Traced {
 public:
  Traced(orders::Coordinator& coordinator, Observer& observer) : machines_(coordinator, observer) {
    Hosts alone;
    alone.kind = Hosts::Kind::alone;
    machines_.prepare(alone);
    machines_.trace([this](const auto&, trace::Window window) { take(std::move(window)); });
  }

  void add(std::span<const Server::Answer> answers) {
    for (const auto& answer : answers)
      if (const auto span = of(message::session_of(answer.sequence)).add(answer)) {
        spans_.push_back(*span);
        spans_.back().message = asked_.size() + given_;
        asked_.emplace_back(message::session_of(answer.sequence), span->message);
      }
  }
  // In the loop, not in a handler.
  void order() {
    if (spans_.empty()) return;
    machines_.cut_out("controller", spans_);
    spans_.clear();
  }
  bool all_came() const { return asked_.empty(); }

  // What is known now. It asks no other process, which may be gone.
  void tell(Served& served) const {
    for (const auto& ping : pings_) served.pings.push_back(ping.windows());
    served.outcome.trace = {{"component", find(machines_.how_traced("component"), "controller")}};
    served.outcome.hosts["component"].machine = machines_.machine("controller");
  }
  void close() { machines_.close(); }

 private:
  Ping& of(std::uint32_t session) {
    const auto found = std::ranges::find(pings_, session, &Ping::session);
    if (found != pings_.end()) return *found;
    std::erase_if(pings_,
                  [&](const Ping& ping) { return ping.session() == message::warm_up_session_of(session); });
    if (pings_.size() == most_pings) pings_.pop_front();
    return pings_.emplace_back(session);
  }

  // Windows come in the order of the requests, each with its own number: two clients may have the same
  // message.
  void take(trace::Window window) {
    const auto number = window.span.message;
    if (number < given_ || number - given_ >= asked_.size())
      throw Error(3, "the trace of this machine has an unexpected window (a bug: please report)");
    const auto [session, message] = asked_[number - given_];
    window.span.message = message;
    for (auto& ping : pings_)
      if (ping.session() == session) ping.take(window);
    ++came_;
    if (came_ == given_ + asked_.size()) {
      given_ = came_;
      asked_.clear();
    }
  }

  Machines machines_;
  std::deque<Ping> pings_;  // the oldest first
  std::vector<trace::Span> spans_;
  // Session and message, by number from `given_` on.
  std::deque<std::pair<std::uint32_t, std::uint64_t>> asked_;
  std::uint64_t given_ = 0, came_ = 0;
};

}  // namespace

int pong(const Run& run, Observer& observer, Interrupts& interrupts,
         const std::function<void(const record::Host&)>& told, Served& served) {
  orders::Coordinator coordinator(interrupts);
  std::optional<Traced> traced;
  auto& component = served.outcome.hosts["component"];
  const auto keep = [&] {
    if (!component.threads.empty()) traced->tell(served);
  };
  try {
    if (run.explain) traced.emplace(coordinator, observer);
    orders::Coordinator::Hand agent(coordinator, "the agent", {orders::this_program(), "agent"},
                                    agent::sample_layout());
    auto task = server_task(run, Host{});
    if (run.task.config.max_payload_bytes == 0 &&
        !is_below_ip(run.task.transport))  // whose link's MTU says it
      task.config.max_payload_bytes = pong_max_payload_bytes;
    const auto opened =
        record::read<record::Host>(agent.ask("open", {{"task", agent::to_json(task)}}, "opened", patience));
    agent.on("answered", [&](const orders::Frame& frame) { traced->add(agent::answers_of(frame.bytes)); });
    agent.ask("start", {{"wait_ns", 0}, {"note_answers", run.explain}}, "ready", patience);
    // Windows need the threads of the server; they are read now, in case it does not end in order.
    const auto ended = [&](int tolerated) {
      return record::read<record::Host>(agent.ask("end", json::object(), "ended", patience, tolerated));
    };
    if (traced) component = ended(0);
    told(opened);
    coordinator.until(
        [&] {
          if (traced) traced->order();
          return interrupts > 0;
        },
        1);
    const auto end = ended(1);
    served.answered = end.answered;
    if (traced) component = end;
    if (traced) {
      const auto until = std::chrono::steady_clock::now() + patience;
      coordinator.until(
          [&] {
            traced->order();
            return traced->all_came() || std::chrono::steady_clock::now() > until;
          },
          1);
      traced->close();
    }
  } catch (const orders::Interrupted&) {  // a second interruption: leave at once
  } catch (...) {
    keep();
    throw;
  }
  keep();
  return 130;
}

}  // namespace ontime::campaign

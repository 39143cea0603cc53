// SPDX-License-Identifier: Apache-2.0
#include "explain/explain.hpp"

#include <algorithm>
#include <deque>
#include <map>
#include <set>
#include <tuple>

#include <fmt/format.h>

#include "explain/limits.hpp"
#include "explain/way.hpp"

namespace ontime::explain {
namespace {

using roundtrip::Fate;
using roundtrip::Sample;
using trace::Kind;

// The longest stage of a message that is accepted from a file; a longer one is not evaluated.
constexpr std::int64_t longest_ns = std::int64_t{86'400} * 1'000'000'000;
constexpr std::size_t most_threads = 1000;  // of a process that measures
constexpr std::size_t most_downs = 100;     // of a link
constexpr std::int64_t forever_ns = 1'000'000'000'000'000'000;
constexpr std::size_t most_lost = 16;  // that are looked at

End end_of(const record::Run& run, const char* host) {
  End end{host, {}, nullptr};
  const auto& of = record::find(run.outcome.hosts, host);
  const auto& threads = of.threads;
  end.interface = of.link.interface;
  const auto can_be = [](std::int64_t ns) { return -forever_ns <= ns && ns <= forever_ns; };
  for (const auto& [from_ns, to_ns, taken] : of.link.down) {
    const auto until_ns = to_ns.value_or(forever_ns);
    if (from_ns && can_be(*from_ns) && can_be(until_ns) && end.downs.size() < most_downs)
      end.downs.push_back({*from_ns, until_ns, taken});
  }
  if (threads.size() > most_threads)
    throw record::WrongFile(
        fmt::format("run {} has {} threads at its {}, more than the possible {}: the file is damaged or "
                    "forged",
                    run.number, threads.size(), host, most_threads));
  for (const auto& thread : threads) {
    if (thread.is_of_background_topics()) continue;  // their packets carry no measured messages
    end.threads.push_back({static_cast<std::int32_t>(thread.tid.value_or(0)), thread.role});
  }
  return end;
}

// 0: not set, or not possible.
std::int64_t possible(std::chrono::nanoseconds time) {
  constexpr std::int64_t too_long_ns = 1'000'000'000'000'000;
  return time.count() > 0 && time.count() < too_long_ns ? time.count() : 0;
}

// The server's end in a run by hand on one machine, where only ping's results are known: found in the trace.
// The client's packets went over the loopback, and another thread sent packets of that size when the answers
// were sent. nullopt: the trace shows no such thread.
std::optional<End> end_over_loopback(const record::Reader& reader, const record::Run& run, const End& client,
                                     std::int64_t packet_bytes) {
  bool is_there = false;
  using Sent = std::pair<std::int32_t, std::int64_t>;
  std::map<std::uint64_t, std::vector<Sent>> sent;  // around a message: by which thread, when
  reader.each_trace(run.number, [&](const record::Trace& trace) {
    auto& around = sent[trace.window.span.message];
    for (const auto& event : trace.window.events) {
      if (event.kind != Kind::queued || event.what != "lo" || event.bytes < packet_bytes) continue;
      is_there = is_there || client.has(event.thread.id);
      if (!client.has(event.thread.id)) around.emplace_back(event.thread.id, event.at_ns);
    }
  });
  std::map<std::int32_t, int> times;  // that a thread sent when the server did
  reader.each_sample(run.number, [&](const Sample& sample) {
    const auto around = sent.find(sample.index);
    if (around == sent.end() || sample.received_ns == 0 || sample.server_sent_ns == 0) return;
    for (const auto& [thread, at_ns] : around->second)
      times[thread] += sample.server_sent_ns <= at_ns && at_ns <= sample.received_ns ? 1 : 0;
  });
  const auto most = std::ranges::max_element(times, {}, [](const auto& one) { return one.second; });
  if (!is_there || most == times.end() || most->second == 0) return {};
  return End{.name = "component", .threads = {{most->first, "receive"}}, .interface = "lo"};
}

// Why messages of one run were late or lost.
class Explainer {
 public:
  Explainer(const record::Reader& reader, const record::Run& run, const Pong* pong)
      : payload_bytes_(static_cast<std::int64_t>(run.asked.task.client.payload_bytes)),
        client_(end_of(run, "controller")),
        beside_(is_by_hand(run) && pong == nullptr
                    ? end_over_loopback(reader, run, client_, least_packet_bytes(payload_bytes_))
                    : std::nullopt),
        server_(beside_ ? *beside_ : end_of(pong != nullptr ? pong->run() : run, "component")),
        pong_(pong),
        one_machine_(beside_ || record::on_one_machine(run.outcome)),
        deadline_ns_(deadline_ns_of(run)),
        timeout_ns_(possible(run.asked.task.client.timeout)),
        usual_(reader, run.number, one_machine_) {}

  bool is_late_by_response(const Sample& sample) const {
    return sample.fate == Fate::on_time && is_late_from(sample, awaited_since_ns(sample));
  }
  bool is_late_from(const Sample& sample, std::int64_t since_ns) const {
    return deadline_ns_ > 0 && sample.received_ns - since_ns > deadline_ns_;
  }

  bool one_machine() const { return one_machine_; }
  // The error of the offset between the component's and the controller's clock.
  std::int64_t uncertainty_ns(const Sample& sample) const { return usual_.uncertainty_ns(sample.sent_ns); }

  // What pong kept about that message; nullptr: nothing, or there is no pong.
  const record::Trace* of_pong(const Sample& sample) const {
    return pong_ == nullptr
               ? nullptr
               : pong_->trace_of(sample, sample.sent_ns - usual_.server_later_ns(sample.sent_ns));
  }

  Message explain(const Sample& sample, const Traces& traces) const {
    Message message{.sample = sample, .late_by_response = is_late_by_response(sample)};
    std::optional<Timeline> here, there;
    const auto server_later_ns = usual_.server_later_ns(sample.sent_ns);
    auto until_ns = sample.sent_ns;
    for (const auto* trace : traces) {
      const bool of_client = trace->host == "controller";
      const auto later_ns = of_client ? 0 : server_later_ns;
      (of_client ? here : there).emplace(trace->window, later_ns);
      until_ns = std::max(until_ns, trace->window.span.to_ns + later_ns);
      message.whole = message.whole && trace->window.whole;
    }
    auto client = client_, server = server_;
    if (server_later_ns < -forever_ns || forever_ns < server_later_ns) server.downs.clear();
    for (auto& down : server.downs) {
      down.from_ns += server_later_ns;
      down.to_ns += server_later_ns;
    }
    client.timeline = here ? &*here : nullptr;
    server.timeline = one_machine_ ? client.timeline : there ? &*there : nullptr;
    Way way(std::move(client), std::move(server), usual_, payload_bytes_, one_machine_);
    until_ns = std::min(until_ns, sample.sent_ns + longest_ns);
    const auto is_possible = [](const Leg& leg) {
      return -longest_ns <= leg.length_ns() && leg.length_ns() <= longest_ns;
    };
    const auto way_of = usual_.of(sample);
    const bool can_be =
        std::all_of(way_of.begin(), has_server_times(sample) ? way_of.end() : way_of.begin() + senders_legs,
                    is_possible) &&
        is_possible({sample.sent_ns, sample.received_ns});
    if (can_be && sample.fate != Fate::lost) message.parts = way.delays_of(sample);
    if (timeout_ns_ > 0) until_ns = std::min(until_ns, sample.sent_ns + timeout_ns_);
    if (sample.fate == Fate::lost) message.parts = way.loss_of(sample, until_ns);
    for (const auto& part : message.parts) message.delay_ns += part.ns;
    return message;
  }

  Scene scene(const Sample& sample, const Traces& traces) const {
    Scene scene;
    scene.uncertainty_ns = uncertainty_ns(sample);
    scene.one_machine = one_machine_;
    const auto server_later_ns = usual_.server_later_ns(sample.sent_ns);
    for (const auto* trace : traces) {
      const auto later_ns = trace->host == "controller" ? 0 : server_later_ns;
      const auto& [message, from_ns, to_ns] = trace->window.span;
      scene.machines.push_back(
          {trace->host, from_ns + later_ns, to_ns + later_ns, {trace->window, later_ns}});
    }
    for (const auto* end : {&client_, &server_})
      for (const auto& [id, role] : end->threads) scene.threads.push_back({end->name, role, id});
    const auto way = usual_.of(sample);
    if (sample.server_received_ns != 0) scene.there_ns = way[2].to_ns;
    if (sample.server_sent_ns != 0) scene.answered_ns = way[3].to_ns;
    const bool is_lost = sample.fate == Fate::lost;
    auto end_ns = is_lost ? sample.sent_ns : sample.received_ns;
    for (const auto& machine : scene.machines)
      if (is_lost) end_ns = std::max(end_ns, machine.to_ns);
    const auto add = [&](const char* name, std::int64_t until_ns) {
      const auto from_ns = scene.legs.empty() ? awaited_since_ns(sample) : scene.legs.back().to_ns;
      scene.legs.push_back({name, from_ns, std::max(from_ns, until_ns)});
    };
    add("sender wake-up", sample.woke_ns);
    add("sending", sample.sent_ns);
    if (scene.there_ns && scene.answered_ns) {
      add("request leg", *scene.there_ns);
      add("server turnaround", *scene.answered_ns);
      add("reply leg", end_ns);
    } else {
      add(is_lost ? "lost" : "both legs", end_ns);
    }
    return scene;
  }

 private:
  const std::int64_t payload_bytes_;
  const End client_;
  const std::optional<End> beside_;
  const End server_;
  const Pong* const pong_;
  const bool one_machine_;
  const std::int64_t deadline_ns_, timeout_ns_;
  const Usual usual_;
};

// A place where messages end. One that was sent again after a drop was late.
bool is_of_lost(const Part& part) {
  return part.ns == 0 && (part.cause == Cause::dropped || part.cause == Cause::unknown);
}

std::vector<Group> groups_of(const record::Run& run, const std::vector<Message>& messages) {
  std::vector<Group> groups;
  std::vector<std::set<std::int32_t>> threads;
  for (const auto& message : messages) {
    if (!message.is_fault() || message.parts.empty()) continue;
    const auto& first = message.parts.front();
    const auto found = std::find_if(groups.begin(), groups.end(),
                                    [&](const Group& group) { return same_cause(group.culprit, first); });
    const auto place = static_cast<std::size_t>(found - groups.begin());
    if (found == groups.end()) {
      groups.push_back(
          {.culprit = first, .least_ns = first.ns, .most_ns = first.ns, .remedy = remedy_for(first, run)});
      groups.back().culprit.when.clear();
      threads.emplace_back();
    }
    auto& group = groups[place];
    ++group.messages;
    group.least_ns = std::min(group.least_ns, first.ns);
    group.most_ns = std::max(group.most_ns, first.ns);
    threads[place].insert(first.culprit_threads.begin(), first.culprit_threads.end());
    group.threads = threads[place].size();
  }
  std::ranges::stable_sort(groups, std::ranges::greater(), &Group::messages);
  return groups;
}

}  // namespace

bool same_cause(const Part& one, const Part& other) {
  return one.cause == other.cause && one.end == other.end && one.thread == other.thread &&
         one.via == other.via && one.culprit == other.culprit && is_of_lost(one) == is_of_lost(other) &&
         (!is_of_lost(one) || one.stage == other.stage);
}

std::int64_t deadline_ns_of(const record::Run& run) { return possible(run.asked.task.client.deadline); }

Account account_of(const record::Reader& reader, const record::Run& run, const Pong* pong) {
  Account account;
  if (run.asked.is_listened()) {  // `listen` explains its messages
    reader.each_sample(run.number,
                       [&](const Sample& sample) { account.late += sample.fate == Fate::late ? 1 : 0; });
    // The counts of a file that is being written, or whose ontime was killed, are older than its messages.
    if (run.asked.keeps_worst()) account.late = std::max(account.late, run.outcome.counters.late);
    return account;
  }
  account.traced = run.outcome.trace.has_value();
  std::deque<record::Trace> own;
  TracesByMessage traces;
  reader.each_trace(run.number, [&](const record::Trace& trace) {
    traces[trace.window.span.message].push_back(&own.emplace_back(trace));
  });
  account.traced = account.traced || !traces.empty() || pong != nullptr;
  if (!account.traced) return account;
  const Explainer explainer(reader, run, pong);
  std::size_t lost_looked_at = 0;
  reader.each_sample(run.number, [&](const Sample& sample) {
    account.late += sample.fate == Fate::late ? 1 : 0;
    account.lost += sample.fate == Fate::lost ? 1 : 0;
    if (explainer.is_late_by_response(sample))
      ++(explainer.is_late_from(sample, sample.due_ns) ? account.late_by_response : account.after_skipped);
    const bool is_lost = sample.fate == Fate::lost;
    // One window of pong's trace may cover all messages that were lost in an outage.
    const bool is_one_too_many = is_lost && lost_looked_at >= most_lost && !traces.contains(sample.index);
    if (const auto* const there = is_one_too_many ? nullptr : explainer.of_pong(sample))
      traces[sample.index].push_back(there);
    const auto found = traces.find(sample.index);
    if (found == traces.end()) return;
    lost_looked_at += is_lost ? 1 : 0;
    account.messages.push_back(explainer.explain(sample, found->second));
  });
  std::ranges::stable_sort(account.messages, std::ranges::greater(), [](const Message& message) {
    return std::tuple(message.sample.fate, message.is_fault(), message.delay_ns);
  });
  account.groups = groups_of(run, account.messages);
  std::optional<std::int64_t> worst_ns;
  if (!explainer.one_machine())
    for (const auto& message : account.messages)
      worst_ns = std::max(worst_ns.value_or(0), explainer.uncertainty_ns(message.sample));
  account.limits = limits_of(account, run, traces, explainer.one_machine(), worst_ns);
  return account;
}

void each_scene(const record::Reader& reader, const record::Run& run, const std::vector<Message>& messages,
                const std::function<void(const Message&, const Scene&)>& use, const Pong* pong) {
  std::deque<record::Trace> own;
  std::map<std::uint64_t, std::pair<const Message*, Traces>> wanted;
  for (const auto& message : messages) wanted[message.sample.index].first = &message;
  reader.each_trace(run.number, [&](const record::Trace& trace) {
    const auto found = wanted.find(trace.window.span.message);
    if (found != wanted.end()) found->second.second.push_back(&own.emplace_back(trace));
  });
  const Explainer explainer(reader, run, pong);
  for (auto& [index, one] : wanted) {
    if (const auto* const there = explainer.of_pong(one.first->sample)) one.second.push_back(there);
    use(*one.first, explainer.scene(one.first->sample, one.second));
  }
}

}  // namespace ontime::explain

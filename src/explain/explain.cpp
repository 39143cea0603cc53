// SPDX-License-Identifier: Apache-2.0
#include "explain/explain.hpp"

#include <algorithm>
#include <deque>
#include <map>
#include <optional>
#include <set>
#include <tuple>

#include <fmt/format.h>

#include "explain/way.hpp"

namespace ontime::explain {
namespace {

using nlohmann::json;
using record::at;
using roundtrip::Fate;
using roundtrip::Sample;

// Of any of a message's stages: beyond it nothing of a file is believed, nor calculated with.
constexpr std::int64_t longest_ns = std::int64_t{86'400} * 1'000'000'000;
constexpr std::size_t most_threads = 1000;  // of a process that measures
constexpr std::size_t most_downs = 100;     // of a link
constexpr std::int64_t forever_ns = 1'000'000'000'000'000'000;
constexpr std::size_t most_lost = 16;  // that are looked at
using Traces = std::vector<const record::Trace*>;

// What is of another kind is nothing: the file may be anybody's.
std::string text_of(const json& value) { return value.is_string() ? value.get<std::string>() : ""; }
std::int64_t integer_of(const json& value) {
  return value.is_number_integer() ? value.get<std::int64_t>() : 0;
}

std::vector<Down> downs_of(const json& list) {
  std::vector<Down> downs;
  if (!list.is_array()) return downs;
  const auto can_be = [](const json& ns) {
    return ns.is_number_integer() && -forever_ns <= ns && ns <= forever_ns;
  };
  for (const auto& one : list) {
    const auto &from = at(one, "from_ns"), &to = at(one, "to_ns");
    if (!can_be(from) || !(to.is_null() || can_be(to)) || downs.size() == most_downs) continue;
    downs.push_back({integer_of(from), to.is_null() ? forever_ns : integer_of(to), at(one, "taken") == true});
  }
  return downs;
}

End end_of(const record::Run& run, const char* host) {
  End end{host, {}, nullptr};
  const auto& of_host = at(at(run.outcome, "hosts"), host);
  const auto& link = at(of_host, "link");
  end.interface = text_of(at(link, "interface"));
  end.downs = downs_of(at(link, "down"));
  const auto& threads = at(of_host, "threads");
  if (!threads.is_array()) return end;
  if (threads.size() > most_threads)
    throw record::WrongFile(
        fmt::format("run {} has {} threads at its {}, where there are at most {}: the file is "
                    "damaged, or was made to mislead",
                    run.number, threads.size(), host, most_threads));
  for (const auto& thread : threads) {
    const auto role = text_of(at(thread, "role"));
    if (role.starts_with("neighbours ")) continue;  // what they send is none of ours
    end.threads.push_back({static_cast<std::int32_t>(integer_of(at(thread, "tid"))), role});
  }
  return end;
}

// 0: nothing was asked for, or nothing that can be.
std::int64_t asked_ns(const json& asked, const char* key) {
  const auto& us = at(asked, key);
  constexpr double longest_us = 1e12;
  return us.is_number() && us.get<double>() > 0 && us.get<double>() < longest_us
             ? static_cast<std::int64_t>(us.get<double>() * 1e3)
             : 0;
}

// Of whoever knows the threads, and nobody else, what the kernel did says why.
class Explainer {
 public:
  Explainer(const record::Reader& reader, const record::Run& run, const Pong* pong)
      : client_(end_of(run, "controller")),
        server_(end_of(pong != nullptr ? pong->run() : run, "component")),
        pong_(pong),
        one_machine_(record::on_one_machine(run.outcome)),
        payload_bytes_(integer_of(at(run.asked, "payload_bytes"))),
        deadline_ns_(asked_ns(run.asked, "deadline_us")),
        timeout_ns_(asked_ns(run.asked, "timeout_us")),
        usual_(reader, run.number, one_machine_) {}

  bool is_late_by_response(const Sample& sample) const {
    return sample.fate == Fate::on_time && deadline_ns_ > 0 &&
           sample.received_ns - awaited_since_ns(sample) > deadline_ns_;
  }

  bool one_machine() const { return one_machine_; }
  // How well the component's clock is known beside the controller's.
  std::int64_t uncertainty_ns(const Sample& sample) const { return usual_.uncertainty_ns(sample.sent_ns); }

  // What it kept of that message; nullptr: nothing, or there is none.
  const record::Trace* of_pong(const Sample& sample) const {
    return pong_ == nullptr
               ? nullptr
               : pong_->trace_of(sample, sample.sent_ns - usual_.server_later_ns(sample.sent_ns));
  }

  Message explain(const Sample& sample, const Traces& traces) const {
    Message message{.sample = sample,
                    .delay_ns = 0,
                    .parts = {},
                    .whole = true,
                    .late_by_response = is_late_by_response(sample)};
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
    const auto way_of = usual_.of(sample);
    const bool can_be = std::all_of(way_of.begin(), way_of.end(), [](const Leg& leg) {
      return -longest_ns <= leg.length_ns() && leg.length_ns() <= longest_ns;
    });
    const bool all_times = can_be && sample.fate != Fate::lost && has_server_times(sample);
    if (all_times) message.parts = way.delays_of(sample);
    if (timeout_ns_ > 0) until_ns = std::min(until_ns, sample.sent_ns + timeout_ns_);
    if (sample.fate == Fate::lost) message.parts = way.loss_of(sample, until_ns);
    for (const auto& part : message.parts) message.delay_ns += part.ns;
    return message;
  }

  Scene scene(const Sample& sample, const Traces& traces) const {
    Scene scene{.machines = {},
                .threads = {},
                .legs = {},
                .there_ns = {},
                .answered_ns = {},
                .uncertainty_ns = uncertainty_ns(sample),
                .one_machine = one_machine_};
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
    add("wakes", sample.woke_ns);
    add("is sent", sample.sent_ns);
    if (scene.there_ns && scene.answered_ns) {
      add("on its way there", *scene.there_ns);
      add("is answered", *scene.answered_ns);
      add("on its way back", end_ns);
    } else {
      add(is_lost ? "never comes back" : "there and back", end_ns);
    }
    return scene;
  }

 private:
  const End client_, server_;
  const Pong* const pong_;
  const bool one_machine_;
  const std::int64_t payload_bytes_, deadline_ns_, timeout_ns_;
  const Usual usual_;
};

// Of one message for another: the same culprit.
bool same(const Part& one, const Part& other) {
  return one.cause == other.cause && one.end == other.end && one.thread == other.thread &&
         one.culprit == other.culprit && (one.cause != Cause::dropped || one.stage == other.stage);
}

// Whether the callbacks of its neighbours run on the thread that receives its messages.
bool shares_callbacks(const record::Run& run, const std::string& end) {
  const auto& neighbours = at(run.asked, "neighbours");
  if (at(neighbours, end == "component" ? "there" : "back") != true) return false;
  const bool is_component = end == "component";
  const auto where = text_of(at(neighbours, "where"));
  const auto transport = text_of(at(run.asked, is_component ? "component_transport" : "transport"));
  if (where == "same-callback-group") return true;
  if (where == "same-node" || where == "same-executor")
    return text_of(at(at(run.asked, is_component ? "component_options" : "options"), "executor")) != "multi";
  if (text_of(at(run.asked, "receive")) == "waitset") return false;
  return (where == "same-participant" && transport != "ros2") ||
         (where == "same-process" && transport == "cyclonedds");
}

std::string remedy_in(const record::Run& run, const Part& part) {
  const auto callback_ns = asked_ns(at(run.asked, "neighbours"), "callback_us");
  if (part.cause != Cause::busy || part.thread != "receive" || callback_ns == 0 ||
      !shares_callbacks(run, part.end))
    return remedy_of(part);
  return fmt::format(
      "the neighbours' callbacks, {:g} ms each, run on it too: give them a thread of their own "
      "(neighbours.where)",
      static_cast<double>(callback_ns) / 1e6);
}

std::vector<Group> groups_of(const record::Run& run, const std::vector<Message>& messages) {
  std::vector<Group> groups;
  std::vector<std::set<std::int32_t>> threads;
  for (const auto& message : messages) {
    if (!message.is_fault() || message.parts.empty()) continue;
    const auto& first = message.parts.front();
    const auto found = std::find_if(groups.begin(), groups.end(),
                                    [&](const Group& group) { return same(group.culprit, first); });
    const auto place = static_cast<std::size_t>(found - groups.begin());
    if (found == groups.end()) {
      groups.push_back(
          {.culprit = first, .least_ns = first.ns, .most_ns = first.ns, .remedy = remedy_in(run, first)});
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
  std::stable_sort(groups.begin(), groups.end(),
                   [](const Group& one, const Group& other) { return one.messages > other.messages; });
  return groups;
}

using TracesByMessage = std::map<std::uint64_t, Traces>;

// A kernel that says how a CPU leaves its idle thread leaves nothing to be inferred; but for events that are
// lost.
void add_untold_switches(Account& account, const TracesByMessage& traces) {
  constexpr std::size_t surely_some = 10;
  std::map<std::pair<std::string, int>, std::size_t> inferred;
  for (const auto& [message, windows] : traces)
    for (const auto* trace : windows) {
      const auto& window = trace->window;
      for (const auto& [event, latest_ns] : scheduling_of(window.events, window.span.from_ns))
        if (latest_ns > event.at_ns && latest_ns >= window.span.from_ns) ++inferred[{trace->host, event.cpu}];
    }
  for (const auto& [place, switches] : inferred)
    if (switches >= surely_some)
      account.limits.push_back(fmt::format(
          "the kernel of the {}'s machine does not tell when CPU {} leaves idle: it is inferred from "
          "what is done on it next, and of what passed until then nobody is accused",
          place.first, place.second));
}

void add_limits(Account& account, const record::Run& run) {
  const auto& traced = at(run.outcome, "trace");
  if (traced.is_object())
    for (const auto& [host, answer] : traced.items()) {
      if (const auto error = text_of(at(answer, "error")); !error.empty())
        account.limits.push_back(
            fmt::format("nothing is known of what the {}'s machine did: {}", host, error));
      const auto& missing = at(answer, "missing");
      if (missing.is_array())
        for (const auto& what : missing)
          account.limits.push_back(
              fmt::format("the kernel of the {}'s machine does not tell {}", host, text_of(what)));
    }
  std::uint64_t late = 0, lost = 0, in_part = 0;
  for (const auto& message : account.messages) {
    lost += message.sample.fate == Fate::lost ? 1 : 0;
    late += message.is_fault() && message.sample.fate != Fate::lost ? 1 : 0;
    in_part += message.whole ? 0 : 1;
  }
  const auto all_late = account.late + account.late_by_response;
  if (late < all_late || lost < account.lost)
    account.limits.push_back(
        fmt::format("looked at: the worst {} of {} late and the first {} of {} lost messages", late, all_late,
                    lost, account.lost));
  if (in_part > 0)
    account.limits.push_back(
        fmt::format("of {} message{} a part of what the kernel did is not known: more happened than was kept",
                    in_part, in_part == 1 ? "" : "s"));
}

// Of two machines what was seen of one says nothing of the other.
void add_one_sided(Account& account, const record::Run& run, const TracesByMessage& traces) {
  const bool by_hand = at(at(run.outcome, "hosts"), "component").is_null();
  for (const auto* host : {"controller", "component"}) {
    const auto is_seen = [&](const auto& message) {
      return std::any_of(message.second.begin(), message.second.end(),
                         [&](const auto* trace) { return trace->host == host; });
    };
    if (!traces.empty() && std::none_of(traces.begin(), traces.end(), is_seen)) {
      const auto* const remedy =
          !by_hand ? ""
          : host == std::string_view("component")
              ? " (ontime pong --explain --results FILE there, and ontime explain … --pong FILE)"
              : " (ontime ping --explain)";
      if (text_of(at(at(at(run.outcome, "trace"), host), "error")).empty())  // or else it is told
        account.limits.push_back(
            fmt::format("nothing is known of what the {}'s machine did{}", host, remedy));
      continue;
    }
    std::size_t faults = 0, of_others = 0;
    for (const auto& message : account.messages) {
      if (!message.is_fault()) continue;
      ++faults;
      of_others += is_seen(*traces.find(message.sample.index)) ? 0 : 1;
    }
    if (of_others > 0)
      account.limits.push_back(
          fmt::format("of {} of the {} late and lost messages that were looked at nothing is known of what "
                      "the {}'s machine did",
                      of_others, faults, host));
  }
}

}  // namespace

Pong::Pong(const record::Reader& kept, const record::Reader& reader, const record::Run& run) {
  std::map<std::uint64_t, std::int64_t> received_ns;  // by message
  reader.each_sample(run.number, [&](const Sample& sample) {
    if (sample.server_received_ns != 0) received_ns[sample.index] = sample.server_received_ns;
  });
  std::size_t most = 0;
  for (auto& one : kept.runs()) {
    std::size_t fit = 0;
    bool is_anothers = false;
    kept.each_trace(one.number, [&](const record::Trace& trace) {
      const auto& [span, whole, events] = trace.window;
      const auto at = received_ns.find(span.message);
      if (trace.host != "component" || at == received_ns.end()) return;
      const bool may_be_cut_off = !whole && span.to_ns < at->second;
      const bool fits = span.from_ns <= at->second && at->second <= span.to_ns;
      fit += fits ? 1 : 0;
      is_anothers = is_anothers || (!fits && !may_be_cut_off);
    });
    if (is_anothers || fit <= most) continue;
    most = fit;
    run_ = std::move(one);
  }
  if (most == 0)
    throw record::WrongFile(fmt::format(
        "no pong --explain kept there what it did when it answered run {}: its file is another's, or "
        "of another time",
        run.number));
  kept.each_trace(run_.number, [&](const record::Trace& trace) {
    if (trace.host == "component") traces_.push_back(trace);
  });
}

// Of the message itself; of one that never came, that of the time at which it should have.
const record::Trace* Pong::trace_of(const Sample& sample, std::int64_t sent_there_ns) const {
  const auto there_ns = sample.server_received_ns != 0 ? sample.server_received_ns : sent_there_ns;
  const record::Trace* best = nullptr;
  for (const auto& trace : traces_) {
    const auto& span = trace.window.span;
    if (there_ns < span.from_ns || span.to_ns < there_ns) continue;
    const bool is_its = span.message == sample.index;
    if (is_its || (best == nullptr && sample.server_received_ns == 0)) best = &trace;
    if (is_its) break;
  }
  return best;
}

std::int64_t deadline_ns_of(const record::Run& run) { return asked_ns(run.asked, "deadline_us"); }

Account account_of(const record::Reader& reader, const record::Run& run, const Pong* pong) {
  Account account;
  account.traced = !at(run.outcome, "trace").is_null();
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
    account.late_by_response += explainer.is_late_by_response(sample) ? 1 : 0;
    const bool is_lost = sample.fate == Fate::lost;
    // One window of a pong's may be around all that was lost in an outage.
    const bool is_one_too_many = is_lost && lost_looked_at >= most_lost && !traces.contains(sample.index);
    if (const auto* const there = is_one_too_many ? nullptr : explainer.of_pong(sample))
      traces[sample.index].push_back(there);
    const auto found = traces.find(sample.index);
    if (found == traces.end()) return;
    lost_looked_at += is_lost ? 1 : 0;
    account.messages.push_back(explainer.explain(sample, found->second));
  });
  std::stable_sort(account.messages.begin(), account.messages.end(),
                   [](const Message& one, const Message& other) {
                     const auto badness = [](const Message& message) {
                       return std::tuple(message.sample.fate, message.is_fault(), message.delay_ns);
                     };
                     return badness(one) > badness(other);
                   });
  account.groups = groups_of(run, account.messages);
  add_limits(account, run);
  if (!explainer.one_machine()) {
    add_one_sided(account, run, traces);
    std::int64_t worst_ns = 0;
    for (const auto& message : account.messages)
      worst_ns = std::max(worst_ns, explainer.uncertainty_ns(message.sample));
    if (!account.messages.empty())
      account.limits.push_back(
          fmt::format("the component's clock is known to within {:.1f} us of the controller's: so much may "
                      "be wrong of where one machine's part of a message's way ends and the other's begins",
                      static_cast<double>(worst_ns) / 1e3));
  }
  add_untold_switches(account, traces);
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

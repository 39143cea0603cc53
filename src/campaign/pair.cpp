// SPDX-License-Identifier: Apache-2.0
#include "campaign/pair.hpp"

#include <random>

#include <fmt/format.h>

#include "campaign/background_topics.hpp"
#include "campaign/link.hpp"
#include "security/security.hpp"

namespace ontime::campaign {
namespace {

using nlohmann::json;

agent::Task client_task(const Run& run, const Host& host, const std::optional<Host>& component) {
  auto task = run.task;
  task.config.role = transport::Role::client;
  task.config.max_payload_bytes = task.client.payload_bytes;
  if (!host.interface.empty()) task.config.interface = host.interface;
  task.config.address = host.address;
  if (component) task.config.peers = {component->address};
  return task;
}

bool in_another_process(const roundtrip::BackgroundOptions& background) {
  return background.topics > 0 && background.where == roundtrip::Where::other_process;
}

agent::Task without_others(agent::Task task) {
  if (in_another_process(task.background)) task.background = {};
  return task;
}

// Adds what the agent of background topics reports to the report of that end.
void add_background(record::Host& host, const record::Host& ended) {
  host.background = ended.background;
  host.threads.insert(host.threads.end(), ended.threads.begin(), ended.threads.end());
  host.refusals.insert(host.refusals.end(), ended.refusals.begin(), ended.refusals.end());
}

// A change in the number of servers that the client sees.
record::Note note_of_peers(const json& event, int before) {
  const int now = event.at("writers");
  if (now == before)
    return {
        "peer-flickered",
        "a peer joined and left, or left and rejoined, within 1 s: a restarted server (pong), a second one, "
        "or a listener",
        event.at("at_ns"),
        {}};
  record::Note note{now < before ? "peer-left"
                    : now > 1    ? "second-pong"
                                 : "peer-came",
                    "",
                    event.at("at_ns"),
                    {}};
  if (now == 0)
    note.text = "server (pong) left: no answers";
  else if (now > 1)
    note.text =
        fmt::format("{0} servers (pong) answer: each request gets {0} answers, the first counts", now);
  else
    note.text = now < before ? "a server (pong) left, one still answers" : "server (pong) is back";
  return note;
}

}  // namespace

agent::Task server_task(const Run& run, const Host& host) {
  auto task = run.task;
  task.config.role = transport::Role::server;
  if (task.config.max_payload_bytes == 0) task.config.max_payload_bytes = task.client.payload_bytes;
  if (!host.interface.empty()) task.config.interface = host.interface;
  task.config.address = host.address;
  if (!run.component_transport.empty()) {
    task.transport = run.component_transport;
    task.config.options = run.component_options;
  }
  return task;
}

std::vector<record::Note> notes_of_cut(const Run& run, std::int64_t at_ns) {
  const auto& [at, length] = *run.cut;
  if (at + length >= run.task.client.duration)
    return {{"link-cut", "link cut until the end of the run", at_ns, {}}};
  return {{"link-cut", fmt::format("link cut for {} ms", length.count()), at_ns, {}},
          {"link-back", "link restored", at_ns + std::chrono::nanoseconds(length).count(), {}}};
}

Pair::Pair(const Run& run, std::int64_t number, const Machines& machines, record::Writer& writer,
           Observer& observer, Told told, const security::Authority* authority)
    : run_(run),
      number_(number),
      machines_(machines),
      writer_(writer),
      observer_(observer),
      told_(std::move(told)),
      authority_(authority) {}

// Samples and counters come from the client only.
void Pair::listen_to(Hand& client) {
  using orders::Frame;
  client.on("samples", [this](const Frame& frame) {
    const auto samples = agent::samples_of(frame.bytes);
    writer_.append(number_, samples);
    if (const auto deadline_ns = run_.task.client.deadline.count(); deadline_ns > 0)
      late_by_response_ += static_cast<std::uint64_t>(std::ranges::count_if(samples, [&](const auto& sample) {
        return sample.fate == roundtrip::Fate::on_time && sample.received_ns - sample.due_ns > deadline_ns;
      }));
    told_.samples(samples);
    sampled_ = Clock::now();
  });
  client.on("progress", [this](const Frame& frame) {
    counters_ = agent::counters_of(frame.message.at("counters"));
    told_.progress();
  });
  client.on("peer", [this](const Frame& frame) { note_peers(frame.message); });
  client.on("finished", [this](const Frame& frame) {
    finished_ = true;
    counters_ = agent::counters_of(frame.message.at("counters"));
    if (const std::uint64_t bytes = frame.message.at("waited_bytes"); bytes > 0)
      writer_.note(number_,
                   {"samples-waited",
                    fmt::format("{:.1f} kB of samples stayed at the controller until the end, because "
                                "ssh may use the link under test",
                                static_cast<double>(bytes) / 1e3),
                    {},
                    {}});
  });
}

void Pair::note_peers(const json& event) {
  const int now = event.at("writers");
  if (now == pongs_ && !event.at("as_before")) return;  // a mere listener came or went
  const auto note = note_of_peers(event, pongs_);
  pongs_ = now;
  writer_.note(number_, note);
  observer_.note(note.text);
}

void Pair::note_cut(std::int64_t at_ns) {
  for (const auto& note : notes_of_cut(run_, at_ns)) writer_.note(number_, note);
}

Pair::End Pair::open(const std::string& host, agent::Task task) {
  const bool beside = in_another_process(task.background);
  const bool asks = task.config.role == transport::Role::client;
  const auto whom = std::string(asks && is_named(run_) ? " for " + run_.component : "") +
                    (beside ? " for background topics" : "");
  End end{host, asks ? "controller" : "component", machines_.start_agent(host, whom), {}, {}, measuring_};
  if (authority_ != nullptr && run_.security != security::Level::off)  // it may be another component's
    task.config.security = authority_->identity(end.role, run_.security, task.config.domain);
  if (asks && !beside) listen_to(*end.agent);
  if (!run_.isolation.cpus.empty() &&
      !beside) {  // before the agent has threads, which it may tie to these CPUs
    machines_.keep(host, ask(end, "identify", "identified", json::object()).at("pid"));
  }
  const auto opened = ask_host(end, {{"task", agent::to_json(task)}, {"ssh", machines_.by_ssh(host)}});
  end.opened = record::read<record::Host>(opened);
  end.addresses = opened.at("addresses");
  end.mtu = opened.at("mtu");
  const auto& declared = end.opened.transport;
  if (const auto why = scenario::why_not_by(task.transport,
                                            {.below_ip = declared.below_ip.value_or(false),
                                             .past_the_kernel = declared.past_the_kernel.value_or(false)},
                                            run_, machines_.hosts().wire);
      !why.empty())
    throw Error(2, why);
  if (const auto text = note_of_ssh_link(host, end.opened.ssh_link); !beside && !text.empty())
    writer_.note(number_, {"ssh-link", text, {}, {}});
  return end;
}

// Of two hosts, the error says which one has it.
json Pair::ask_host(const End& end, json task) const try {
  return ask(end, "open", "opened", std::move(task));
} catch (const orders::Unanswered&) {
  throw;
} catch (const Error& error) {
  const std::string why = error.what();
  if (machines_.hosts().kind != Hosts::Kind::stated || why.find("the " + end.host) != why.npos) throw;
  throw Error(error.exit, fmt::format("on the {}, {}", end.host, why));
}

json Pair::ask(const End& end, const char* order, const char* answer, json body,
               std::chrono::milliseconds longest) const {
  return end.agent->ask(order, std::move(body), answer, longest, measuring_ ? 1 : 0);
}

std::vector<Pair::End*> Pair::ends() {
  std::vector<End*> there;
  for (auto& end : background_) there.push_back(&end);
  for (auto* end : {&component_, &controller_})  // the server is ready before the client
    if (*end) there.push_back(&**end);
  return there;
}

void Pair::open() {
  const auto& hosts = machines_.hosts();
  const std::uint32_t session = std::random_device{}() >> 8;
  std::optional<Host> served;
  agent::Task of_component;
  if (hosts.kind != Hosts::Kind::alone) {
    served = hosts.at(run_.component);
    of_component = server_task(run_, *served);
    of_component.background.session = session;
    component_ = open(run_.component, without_others(of_component));
  }
  auto of_controller = client_task(run_, hosts.controller, served);
  of_controller.background.session = session;
  controller_ = open("controller", without_others(of_controller));
  if (!in_another_process(run_.task.background)) return;
  background_.push_back(open(run_.component, of_their_own(of_component)));
  background_.push_back(open("controller", of_their_own(of_controller)));
}

// For people, where large messages may not get through; "" if both ends have the same.
std::string Pair::different_mtus() const {
  if (!component_ || component_->mtu == 0 || controller_->mtu == 0 || component_->mtu == controller_->mtu)
    return "";
  return fmt::format("; the MTU is {} at the controller, {} at the component. Fix: set both to the same",
                     controller_->mtu, component_->mtu);
}

std::optional<Claim> Pair::claim() const {
  if (!component_) return {};
  const auto& host = machines_.hosts().at(run_.component);
  return Claim{run_.component, host.ssh, host.address, component_->addresses};
}

void Pair::make_ready(std::chrono::nanoseconds wait) {
  wait_ = wait;
  // A message of the warm-up waits for its answer until its time-out.
  const auto& client = run_.task.client;
  const auto warm_up = std::max(client.period, client.timeout) * static_cast<std::int64_t>(client.warm_up);
  const auto longest = patience + std::chrono::ceil<std::chrono::milliseconds>(2 * wait + warm_up);
  const json body{{"wait_ns", wait_.count()}, {"served", component_.has_value()}};
  try {
    for (const auto* end : ends()) ask(*end, "start", "ready", body, longest);
  } catch (const orders::Unanswered& error) {
    throw orders::Unanswered(error.what() + different_mtus());
  }
}

void Pair::begin() {
  for (const auto* end : ends()) ask(*end, "begin", "begun", json::object());
}

void Pair::go() {
  measuring_ = true;
  if (run_.task.background.topics > 0)
    for (auto* end : ends())
      if (end != &*controller_) end->agent->order("go");
  controller_->agent->order("go");
  if (const auto& link = controller_->opened.ssh_link; link && link->shared)
    writer_.note(number_, {"samples-wait",
                           "samples arrive at the end of the run, because ssh may use the link under test",
                           {},
                           {}});
}

void Pair::stop() {
  if (over()) return;
  for (auto* end : ends())
    if (end == &*controller_ || run_.task.background.topics > 0) end->agent->order("stop");
}

bool Pair::over() const { return finished_ || !measuring_ || controller_->agent->lost(); }

bool Pair::overdue(Clock::time_point until) const {
  return !over() && Clock::now() > std::max(until, sampled_ + patience);
}

void Pair::end() {
  for (auto* end : ends()) end->ended = record::read<record::Host>(ask(*end, "end", "ended", json::object()));
  for (const auto* end : {&controller_, &component_})
    if (*end) note_downs(**end);
}

void Pair::note_downs(const End& end) {
  const bool by_the_controllers_clock =
      end.role == "controller" || machines_.hosts().kind != Hosts::Kind::stated;
  for (const auto& [from_ns, to_ns, taken] : end.ended.link.down) {
    const auto text = fmt::format(
        "{} of the {} {} {}", end.ended.link.interface, end.role, taken ? "was taken down" : "had no carrier",
        to_ns ? fmt::format("for {:.0f} ms", static_cast<double>(*to_ns - from_ns.value_or(0)) / 1e6)
              : "until the end of the run");
    writer_.note(number_, {"link-down", text, by_the_controllers_clock ? from_ns : std::nullopt, {}});
    observer_.note(text);
  }
}

record::Outcome Pair::outcome() const {
  record::Outcome outcome;
  outcome.has_counters = finished_;
  outcome.counters = counters_;
  outcome.late_by_response_only = late_by_response_;
  return outcome;
}

record::Outcome Pair::outcome(const Machines::Account& account) const {
  auto all = outcome();
  for (const auto* end : {&component_, &controller_}) {
    if (!*end) continue;
    const auto& of_machine = find(account.hosts, (*end)->host);
    auto host = (*end)->ended;
    host.ssh_link = (*end)->opened.ssh_link;
    host.started_again = (*end)->again;
    host.machine = of_machine.machine;
    host.load = of_machine.load;
    host.load_running = of_machine.load_running;
    host.kernel = of_machine.kernel;
    host.settings = of_machine.settings;
    host.isolation = of_machine.isolation;
    if (const auto links = account.links.find(run_.component);
        links != account.links.end() && !host.link.interface.empty())
      add_counts(host.link, find(links->second, (*end)->role));
    for (const auto& beside : background_)
      if (beside.role == (*end)->role) add_background(host, beside.ended);
    all.conditions[(*end)->role] = find(account.conditions, (*end)->host);
    all.hosts[(*end)->role] = std::move(host);
  }
  return all;
}

void Pair::note_now(const char* kind, const std::string& text) {
  const auto& controller = machines_.hosts().controller;
  // Our clock is the controller's where it is on this machine.
  std::optional<std::int64_t> at_ns;
  if (controller.ssh.empty() && controller.host_prefix.empty())
    at_ns = Clock::now().time_since_epoch().count();
  writer_.note(number_, {kind, text, at_ns, {}});
  observer_.note(text);
}

bool Pair::component_is_gone(const std::string& why) {
  if (!run_.component_restart || gone_ || !component_ || !component_->agent->lost() || over()) return false;
  gone_ = Clock::now();
  ++pongs_;  // DDS counts the one that died until its lease is over
  note_now("component-gone", why + "; ontime restarts it");
  return true;
}

void Pair::restart_component() {
  component_.reset();
  component_ = open(run_.component, server_task(run_, machines_.hosts().at(run_.component)));
  ask(*component_, "start", "ready", {{"wait_ns", wait_.count()}});
  ask(*component_, "begin", "begun", json::object());
  const std::chrono::duration<double> gone_s = Clock::now() - *gone_;
  gone_.reset();
  note_now("component-back",
           fmt::format("the component's server was restarted {:.3f} s after it was lost; its "
                       "thread and loss counts start here",
                       gone_s.count()));
}

void Pair::abandon() {
  if (over()) return;
  component_.reset();  // it may not be able to answer any more: what is in flight is lost
  background_.clear();
  stop();
}

}  // namespace ontime::campaign

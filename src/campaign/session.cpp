// SPDX-License-Identifier: Apache-2.0
#include "campaign/session.hpp"

#include <fmt/format.h>

#include "campaign/link.hpp"
#include "campaign/traffic.hpp"

namespace ontime::campaign {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;
using Clock = std::chrono::steady_clock;

agent::Task client_task(const Run& run, const Host& host, const std::optional<Host>& component) {
  auto task = run.task;
  task.config.role = transport::Role::client;
  task.config.max_payload_bytes = task.client.payload_bytes;
  if (!host.interface.empty()) task.config.interface = host.interface;
  if (component) task.config.peers = {component->address};
  return task;
}

// What the client saw of who answers, once that has changed.
record::Note note_of_peers(const json& event, int before) {
  const int now = event.at("writers");
  record::Note note{now < before ? "peer-left"
                    : now > 1    ? "second-pong"
                                 : "peer-came",
                    "",
                    event.at("at_ns"),
                    {}};
  if (now == 0)
    note.text = "pong left: nobody answers";
  else if (now > 1)
    note.text = fmt::format("{} pongs answer: each ping has as many answers, and the first counts", now);
  else
    note.text = now < before ? "a pong left, one answers" : "pong came back";
  return note;
}

}  // namespace

agent::Task server_task(const Run& run, const Host& host) {
  auto task = run.task;
  task.config.role = transport::Role::server;
  if (task.config.max_payload_bytes == 0) task.config.max_payload_bytes = task.client.payload_bytes;
  if (!host.interface.empty()) task.config.interface = host.interface;
  if (!run.component_transport.empty()) {
    task.transport = run.component_transport;
    task.config.options = run.component_options;
  }
  return task;
}

Session::Session(const Run& run, std::int64_t number, orders::Coordinator& coordinator, Machines& machines,
                 record::Writer& writer, Observer& observer, Interrupts& interrupts)
    : run_(run),
      number_(number),
      coordinator_(coordinator),
      machines_(machines),
      writer_(writer),
      observer_(observer),
      interrupts_(interrupts) {}

Session::~Session() {
  try {
    machines_.unload();
    machines_.restore();
  } catch (const std::exception&) {  // whoever keeps the machine gives it back when he leaves
  } catch (const orders::Interrupted&) {
  }
}

// Of the client alone: a component that would say how well it was heard is not asked.
void Session::listen_to(Hand& client) {
  using orders::Frame;
  client.on("samples", [this](const Frame& frame) {
    const auto samples = agent::samples_of(frame.bytes);
    writer_.append(number_, samples);
    if (windows_) windows_->add(samples);
    sampled_ = Clock::now();
  });
  client.on("progress", [this](const Frame& frame) {
    observer_.progress(
        agent::counters_of(frame.message.at("counters")),
        std::min<std::chrono::nanoseconds>(Clock::now() - started_, run_.task.client.duration));
  });
  client.on("peer", [this](const Frame& frame) { note_peers(frame.message); });
  client.on("finished", [this](const Frame& frame) {
    finished_ = frame.message.at("counters");
    if (const std::uint64_t bytes = frame.message.at("waited_bytes"); bytes > 0)
      writer_.note(number_, {"samples-waited",
                             fmt::format("{:.1f} kB of samples waited at the controller for the end, because "
                                         "ssh may take the link under test",
                                         static_cast<double>(bytes) / 1e3),
                             {},
                             {}});
  });
}

void Session::note_peers(const json& event) {
  const int now = event.at("writers");
  if (now == pongs_) return;  // somebody who only listens came or went
  const auto note = note_of_peers(event, pongs_);
  pongs_ = now;
  writer_.note(number_, note);
  observer_.note(note.text);
}

void Session::note_cut(std::int64_t at_ns) {
  const auto length = run_.cut->length;
  writer_.note(number_, {"link-cut", fmt::format("the link was cut, for {} ms", length.count()), at_ns, {}});
  writer_.note(number_,
               {"link-back", "the link was back", at_ns + std::chrono::nanoseconds(length).count(), {}});
}

Session::End Session::open(const std::string& host, const agent::Task& task) {
  End end{host, machines_.start_agent(host), {}, {}};
  if (task.config.role == transport::Role::client) listen_to(*end.agent);
  const bool by_ssh = machines_.by_ssh(host);
  end.agent->order("open", {{"task", task}, {"ssh", by_ssh}});
  end.opened = coordinator_.await(*end.agent, "opened", patience, measuring_ ? 1 : 0);
  if (const auto text = note_of_ssh_link(host, end.opened.at("ssh_link")); !text.empty())
    writer_.note(number_, {"ssh-link", text, {}, {}});
  return end;
}

void Session::make_ready(End& end, std::chrono::milliseconds longest) {
  end.agent->order("start", {{"wait_ns", wait_.count()}});
  coordinator_.await(*end.agent, "ready", longest, measuring_ ? 1 : 0);
}

void Session::begin(End& end) {
  end.agent->order("begin");
  coordinator_.await(*end.agent, "begun", patience, measuring_ ? 1 : 0);
}

std::vector<Session::End*> Session::ends() {
  std::vector<End*> there;
  for (auto* end : {&component_, &controller_})  // who answers is ready before who asks
    if (*end) there.push_back(&**end);
  return there;
}

json Session::measure(std::chrono::nanoseconds wait) {
  wait_ = wait;
  machines_.tune(run_);
  const auto& hosts = machines_.hosts();
  std::optional<Host> served;
  if (hosts.kind != Hosts::Kind::alone) {
    served = hosts.component;
    component_ = open("component", server_task(run_, hosts.component));
  }
  controller_ = open("controller", client_task(run_, hosts.controller, served));
  machines_.load(run_);
  if (run_.explain) {
    traced_ = machines_.trace([this](const auto& host, const auto& window) { windows_->take(host, window); });
    windows_.emplace(machines_);
  }

  const auto warm_up = run_.task.client.period * static_cast<std::int64_t>(run_.task.client.warm_up);
  const auto longest = patience + std::chrono::ceil<std::chrono::milliseconds>(2 * wait + warm_up);
  for (auto* end : ends()) make_ready(*end, longest);
  // All accounts are opened while nothing is sent: what opening them costs is nobody's round trip.
  machines_.begin();
  for (auto* end : ends()) begin(*end);
  started_ = Clock::now();
  measuring_ = true;
  controller_->agent->order("go");
  if (const auto& link = controller_->opened.at("ssh_link"); !link.is_null() && link.at("shared").get<bool>())
    writer_.note(
        number_,
        {"samples-wait", "its samples come at its end, for ssh may take the link under test", {}, {}});
  if (run_.cut) machines_.cut(*run_.cut, [this](std::int64_t at_ns) { note_cut(at_ns); });
  finish(run_.task.client.duration + run_.task.client.timeout + patience);
  return outcome();
}

void Session::finish(std::chrono::nanoseconds longest) {
  const auto until = Clock::now() + longest;
  const auto done = [&] {
    if (interrupts_ > 0 && !stopped_) {
      stopped_ = true;
      controller_->agent->order("stop");
    }
    if (windows_) windows_->order();
    if (!finished_ && Clock::now() > std::max(until, sampled_ + patience))
      throw Error(3, "the agent of the controller did not finish, long after its time was over");
    return finished_.has_value();
  };
  while (!finished_) {
    try {
      coordinator_.until(done, 1);
    } catch (const Error& error) {
      if (!may_restart_component()) throw;
      restart_component(error.what());
    }
  }
}

bool Session::may_restart_component() const {
  return run_.component_restart && component_ && component_->agent->lost() && !controller_->agent->lost() &&
         !machines_.lost() && !stopped_;
}

void Session::restart_component(const std::string& why) {
  const auto& controller = machines_.hosts().controller;
  const auto note = [&](const char* kind, const std::string& text) {
    // Our clock is the controller's where it is on this machine.
    std::optional<std::int64_t> at_ns;
    if (controller.ssh.empty() && controller.reach.empty()) at_ns = Clock::now().time_since_epoch().count();
    writer_.note(number_, {kind, text, at_ns, {}});
    observer_.note(text);
  };
  note("component-gone", why + "; it is started again");
  const auto gone = Clock::now();
  component_.reset();
  ++pongs_;  // DDS counts the one that died until its lease is over
  component_ = open("component", server_task(run_, machines_.hosts().component));
  make_ready(*component_, patience);
  begin(*component_);
  note("component-back", fmt::format("the component's end was there again after {:.3f} s; what is said of "
                                     "its threads and losses is from then on",
                                     std::chrono::duration<double>(Clock::now() - gone).count()));
}

// What the kernels still know of the last messages, and of all of them into the file.
void Session::await_windows() {
  if (!windows_) return;
  const auto until = Clock::now() + patience;
  windows_->order();
  coordinator_.until([&] { return windows_->all_came() || Clock::now() > until; }, 1);
  windows_->write(writer_, number_);
}

json Session::outcome() {
  auto outcome = *finished_;
  await_windows();
  for (auto* end : ends()) {
    end->agent->order("end");
    end->ended = coordinator_.await(*end->agent, "ended", patience, 1);
  }
  const auto account = machines_.end();
  machines_.unload();
  machines_.restore();
  auto hosts = json::object();
  for (auto* end : ends()) {
    auto host = end->ended;
    host.erase("event");
    host["machine"] = account.machine.at(end->host);
    host["transport"] = end->opened.at("transport");
    host["transport"]["facts"] = host.at("facts");
    host.erase("facts");
    host["ssh_link"] = end->opened.at("ssh_link");
    host["load_running"] = account.load_running.at(end->host);
    const auto& counted = account.links.at(end->host);
    if (!host.at("link").is_null() && !counted.is_null()) host.at("link").update(counted);
    if (const auto& kernel = account.kernel.at(end->host); !kernel.is_null()) host["kernel"] = kernel;
    hosts[end->host] = std::move(host);
  }
  outcome["interrupted"] = stopped_;  // later, it was whole
  outcome["conditions"] = account.conditions;
  if (run_.traffic.bits_per_s > 0) {
    outcome["traffic"] = achieved(run_.traffic, account.traffic);
    for (const auto& text : shortfalls(outcome.at("traffic"))) observer_.note(text);
  }
  outcome["hosts"] = std::move(hosts);
  if (windows_) outcome["trace"] = traced_;
  if (const auto why = unproved(outcome)) outcome["link_unproved"] = *why;
  if (const auto elsewhere = went_elsewhere(outcome, run_.task.client.payload_bytes))
    outcome["error"] = *elsewhere;
  return outcome;
}

json Session::salvage() noexcept {
  try {
    coordinator_.drain();
    if (!finished_ && measuring_ && controller_ && !controller_->agent->lost()) {
      component_.reset();  // there may be nobody left to answer: what is in flight is lost
      controller_->agent->order("stop");
      stopped_ = true;
      finish(run_.task.client.timeout + 5s);
    }
  } catch (const std::exception&) {       // what went wrong first is what is told
  } catch (const orders::Interrupted&) {  // in a hurry
  }
  return finished_.value_or(json::object());
}

}  // namespace ontime::campaign

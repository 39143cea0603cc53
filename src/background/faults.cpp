// SPDX-License-Identifier: Apache-2.0
// The link's faults. nftables makes loss, duplicates and cuts, on every kernel; delay, jitter and reordering
// need netem. Frames are dropped at ingress, so the interfaces at both ends have counted them. A real wire
// that loses a frame differs: the receiving interface does not count it.
#include <algorithm>
#include <cerrno>
#include <cmath>
#include <functional>
#include <future>
#include <iterator>
#include <system_error>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <net/if.h>
#include <sched.h>

#include "background/background.hpp"
#include "background/kinds.hpp"
#include "journal/journal.hpp"
#include "json.hpp"

namespace ontime::background {
namespace {

using nlohmann::json;

constexpr int parts = 1'000'000;                  // a share, as nftables has it
constexpr std::uint32_t mark = 0x6f6e74;          // of what has gone twice already
constexpr int before_all = -500;                  // of a hook's priorities
constexpr const char* longest_queue = "1000000";  // frames: what waits for a delay is not lost by it

// A rule that matches this share of the frames; empty for all, which nftables cannot state as a number.
std::string some(double share) {
  const auto part = static_cast<int>(std::lround(share * parts));
  return part < parts ? fmt::format("numgen random mod {} < {} ", parts, part) : "";
}

std::string duplicate_chain(const std::string& interface, double share) {
  return fmt::format(
      "counter duplicated {{ }}\n"
      "chain going {{ type filter hook egress device \"{0}\" priority {1};\n"
      "meta mark != {2} {3}meta mark set {2} counter name duplicated dup to \"{0}\"; }}",
      interface, before_all, mark, some(share));
}

// Rules that see frames.
std::string faults_table(const std::string& table, const std::string& interface, const Faults& faults) {
  std::string text = fmt::format(
      "table netdev {} {{\n"
      "set cut {{ type iface_index; flags timeout; }}\n"
      "counter cut_off {{ }}\ncounter lost {{ }}\n"
      "chain coming {{ type filter hook ingress device \"{}\" priority {};\n"
      "iif @cut counter name cut_off drop;\n{} }}\n",
      table, interface, before_all, faults.loss > 0 ? some(faults.loss) + "counter name lost drop;" : "");
  if (faults.duplicates > 0) text += duplicate_chain(interface, faults.duplicates) + "\n";
  return text + "}\n";
}

// Rules that see whole datagrams, not their fragments.
std::string counting_table(const std::string& table, const std::string& interface,
                           const std::vector<int>& others, const Faults& faults) {
  const auto except =
      others.empty() ? ""
                     : fmt::format("udp dport != {{ {0} }} udp sport != {{ {0} }} ", fmt::join(others, ", "));
  // Like SO_PRIORITY of a socket, but for each packet of any sender.
  std::string priorities;
  if (faults.message_priority)
    priorities += fmt::format("oifname \"{}\" meta l4proto udp {}meta priority set {};\n", interface, except,
                              *faults.message_priority);
  for (const auto* ip : {"ip", "ip6"})
    if (faults.dscp)
      priorities += fmt::format("oifname \"{}\" meta l4proto udp {}{} dscp set {};\n", interface, except, ip,
                                *faults.dscp);
  for (const auto* port : {"dport", "sport"})
    if (faults.traffic_priority && !others.empty())
      priorities += fmt::format("oifname \"{}\" udp {} {{ {} }} meta priority set {};\n", interface, port,
                                fmt::join(others, ", "), *faults.traffic_priority);
  return fmt::format(
      "table inet {0} {{\n"
      "counter sent {{ }}\ncounter received {{ }}\n"
      "chain going {{ type filter hook output priority {2};\n{4} oifname \"{1}\" {3}counter name sent; }}\n"
      "chain coming {{ type filter hook input priority {2}; iifname \"{1}\" {3}counter name received; }}\n"
      "}}\n",
      table, interface, before_all, except, priorities);
}

std::vector<std::string> netem(const std::string& command, const std::string& interface,
                               const Faults& faults) {
  const auto us = [](std::chrono::microseconds time) { return fmt::format("{}us", time.count()); };
  std::vector<std::string> words = {"qdisc",  command,          "dev",   interface, "root",
                                    "handle", our_qdisc_handle, "netem", "limit",   longest_queue,
                                    "delay",  us(faults.delay)};
  if (faults.jitter.count() > 0) words.push_back(us(faults.jitter));
  if (faults.reordered > 0)
    words.insert(words.end(), {"reorder", fmt::format("{:.4f}%", faults.reordered * 100)});
  return words;
}

bool needs_netem(const Faults& faults) { return faults.delay.count() > 0; }

// Tries on an unused interface whether the kernel accepts a fault; `keys`: the YAML keys of that fault.
void try_it(const char* keys, const char* needs, const std::function<void()>& attempt) {
  try {
    attempt();
  } catch (const Error& error) {
    throw Error(fmt::format("{}: this kernel lacks {}: {}", keys, needs, error.what()));
  }
}

// Some qdiscs need more queues than loopback has, or a card that offloads them. The kind of error tells
// whether the kernel has them.
void try_discipline(const std::vector<std::string>& words) {
  const auto& name = words.front();
  try {
    tc(make_root("lo", words));
    tc({"qdisc", "del", "dev", "lo", "root", "handle", our_qdisc_handle});
  } catch (const Error& error) {
    const std::string said = error.what();
    if (said.find("qdisc kind is unknown") != said.npos || said.find("Unknown qdisc") != said.npos)
      throw Error(fmt::format("link.qdisc: this kernel lacks qdisc {0} (module sch_{0}): {1}", name, said));
    const bool is_cards = std::ranges::count(words, "offload") > 0;
    if (name == "mqprio" || name == "taprio" || is_cards) return;
    throw Error(fmt::format("link.qdisc: tc rejects '{}': {}", fmt::join(words, " "), said));
  }
}

// Sums over all etf qdiscs of an interface, since each was created.
Link::Counts::Etf count_etf(const std::string& interface) {
  const auto answer = json_or_discarded(tc({"-statistics", "-json", "qdisc", "show", "dev", interface}));
  if (!answer.is_array()) throw Error("tc -statistics -json qdisc show: the output is not JSON");
  Link::Counts::Etf sum;
  bool found = false;
  for (const auto& qdisc : answer) {
    if (qdisc.value("kind", "") != "etf") continue;
    found = true;
    sum.launched += qdisc.value("packets", std::uint64_t{0});
    sum.dropped += qdisc.value("drops", std::uint64_t{0});
  }
  if (!found) throw Error(fmt::format("the etf qdisc of {} is gone: another process removed it", interface));
  return sum;
}

}  // namespace

void check(const Faults& faults) {
  if (!faults.any()) return;
  const auto try_all = [&] {
    if (unshare(CLONE_NEWNET) != 0) {
      if (errno == EPERM) throw NeedsRoot("link.* needs root");
      throw Error("cannot create a network namespace for the check: " +
                  std::generic_category().message(errno));
    }
    const std::string table = std::string(journal::own_prefix) + "check", interface = "lo";
    if (needs_netem(faults))
      try_it("link.delay, link.jitter, link.reorder", "qdisc netem (module sch_netem)",
             [&] { tc(netem("add", interface, faults)); });
    if (!faults.qdisc.empty())
      for (const auto& one : conditions::disciplines_of(faults.qdisc)) try_discipline(one.words);
    if (faults.loss > 0 || faults.cut)
      try_it("link.loss, link.cut", "the nftables hook ingress of family netdev (Linux 4.10 or newer)",
             [&] { nft(faults_table(table, interface, {.loss = faults.loss, .cut = faults.cut})); });
    if (faults.duplicates > 0)
      try_it("link.duplicate", "the nftables hook egress of family netdev (Linux 5.16 or newer)",
             [&] { nft(faults_table(table + "-more", interface, {.duplicates = faults.duplicates})); });
  };
  std::async(std::launch::async, try_all).get();  // the namespace goes with the thread
}

Link::Link(journal::Journal& journal, const Place& place, const Faults& faults,
           const std::vector<int>& traffic_ports)
    : journal_(journal),
      place_(place),
      has_etf_(conditions::has_etf(faults.qdisc)),
      counters_(2U + (faults.any() ? 2U : 0U) + (faults.duplicates > 0 ? 1U : 0U)) {
  if (!journal::is_interface_name(place_.interface))
    throw Error(fmt::format("link faults: '{}' is not an interface name", place_.interface));
  // From Linux 6.16 on the kernel accepts rules for an interface that does not exist yet.
  journal::within_namespace(place_.netns, [&] {
    if (if_nametoindex(place_.interface.c_str()) == 0)
      throw Error(fmt::format("link faults: interface '{}' does not exist", place_.interface));
  });
  const auto table = journal::own_prefix + place_.host;
  const auto make = [&](const char* family, const std::string& text) {
    journal_.change(kind_of_tables(place_.netns), table_what(place_.netns, family, place_.host),
                    journal::to_be_made);
    journal::within_namespace(place_.netns, [&] { nft(text); });
  };
  const auto what_of = [&](const std::string& words) {
    std::string what;
    journal::within_namespace(place_.netns,
                              [&] { what = qdisc_what(place_.netns, place_.interface, words); });
    return what;
  };
  try {
    make("inet", counting_table(table, place_.interface, traffic_ports, faults));
    if (faults.any()) make("netdev", faults_table(table, place_.interface, faults));
    if (!faults.qdisc.empty()) {
      qdisc_ = what_of(faults.qdisc);
      journal_.change(kind_of_qdiscs(place_.netns), qdisc_, our_qdisc_of(faults.qdisc));
    }
    if (!needs_netem(faults)) return;
    qdisc_ = what_of("");
    journal_.change(kind_of_qdiscs(place_.netns), qdisc_, our_qdisc_of("netem"));
    journal::within_namespace(place_.netns, [&] { tc(netem("change", place_.interface, faults)); });
  } catch (const std::exception&) {
    give_back();
    throw;
  }
}

Link::~Link() { give_back(); }

std::vector<std::string> Link::take_back() {
  std::vector<std::string> left;
  const auto undo = [&](const journal::Kind& kind, const std::string& what) {
    std::ranges::move(journal_.take_back(kind, what), std::back_inserter(left));
  };
  if (!qdisc_.empty()) undo(kind_of_qdiscs(place_.netns), qdisc_);
  for (const auto* family : {"netdev", "inet"})
    undo(kind_of_tables(place_.netns), table_what(place_.netns, family, place_.host));
  return left;
}

void Link::give_back() noexcept {
  try {
    take_back();
  } catch (const std::exception&) {  // it is in the journal, whose end gives it back or says why it cannot
    return;
  }
}

void Link::cut(std::chrono::milliseconds time) const {
  journal::within_namespace(place_.netns, [&] {
    nft(fmt::format("add element netdev {}{} cut {{ \"{}\" timeout {}ms }}", journal::own_prefix, place_.host,
                    place_.interface, time.count()));
  });
}

Link::Counts Link::counts() const {
  Counts counts;
  std::size_t found = 0;
  journal::within_namespace(place_.netns, [&] {
    for (const auto& counter : nft_list("counter")) {
      if (counter.value("table", "") != journal::own_prefix + place_.host) continue;
      ++found;
      const auto name = counter.value("name", "");
      const auto frames = counter.value("packets", std::uint64_t{0}),
                 bytes = counter.value("bytes", std::uint64_t{0});
      if (name == "lost") counts.lost = frames;
      if (name == "cut_off") counts.cut_off = frames;
      if (name == "duplicated") counts.duplicated = frames;
      if (name == "sent") counts.sent_bytes = bytes;
      if (name == "received") counts.received_bytes = bytes;
    }
    if (has_etf_) counts.etf = count_etf(place_.interface);
  });
  if (found < counters_)
    throw Error(fmt::format("{} of {} counters on {} are gone: another process removed nftables rules",
                            counters_ - found, counters_, place_.interface));
  return counts;
}

}  // namespace ontime::background

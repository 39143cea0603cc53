// SPDX-License-Identifier: Apache-2.0
// What can be said of what else goes over the link, and of its faults.
#include <string_view>

#include "campaign/keys.hpp"

namespace ontime::campaign {
namespace {

using Text = const std::string&;

using namespace std::chrono_literals;

constexpr std::uint64_t least_datagram_bytes = 16, most_datagram_bytes = 65'507;  // iperf3's, and UDP's

std::uint64_t datagram_of(Text text) {
  const auto bytes = bytes_of(text);
  if (bytes < least_datagram_bytes || bytes > most_datagram_bytes)
    throw std::invalid_argument(fmt::format(
        "'{}' is no size of a datagram: {} B to {} B are (from 1473 B on, of an Ethernet as usual, "
        "it goes in several frames)",
        text, least_datagram_bytes, most_datagram_bytes));
  return bytes;
}

// Of netem, which takes whole microseconds.
std::chrono::microseconds delay_of(Text text) {
  const auto delay = positive_duration(text, 1h);
  const auto whole = std::chrono::duration_cast<std::chrono::microseconds>(delay);
  if (whole != delay)
    throw std::invalid_argument(fmt::format("'{}' is not a whole number of microseconds", text));
  return whole;
}

// "10 s for 500 ms"
Cut cut_of(Text text) {
  constexpr std::string_view between = " for ";
  const auto found = text.find(between);
  if (found == text.npos)
    throw std::invalid_argument(
        fmt::format("'{}' does not say when and for how long; write it as '10 s for 500 ms'", text));
  const auto at = duration_of(text.substr(0, found));
  const auto length = positive_duration(text.substr(found + between.size()), 1h);
  const auto whole = std::chrono::duration_cast<std::chrono::milliseconds>(length);
  if (at.count() < 0) throw std::invalid_argument(fmt::format("'{}' is before the begin", text));
  if (whole != length)
    throw std::invalid_argument(fmt::format("'{}' is not for a whole number of milliseconds", text));
  return {at, whole};
}

void add_link_keys(std::vector<Key>& keys) {
  const auto client = Key::For::client;
  keys.insert(
      keys.end(),
      {{"link.loss", "", "PERCENT", "share of the frames that come to either end and are lost: none", client,
        [](Run& run, Text text) { run.faults.loss = share_of(text); }},
       {"link.duplicate", "", "PERCENT", "share of the frames that either end sends twice: none", client,
        [](Run& run, Text text) { run.faults.duplicates = share_of(text); }},
       {"link.delay", "", "TIME", "of all that either end sends, on its way: none", client,
        [](Run& run, Text text) { run.faults.delay = delay_of(text); }},
       {"link.jitter", "", "TIME", "by how much that delay varies, either way: not at all", client,
        [](Run& run, Text text) { run.faults.jitter = delay_of(text); }},
       {"link.reorder", "", "PERCENT", "share of the frames that go without that delay, before others: none",
        client, [](Run& run, Text text) { run.faults.reordered = share_of(text); }},
       {"link.qdisc", "", "TEXT",
        "what waits to go waits in, in tc's words, such as 'prio bands 3': the kernel's choice", client,
        [](Run& run, Text text) {
          try {
            background::check_qdisc(text);
          } catch (const background::Error& error) {
            throw std::invalid_argument(error.what());
          }
          run.faults.qdisc = text;
        }},
       {"link.message-priority", "", "0-15", "of the messages' packets, as SO_PRIORITY has it: as they are",
        client,
        [](Run& run, Text text) { run.faults.message_priority = static_cast<int>(number_of(text, 0, 15)); }},
       {"link.traffic-priority", "", "0-15", "of the concurrent traffic's packets, likewise", client,
        [](Run& run, Text text) { run.faults.traffic_priority = static_cast<int>(number_of(text, 0, 15)); }},
       {"launch-time", "", "TIME",
        "how long after it was due a message leaves, by the etf of link.qdisc: as it is sent", client,
        [](Run& run, Text text) { run.task.config.launch_ns = positive_duration(text, 1h).count(); }},
       {"link.cut", "", "TIME for TIME", "when nothing comes any more, and for how long: '10 s for 500 ms'",
        client, [](Run& run, Text text) {
          run.cut = cut_of(text);
          run.faults.cut = true;
        }}});
}

// As tc takes it, which is content with its beginning.
bool has_deadline_mode(const std::string& qdisc) {
  std::istringstream words(qdisc);
  for (std::string word; words >> word;)
    if (word.size() >= 2 && std::string_view("deadline_mode").starts_with(word)) return true;
  return false;
}

// Without an etf a launch time is a word that nobody heeds; without a launch time, an etf drops all.
void complete_launch(const Run& run) {
  const auto& qdisc = run.faults.qdisc;
  const bool asked = run.task.config.launch_ns > 0;
  if (asked != background::has_etf(qdisc))
    throw std::invalid_argument(
        asked
            ? "launch-time needs an etf that keeps the messages until then: link.qdisc: prio bands 2 priomap "
              "1 1 1 1 1 1 0 1 1 1 1 1 1 1 1 1 below 1 etf clockid CLOCK_TAI delta 300000, with "
              "link.message-priority: 6"
            : "the etf of link.qdisc drops what does not say when it is to leave: add a launch-time");
  if (!asked) return;
  if (qdisc.starts_with("etf") && !is_below_ip(run.task.transport))
    throw std::invalid_argument(
        "etf by itself drops ARP as well, without which there is no IP: link.qdisc: prio bands 2 priomap "
        "1 1 1 1 1 1 0 1 1 1 1 1 1 1 1 1 below 1 etf …, with link.message-priority: 6");
  if (has_deadline_mode(qdisc))
    throw std::invalid_argument(
        "with deadline_mode an etf lets a message go before its launch-time: leave out one");
  if (run.task.client.schedule == roundtrip::Schedule::back_to_back)
    throw std::invalid_argument(
        "launch-time counts from when a message is due, and back-to-back knows no such moment: take another "
        "schedule");
  if (2 * run.task.config.launch_ns >= run.task.client.timeout.count())
    throw std::invalid_argument(
        "a message and its answer wait for a launch-time each, and that is no less than timeout: each would "
        "count as lost");
  if (run.faults.duplicates > 0)
    throw std::invalid_argument(
        "of a frame that link.duplicate sends again an etf knows no launch-time, and drops it: leave out "
        "one");
  const bool is_beside =
      run.faults.traffic_priority && run.faults.traffic_priority != run.faults.message_priority;
  if (run.traffic.bits_per_s > 0 && (qdisc.starts_with("etf") || !is_beside))
    throw std::invalid_argument(
        "an etf drops what has no launch-time: traffic needs a class of its own beside it, by "
        "link.traffic-priority");
  if (run.explain)
    throw std::invalid_argument(
        "explain would take the wait for a launch for a wait behind others: leave out explain, or "
        "launch-time");
}

void complete_link(const Run& run) {
  const auto& faults = run.faults;
  if (faults.delay.count() == 0 && (faults.jitter.count() > 0 || faults.reordered > 0))
    throw std::invalid_argument("link.jitter and link.reorder need a link.delay, which they are about");
  if (!faults.qdisc.empty() && faults.delay.count() > 0)
    throw std::invalid_argument(
        "link.qdisc and link.delay both are the queueing discipline of the interface: leave out one");
  if (faults.traffic_priority && run.traffic.bits_per_s == 0)
    throw std::invalid_argument("link.traffic-priority needs a traffic.rate, of whose packets it is");
  if (faults.jitter > faults.delay)
    throw std::invalid_argument("link.jitter is more than link.delay: nothing comes before it was sent");
  complete_launch(run);
  if (run.cut && run.cut->at >= run.task.client.duration)
    throw std::invalid_argument("link.cut begins when the run's duration is over");
}

void add_traffic_keys(std::vector<Key>& keys) {
  const auto client = Key::For::client;
  keys.insert(
      keys.end(),
      {{"traffic.rate", "", "RATE", "of concurrent UDP traffic, by iperf3, each way: none", client,
        [](Run& run, Text text) { run.traffic.bits_per_s = bit_rate_of(text); }},
       {"traffic.direction", "", "both|to-component|to-controller", "of concurrent traffic: both", client,
        [](Run& run, Text text) {
          run.traffic.direction = one_of(direction_of(text), text, "both, to-component, to-controller");
        }},
       {"traffic.datagram", "", "SIZE", "payload of each datagram of concurrent traffic: 1470 B", client,
        [](Run& run, Text text) { run.traffic.datagram_bytes = datagram_of(text); }},
       {"traffic.priority", "", "1-99", "SCHED_FIFO priority of iperf3: none", client,
        [](Run& run, Text text) { run.traffic.priority = static_cast<int>(number_of(text, 1, 99)); }}});
}

}  // namespace

std::optional<Traffic::Direction> direction_of(Text text) {
  using Direction = Traffic::Direction;
  for (const auto direction : {Direction::both, Direction::to_component, Direction::to_controller})
    if (text == word_of(direction)) return direction;
  return {};
}

std::vector<Key> network_keys() {
  std::vector<Key> keys;
  add_traffic_keys(keys);
  add_link_keys(keys);
  return keys;
}

void complete_network(Run& run) {
  if (run.traffic.bits_per_s == 0 && run.traffic != Traffic{})
    throw std::invalid_argument("traffic is described, but there is none: traffic.rate says how much");
  if (run.faults.any() && any_past_the_kernel(run))
    throw std::invalid_argument(
        "the link's faults are made by the kernel's packet filter and queueing disciplines, which xdp passes "
        "by: leave "
        "out link, or take ethernet");
  complete_link(run);
  if (is_below_ip(run.task.transport)) run.task.config.priority = run.faults.message_priority;
}

}  // namespace ontime::campaign

// SPDX-License-Identifier: Apache-2.0
#include "transport/dds.hpp"

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <system_error>

#include <sys/auxv.h>

#include "message/message.hpp"
#include "number.hpp"
#include "transport/clock.hpp"
#include "transport/shipped.hpp"
#include "transport/sockets.hpp"

namespace ontime::transport::dds {
namespace {

// Why ROS 2 refuses the topic name; nullptr: it accepts it. A peer with rclcpp can have no other names.
const char* wrong_in_topic(const std::string& name) {
  constexpr std::size_t longest = 247;  // so that it fits, with its prefix, into DDS's 255
  if (!name.starts_with('/')) return "it does not start with a slash";
  if (name.size() > longest) return "it is longer than 247 characters";
  for (std::size_t at = 0; at < name.size(); ++at) {
    const char letter = name[at];
    const bool begins = at > 0 && name[at - 1] == '/';
    const bool digit = letter >= '0' && letter <= '9';
    if (letter == '/' && (begins || at + 1 == name.size())) return "a part of it is empty";
    if (begins && digit) return "a part of it starts with a digit";
    const bool word =
        digit || letter == '_' || (letter >= 'a' && letter <= 'z') || (letter >= 'A' && letter <= 'Z');
    if (letter != '/' && !word) return "it has characters other than letters, digits and _";
  }
  return nullptr;
}

void check_topics(const Config& config, const std::string& transport) {
  for (const std::string& name : {config.ping_topic, config.pong_topic})
    if (const char* const wrong = wrong_in_topic(name)) {
      std::string text = transport;
      text.append(": \"").append(name).append("\" is not a topic: ").append(wrong);
      throw WrongInput(text + ". Fix: write it as in ROS 2, such as /robot/ping");
    }
  if (config.ping_topic == config.pong_topic)
    throw WrongInput(transport + ": ping and pong have the same topic, " + config.ping_topic +
                     ". Fix: set two different topics");
}

bool has_two_values(Policy policy) { return policy == Policy::reliability || policy == Policy::durability; }

const char* policy_value(const Qos& qos, Policy policy) {
  if (policy == Policy::reliability)
    return qos.reliability == Reliability::reliable ? "reliable" : "best-effort";
  return qos.durability == Durability::transient_local ? "transient-local" : "volatile";
}

}  // namespace

bool is_loopback(const std::string& address) { return address.starts_with("127."); }

// NOLINTBEGIN(concurrency-mt-unsafe): see the header
Override::Override(const char* name, const std::optional<std::string>& value) : name_(name) {
  if (const char* const before = std::getenv(name)) before_ = before;
  set(value);
}

void Override::set(const std::optional<std::string>& value) const {
  value ? setenv(name_, value->c_str(), 1) : unsetenv(name_);
}
// NOLINTEND(concurrency-mt-unsafe)

bool follows_environment() { return getauxval(AT_SECURE) == 0; }

Variable users_variable(const char* name) {
  // Nothing else of this process changes its environment.
  const char* const value = std::getenv(name);  // NOLINT(concurrency-mt-unsafe)
  if (value == nullptr) return {};
  if (follows_environment()) return {value};
  return {"", std::string(name) + " ignored (this program has file capabilities)"};
}

std::string topic_written(const Config& config) {
  return "rt" + (config.role == Role::client ? config.ping_topic : config.pong_topic);
}
std::string topic_read(const Config& config) {
  return "rt" + (config.role == Role::client ? config.pong_topic : config.ping_topic);
}

std::string name_of(pid_t tid) {
  std::string name;
  std::getline(std::ifstream("/proc/self/task/" + std::to_string(tid) + "/comm"), name);
  return name;
}

std::vector<Task> tasks() {
  std::vector<Task> found;
  std::error_code ended;  // while we looked
  for (const auto& task : std::filesystem::directory_iterator("/proc/self/task", ended)) {
    const pid_t tid = std::stoi(task.path().filename());
    found.push_back({tid, name_of(tid)});
  }
  return found;
}

std::vector<Task> started_since(const std::vector<Task>& before) {
  std::vector<Task> started = tasks();
  std::erase_if(started,
                [&](const Task& task) { return std::ranges::count(before, task.tid, &Task::tid) > 0; });
  return started;
}

void Matches::set(std::atomic<int>& of, int count) noexcept {
  if (of.exchange(count) != count) changed_ns_ = now_ns();
}

void Gaps::note(const Writer& writer, std::int64_t number) noexcept {
  auto at = std::find_if(lasts_.begin(), lasts_.end(),
                         [&](const Last& last) { return last.number == 0 || last.writer == writer; });
  if (at == lasts_.end()) {
    --at;
    *at = {};
  }
  const std::int64_t last = at->number;
  if (last != 0 && number > last + 1)
    missing_.store(missing() + static_cast<std::uint64_t>(number - last - 1), std::memory_order_relaxed);
  *at = {writer, std::max(last, number)};
  if (at != lasts_.begin()) std::rotate(lasts_.begin(), at, at + 1);
}

void check(const Config& config, const std::string& transport) {
  check_topics(config, transport);
  if (config.domain < 0 || config.domain > max_domain)
    throw WrongInput(transport + ": domain " + std::to_string(config.domain) +
                     " does not exist; DDS has 0 to " + std::to_string(max_domain));
  if (config.max_payload_bytes > max_dds_payload_bytes)
    throw WrongInput(transport + ": a payload of " + std::to_string(config.max_payload_bytes) +
                     " bytes is too large; the maximum is " + std::to_string(max_dds_payload_bytes));
  if (config.qos.history == History::keep_last && config.qos.depth < 1)
    throw WrongInput(transport + ": a history depth of " + std::to_string(config.qos.depth) +
                     " keeps no message; the minimum is 1");
  if (!config.interface.empty()) check_link(config, transport);
}

std::map<std::string, std::string> facts(const Config& config, const std::string& middleware,
                                         const std::string& carrier, const std::string& source) {
  std::map<std::string, std::string> facts{{"middleware", middleware},
                                           {"domain", std::to_string(config.domain)},
                                           {"carrier", carrier},
                                           {"configuration", source}};
  if (config.security) facts["security"] = config.security->level;
  if (!config.interface.empty()) facts.insert({{"interface", config.interface}, {"address", config.address}});
  return facts;
}

Peer resolve(const std::string& peer, const std::string& transport) {
  const std::size_t colon = peer.find(':');
  Peer result{peer.substr(0, colon)};
  if (colon != std::string::npos) {
    result.port = number_in<std::uint16_t>(std::string_view(peer).substr(colon + 1)).value_or(0);
    if (result.port == 0)
      throw WrongInput(transport + ": the peer " + peer + " has no valid port. Fix: write HOST or HOST:PORT");
  }
  in_addr found{};
  if (const int error = look_up(result.address, found); error != 0)
    throw Error(transport + ": cannot find the peer " + peer + ": " + gai_strerror(error));
  result.address = text_of(found);
  return result;
}

std::string refused_writer(const Config& config, Policy policy) {
  const std::string who = "a writer of " + topic_read(config);
  if (!has_two_values(policy)) return who + " offers an incompatible QoS";
  return who + " offers " + policy_value(Qos{}, policy) + ", ontime requests " +
         policy_value(config.qos, policy);
}

std::string refused_reader(const Config& config, Policy policy) {
  const std::string who = "a reader of " + topic_written(config);
  if (!has_two_values(policy)) return who + " requests a QoS that ontime does not offer";
  const Qos most{.reliability = Reliability::reliable, .durability = Durability::transient_local};
  return who + " requests " + policy_value(most, policy) + ", ontime offers " +
         policy_value(config.qos, policy);
}

std::string other_type(const std::string& topic, const std::string& type) {
  return "another program has " + topic + " with type " + type + ", ontime has " + message::type_name;
}

std::string others_without_our_topics(const Config& config, std::size_t participants, Matched matched) {
  if (matched.both()) return {};
  const char* const let_in =
      "DDS Security admits only participants with a certificate of the same certificate authority";
  if (participants == 0) {
    std::string text = others_elsewhere(config);
    if (text.empty()) {
      text = "no other DDS participant found: check the link, and firewalls that drop UDP";
      if (config.peers.empty()) text += ", and whether the network has multicast (--peer ADDRESS needs none)";
    }
    // A middleware reports rejected participants no differently from absent ones.
    if (config.security) text.append("; or: ").append(let_in);
    return text;
  }
  std::string text = std::to_string(participants) + " other DDS participant" +
                     (participants == 1 ? "" : "s") + " in domain " + std::to_string(config.domain);
  if (matched.readers == 0) text += ", no reader of " + topic_written(config);
  if (matched.writers == 0) text += ", no writer of " + topic_read(config);
  if (config.security) text.append("; ").append(let_in);
  return text;
}

}  // namespace ontime::transport::dds

// SPDX-License-Identifier: Apache-2.0
// The list of all fields of a run, and its JSON form. The fields of load, link and kernel are in network.cpp.
#include "conditions/fields.hpp"

#include <algorithm>
#include <iterator>
#include <sstream>
#include <string_view>

#include <boost/algorithm/string/case_conv.hpp>

#include "transport/dds.hpp"

namespace ontime::conditions {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;
using roundtrip::ClientOptions;
using std::chrono::nanoseconds;
using transport::Config;

constexpr std::uint64_t max_payload_bytes = std::uint64_t{1} << 30U;

nanoseconds period_of(Text text) {
  const auto period = positive_duration(text, 1h);
  if (period < 10us)
    throw std::invalid_argument(fmt::format(
        "'{}' is too short: at least 10 us. To send as fast as possible, use schedule back-to-back", text));
  return period;
}

// As rmw validates a topic's whole name, and a namespace: parts between slashes, each like a variable's name.
bool is_ros_name(std::string_view name) {
  const auto is_letter = [](char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_'; };
  const auto is_digit = [](char c) { return c >= '0' && c <= '9'; };
  if (name.starts_with('/')) name.remove_prefix(1);
  char before = '/';
  for (const char c : name) {
    const bool begins_part = before == '/';
    if (!is_letter(c) && (begins_part || !(is_digit(c) || c == '/'))) return false;
    before = c;
  }
  return before != '/';
}

Codec<std::string> ros_name() {
  auto codec = text();
  codec.values = "NAME";
  codec.of_text = [](Text text) {
    if (!is_ros_name(text))
      throw std::invalid_argument(
          fmt::format("'{}' is not a ROS 2 name, such as robot/ping: parts of letters, digits and _, not "
                      "starting with a digit",
                      text));
    return text;
  };
  return codec;
}

// A list of values means a run for each: so these are one text.
Codec<std::vector<std::string>> robot_topics() {
  auto codec = or_null(plain<std::vector<std::string>>());
  codec.values = "NAME,…";
  codec.of_text = [](Text text) {
    std::vector<std::string> names;
    for (std::size_t begin = 0; begin <= text.size();) {
      const auto end = std::min(text.find(',', begin), text.size());
      const auto first = std::min(text.find_first_not_of(' ', begin), end);
      const auto name = text.substr(first, end - first);
      if (!name.starts_with('/') || !is_ros_name(name))
        throw std::invalid_argument(
            fmt::format("'{}' is not an absolute topic name. Example: /scan,/robot/cmd_vel", name));
      names.push_back(name);
      begin = end + 1;
    }
    return names;
  };
  return codec;
}

auto in_client(auto member) { return within(&Run::task, &Task::client, member); }
auto in_config(auto member) { return within(&Run::task, &Task::config, member); }

// A field that the record writes in its own way.
Field written(Field field, std::function<json(const Run&)> to_json) {
  field.to_json = std::move(to_json);
  return field;
}

Fields fields_of_record() {
  using Options = std::map<std::string, std::string>;
  return {
      recorded("id", text(), &Run::id),
      recorded("variant", text(), &Run::variant),
      recorded("varied", or_null(plain<std::vector<std::pair<std::string, std::string>>>()), &Run::varied),
      recorded("beside", or_null(text()), &Run::beside),
      recorded("repetition", number<int>(1, 0), &Run::repetition),
      recorded("require", or_null(plain<std::vector<std::string>>()), &Run::require),
      written(recorded("component", text(), &Run::component),
              [](const Run& run) { return is_named(run) ? json(run.component) : json(); }),
      recorded("search.value", text(), within(&Run::step, &Run::Step::value)),
      recorded("search.step", number<int>(0, 0), within(&Run::step, &Run::Step::number)),
      recorded("search.steps", number<int>(0, 0), within(&Run::step, &Run::Step::of)),
      recorded("search.among", text(), within(&Run::step, &Run::Step::among)),
      recorded("interface", or_null(text()), in_config(&Config::interface)),
      recorded("options", plain<Options>(), in_config(&Config::options)),
      written(recorded("component_options", plain<Options>(), &Run::component_options), [](const Run& run) {
        return run.component_transport.empty() ? run.task.config.options : run.component_options;
      })};
}

// Identity, baseline, search and transport of a run.
Fields fields_of_run() {
  return {
      field({"title", "", "TEXT", "title of the run, for people"}, "title", text(), &Run::title),
      field({"baseline", "", "ID", "id of the baseline, for `ontime report --layers`"}, "adds_to", text(),
            &Run::adds_to),
      field({"search", "", "KEY",
             "key with a list of values, lightest to heaviest; ontime finds the first with late or lost "
             "messages"},
            "search.key", text(), within(&Run::step, &Run::Step::key)),
      field({"transport", "--transport", "NAME",
             "transport of the messages (ethernet, xdp, udp, cyclonedds, fastdds, or another installed one); "
             "required",
             both},
            "transport", text(), within(&Run::task, &Task::transport)),
      written(field({"component.transport", "", "NAME", "transport of the server, if different", client, "",
                     "as transport"},
                    "component_transport", text(), &Run::component_transport),
              [](const Run& run) {
                return run.component_transport.empty() ? run.task.transport : run.component_transport;
              }),
      field({"component.restart", "", "", "restart the server if it dies during the run"},
            "component_restart", or_null(on_or_off()), &Run::component_restart),
      field({"count-instructions", "", "", "count instructions of each thread, if the CPU has a counter",
             client, "count-instructions {}"},
            "count_instructions", or_null(on_or_off()), within(&Run::task, &Task::count_instructions)),
      field({"explain", "--explain", "",
             "record what the kernel does around late and lost messages, for `ontime explain`; needs root",
             both, "explain {}"},
            "explain", or_null(on_or_off()), &Run::explain)};
}

// Payload, schedule and time limits.
Fields fields_of_sending() {
  using roundtrip::Schedule;
  return {
      said(field({"payload", "--payload", "", "payload, without the 8-byte sequence number", both, "{}"},
                 "payload_bytes", size(), in_client(&ClientOptions::payload_bytes)),
           [](Run& run, Text text) {
             run.task.client.payload_bytes = run.task.config.max_payload_bytes = payload_of(text);
           }),
      field({"schedule", "--schedule", "",
             "when to send the next message; fixed is open-loop, next-free closed-loop", client, "{}"},
            "schedule",
            words({Schedule::next_free, Schedule::fixed, Schedule::back_to_back}, roundtrip::word_of),
            in_client(&ClientOptions::schedule)),
      field({"period", "--period", "", "time from one cycle to the next", client, "every {}"}, "period_us",
            time(us, period_of), in_client(&ClientOptions::period)),
      field({"deadline", "--deadline", "", "a message that takes longer is late", client, "deadline {}"},
            "deadline_us", time(us, up_to_an_hour), in_client(&ClientOptions::deadline)),
      field({"timeout", "--timeout", "", "a message without an answer within this time is lost", client,
             "timeout {}"},
            "timeout_us", time(us, up_to_an_hour), in_client(&ClientOptions::timeout)),
      field({"duration", "--duration", "", "how long to measure, without the warm-up", client, "{}"},
            "duration_s", time(s, [](Text text) { return positive_duration(text); }),
            in_client(&ClientOptions::duration)),
      field({"warm-up", "--warm-up", "N", "answers to wait for before the first counted message", client,
             "warm-up {}"},
            "warm_up", number<std::uint64_t>(1, 1'000'000), in_client(&ClientOptions::warm_up)),
      field({"receive", "--receive", "",
             "receive in the middleware's thread (listener) or in a thread that waits (waitset)", both, "{}"},
            "receive",
            words<transport::Receive>({transport::Receive::listener, transport::Receive::waitset}, word_of),
            in_config(&Config::receive))};
}

// The record has the name that scenario::complete() makes absolute.
Field topic(const std::string& name, const std::string& help, std::string Run::*stated,
            std::string Config::*absolute) {
  return recorded(
      name + "_topic", text(), in_config(absolute),
      said_at({"topics." + name, fmt::format("--{}-topic", name), "", help, both}, ros_name(), stated));
}

// Topics and their QoS.
Fields fields_of_topics() {
  using transport::Durability, transport::History, transport::Qos;
  auto absolute = ros_name();
  absolute.of_text = [of_name = absolute.of_text](Text text) { return text == "/" ? text : of_name(text); };
  auto name_space = said_at({"namespace", "--namespace", "", "namespace of the topics, such as /robot", both},
                            absolute, &Run::ros_namespace);
  name_space.parts = {"ping_topic", "pong_topic"};
  const auto domain = number<int>(0, transport::dds::max_domain);
  const auto in_qos = [](auto member) { return within(&Run::task, &Task::config, &Config::qos, member); };
  return {
      recorded("domain", domain, in_config(&Config::domain),
               said_at({"domain", "--domain", "", "DDS domain; udp uses port 7900 + domain", both,
                        "domain {}", "$ROS_DOMAIN_ID, or 0"},
                       optional(domain), &Run::domain)),
      name_space,
      topic("ping", "topic that the client writes", &Run::ping_topic, &Config::ping_topic),
      topic("pong", "topic that the server answers on", &Run::pong_topic, &Config::pong_topic),
      field({"qos.reliability", "--reliability", "", "reliability of both topics", both}, "qos.reliability",
            reliability(), in_qos(&Qos::reliability)),
      field({"qos.history", "--history", "", "history of both topics", both}, "qos.history",
            words<History>({History::keep_last, History::keep_all}, word_of), in_qos(&Qos::history)),
      field({"qos.depth", "--depth", "N", "messages that keep-last keeps", both}, "qos.depth",
            number<int>(1, 1'000'000), in_qos(&Qos::depth)),
      field({"qos.durability", "--durability", "", "durability of both topics", both}, "qos.durability",
            words<Durability>({Durability::volatile_, Durability::transient_local}, word_of),
            in_qos(&Qos::durability)),
      field({"security", "", "", "DDS Security: authenticate both ends; also sign or encrypt each payload",
             client, "security {}"},
            "security",
            or_null(words<Security>(
                {Security::off, Security::authenticate, Security::sign, Security::encrypt}, word_of)),
            &Run::security)};
}

Fields listening_fields() {
  const auto limit = optional(time(us, up_to_an_hour));
  return {
      field({"listen.topics", "", "",
             "topics of the robot to listen to during the run, such as /scan,/cmd_vel"},
            "listen.topics", robot_topics(), within(&Run::listening, &Listening::topics)),
      field({"listen.deadline", "", "", "a message is late if it comes later than this after the one before"},
            "listen.deadline_us", limit, within(&Run::listening, &Listening::deadline)),
      field({"listen.period", "", "", "expected period of these topics; a message is late after 1.5 periods"},
            "listen.period_us", limit, within(&Run::listening, &Listening::period)),
      field({"listen.age", "", "", "a message is late if it is older than this when taken"}, "listen.age_us",
            limit, within(&Run::listening, &Listening::age))};
}

// Groups that are null in JSON as long as they are not requested.
constexpr std::pair<const char*, bool (*)(const Run&)> groups[] = {
    {"search", [](const Run& run) { return run.step.of > 0; }},
    {"traffic", [](const Run& run) { return run.traffic.any(); }},
    {"neighbours", [](const Run& run) { return run.task.background.topics > 0; }},
    {"link", [](const Run& run) { return run.faults.any(); }},
    {"isolation", [](const Run& run) { return run.isolation.any(); }},
    {"listen", [](const Run& run) { return run.listening.any(); }}};

json::json_pointer pointer(const std::string& path) {
  json::json_pointer to;
  std::stringstream parts(path);
  for (std::string part; std::getline(parts, part, '.');) to /= part;
  return to;
}

Run run_from(const json& from, bool may_be_foreign) {
  Run run;
  for (const auto& field : fields()) {
    if (!field.from_json) continue;
    const auto& value = member_of(from, field.json);
    if (!value.is_null()) try {
        field.from_json(run, value);
      } catch (const std::exception&) {
        if (!may_be_foreign) throw;
      }
  }
  run.step.key = current_key(run.step.key);
  for (auto& [key, value] : run.varied) key = current_key(key);
  return run;
}

}  // namespace

std::uint64_t payload_of(Text text) {
  const auto bytes = bytes_of(text);
  if (bytes > max_payload_bytes)
    throw std::invalid_argument(fmt::format("'{}' is too large: at most 1 GiB", text));
  return bytes;
}

Codec<transport::Reliability> reliability() {
  using transport::Reliability;
  return words<Reliability>({Reliability::best_effort, Reliability::reliable}, word_of);
}

bool yes_or_no(Text text) {
  const auto word = boost::algorithm::to_lower_copy(text);  // YAML has On and ON, too
  if (word == "true" || word == "on" || word == "yes") return true;
  if (word == "false" || word == "off" || word == "no") return false;
  throw std::invalid_argument(fmt::format("'{}' is neither on nor off", text));
}

double finite(Json from) {
  const auto value = from.get<double>();
  if (!from.is_number() || !std::isfinite(value))
    throw std::invalid_argument(from.dump() + " is not a number");
  return value;
}

void add(Fields& all, Fields more) {
  all.insert(all.end(), std::move_iterator(more.begin()), std::move_iterator(more.end()));
}

const Fields& fields() {
  static const auto list = [] {
    Fields all;
    for (const auto part :
         {fields_of_run, fields_of_sending, fields_of_topics, realtime_fields, network_fields,
          background_fields, isolation_fields, kernel_fields, listening_fields, fields_of_record})
      add(all, part());
    return all;
  }();
  return list;
}

const std::vector<Key>& keys() {
  static const auto list = [] {
    auto all = fields();
    std::erase_if(all, [](const Field& field) { return field.path.empty(); });
    return all;
  }();
  return list;
}

std::string current_key(const std::string& key) {
  constexpr std::pair<std::string_view, const char*> renamed[] = {{"neighbours", "background"},
                                                                  {"adds-to", "baseline"}};
  for (const auto& [old, current] : renamed)
    if (key == old || (key.starts_with(old) && key[old.size()] == '.'))
      return current + key.substr(old.size());
  return key;
}

const json& member_of(const json& record, const std::string& path) {
  static const json none;
  const auto* here = &record;
  for (std::size_t begin = 0; begin <= path.size();) {
    const auto end = std::min(path.find('.', begin), path.size());
    const auto found = here->is_object() ? here->find(path.substr(begin, end - begin)) : here->end();
    if (!here->is_object() || found == here->end()) return none;
    here = &*found;
    begin = end + 1;
  }
  return *here;
}

const Key* key_named(std::string_view path) {
  const auto& all = keys();
  const auto found = std::ranges::find(all, path, &Key::path);
  return found == all.end() ? nullptr : &*found;
}

std::vector<json::json_pointer> places_of(const std::string& key) {
  // A transport's own: what follows is one name, whatever it has in it.
  for (const auto& [path, member] : {std::pair<std::string, const char*>{"options.", "options"},
                                     {"component.options.", "component_options"}})
    if (key.starts_with(path)) return {pointer(member) / key.substr(path.size())};
  const auto* const known = key_named(key);
  if (known == nullptr) return {pointer(key == "background" ? "neighbours" : key)};  // the record's word
  if (!known->json.empty()) return {pointer(known->json)};
  std::vector<json::json_pointer> places;
  for (const auto& part : known->parts) places.push_back(pointer(part));
  return places;
}

json to_json(const Run& run) {
  auto all = json::object();
  for (const auto& field : fields())
    if (field.to_json) all[pointer(field.json)] = field.to_json(run);
  for (const auto& [name, is_asked] : groups)
    if (!is_asked(run)) all[name] = nullptr;
  return all;
}

Run run_of(const json& from) { return run_from(from, false); }
Run run_of_record(const json& from) { return run_from(from, true); }

const char* word_of(transport::Reliability reliability) {
  return reliability == transport::Reliability::reliable ? "reliable" : "best-effort";
}
const char* word_of(transport::History history) {
  return history == transport::History::keep_all ? "keep-all" : "keep-last";
}
const char* word_of(transport::Durability durability) {
  return durability == transport::Durability::transient_local ? "transient-local" : "volatile";
}

const char* word_of(transport::Receive receive) {
  return receive == transport::Receive::waitset ? "waitset" : "listener";
}

const char* word_of(Security level) {
  static constexpr const char* words[] = {"off", "authenticate", "sign", "encrypt"};
  return words[static_cast<std::size_t>(level)];
}

std::string flaw_of_id(const std::string& id) {
  if (id.find(',') != id.npos) return "an id cannot contain a comma, which separates ids in --only";
  if (id.find_first_of("\n\r") != id.npos) return "an id cannot contain a line break";
  if (id.starts_with('-')) return "an id cannot start with '-', as flags do";
  if (!id.empty() && id.find_first_not_of("0123456789") == id.npos)
    return fmt::format(
        "a whole number means the run of that number in --only. Fix: begin it with a letter, such as run-{}",
        id);
  return "";
}

}  // namespace ontime::conditions

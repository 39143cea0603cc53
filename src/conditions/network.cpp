// SPDX-License-Identifier: Apache-2.0
// Fields of the conditions around the messages: load, traffic, link faults, background topics, reserved CPUs,
// kernel settings.
#include <string_view>

#include "conditions/fields.hpp"
#include "number.hpp"

namespace ontime::conditions {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;
using std::chrono::microseconds;
using std::chrono::nanoseconds;

// For a stress-ng worker 0 would mean stress-ng's default.
std::uint64_t size_of(Text text) {
  const auto bytes = bytes_of(text);
  if (bytes == 0) throw std::invalid_argument(fmt::format("'{}' must be positive", text));
  return bytes;
}

Fields load_fields(const std::string& host, Workers Run::*load) {
  const auto number_of_workers = [=](const std::string& kind, const std::string& help,
                                     int Workers::*workers) {
    return field({fmt::format("load.{}.{}", host, kind), "", "N", help},
                 fmt::format("load.{}.{}", host, kind), number<int>(0, 1024), within(load, workers));
  };
  // Their defaults are those of background::fit().
  const auto bytes = [=](const std::string& kind, const std::string& help, const char* by_default,
                         std::uint64_t Workers::*each) {
    return field({fmt::format("load.{}.{}-bytes", host, kind), "", "", help, client, "", by_default},
                 fmt::format("load.{}.{}_bytes", host, kind), size(size_of), within(load, each));
  };
  return {number_of_workers("cpu", "stress-ng workers that compute", &Workers::cpu),
          number_of_workers("vm", "stress-ng workers that write to memory", &Workers::vm),
          number_of_workers("io", "stress-ng workers that call sync(2)", &Workers::io),
          number_of_workers("hdd", "stress-ng workers that write files", &Workers::hdd),
          bytes("vm", "memory of each vm worker", "256 MiB", &Workers::vm_bytes),
          bytes("hdd", "file size of each hdd worker", "1 GiB", &Workers::hdd_bytes)};
}

std::uint64_t datagram_of(Text text) {
  constexpr std::uint64_t least = 16, most = 65'507;  // iperf3's, and UDP's
  const auto bytes = bytes_of(text);
  if (bytes < least || bytes > most)
    throw std::invalid_argument(fmt::format(
        "'{}' is not a datagram size from {} B to {} B. Above 1472 B, standard Ethernet needs several frames",
        text, least, most));
  return bytes;
}

using Direction = Traffic::Direction;
Codec<Direction> direction() {
  return words<Direction>({Direction::both, Direction::to_component, Direction::to_controller}, word_of);
}

Codec<std::uint64_t> bit_rate() {
  auto codec = number<std::uint64_t>(bit_rate_of);
  codec.unit = Field::Unit::bit_s;
  return codec;
}

Fields traffic_fields() {
  return {field({"traffic.rate", "", "RATE", "rate of concurrent UDP traffic by iperf3, each way"},
                "traffic.bit_s", bit_rate(), within(&Run::traffic, &Traffic::bits_per_s)),
          field({"traffic.direction", "", "", "direction of the traffic"}, "traffic.direction", direction(),
                within(&Run::traffic, &Traffic::direction)),
          field({"traffic.datagram", "", "", "payload of each datagram of the traffic"},
                "traffic.datagram_bytes", size(datagram_of), within(&Run::traffic, &Traffic::datagram_bytes)),
          field({"traffic.priority", "", "", "SCHED_FIFO priority of iperf3"}, "traffic.priority",
                number<int>(1, 99), within(&Run::traffic, &Traffic::priority))};
}

// netem takes whole microseconds.
Codec<microseconds> delay() {
  const auto of_text = [](Text text) {
    const auto delay = positive_duration(text, 1h);
    const auto whole = std::chrono::duration_cast<microseconds>(delay);
    if (whole != delay)
      throw std::invalid_argument(fmt::format("'{}' is not a whole number of microseconds", text));
    return whole;
  };
  return {of_text,
          text_of,
          [](microseconds value) { return json(value.count()); },
          [](Json from) { return microseconds(whole<std::int64_t>(from)); },
          "TIME",
          Field::Unit::us};
}

Codec<std::string> qdisc() {
  auto codec = text();
  codec.of_text = [](Text text) {
    if (!is_qdisc(text))
      throw std::invalid_argument(
          fmt::format("'{}' is not a queueing discipline in tc's syntax: one of {}, with its options and no "
                      "path. For one below class 1, append 'below 1 etf clockid CLOCK_TAI delta 300000'. See "
                      "tc-prio(8), tc-taprio(8)",
                      text, fmt::join(known_disciplines(), ", ")));
    return text;
  };
  return codec;
}

// "10 s for 500 ms"
Cut cut_of(Text text) {
  constexpr std::string_view between = " for ";
  const auto found = text.find(between);
  if (found == text.npos)
    throw std::invalid_argument(
        fmt::format("'{}' is not a start and a duration, such as '10 s for 500 ms'", text));
  const auto at = duration_of(text.substr(0, found));
  const auto length = positive_duration(text.substr(found + between.size()), 1h);
  const auto whole = std::chrono::duration_cast<std::chrono::milliseconds>(length);
  if (at.count() < 0) throw std::invalid_argument(fmt::format("'{}' starts before the run", text));
  if (whole != length)
    throw std::invalid_argument(fmt::format("'{}' does not last a whole number of milliseconds", text));
  return {at, whole};
}

json json_of(const Cut& cut) { return {{"at_s", in_us(cut.at) / 1e6}, {"for_ms", cut.length.count()}}; }

// In an order, a bare `true` requests a link that can be cut.
Field cut() {
  return {.path = "link.cut",
          .flag = "",
          .values = "TIME for TIME",
          .help = "when the link is cut, and for how long, such as '10 s for 500 ms'",
          .by_default = "none",
          .set =
              [](Run& run, Text text) {
                run.cut = cut_of(text);
                run.faults.cut = true;
              },
          .stated = [](Text text) { return json_of(cut_of(text)); },
          .json = "link.cut",
          .to_json =
              [](const Run& run) {
                if (run.cut) return json_of(*run.cut);
                return run.faults.cut ? json(true) : json();
              },
          .from_json =
              [](Run& run, Json from) {
                if (from.is_object())
                  run.cut = Cut{time_from(from.at("at_s"), s),
                                std::chrono::milliseconds(whole<std::int64_t>(from.at("for_ms")))};
                run.faults.cut = from.is_object() || from.get<bool>();
              }};
}

Fields link_fields() {
  // The launch time after the due time; in ns, as the transport takes it.
  const auto launch = time(us, up_to_an_hour);
  const Codec<std::int64_t> launch_ns{
      [=](Text text) { return launch.of_text(text).count(); },
      [](std::int64_t ns) { return text_of(nanoseconds(ns)); },
      [=](std::int64_t ns) { return ns > 0 ? launch.to_json(nanoseconds(ns)) : json(); },
      [=](Json from) { return launch.of_json(from).count(); },
      "TIME",
      Field::Unit::us};
  return {
      field({"link.loss", "", "", "share of arriving frames that each end drops, such as '1 %'", client,
             "drops {}"},
            "link.loss", share(), within(&Run::faults, &Faults::loss)),
      field({"link.duplicate", "", "", "share of frames that each end sends twice", client, "duplicates {}"},
            "link.duplicates", share(), within(&Run::faults, &Faults::duplicates)),
      field({"link.delay", "", "", "delay of all frames that each end sends", client, "delays {}"},
            "link.delay_us", delay(), within(&Run::faults, &Faults::delay)),
      field({"link.jitter", "", "", "variation of link.delay, up or down", client, "varies the delay by {}"},
            "link.jitter_us", delay(), within(&Run::faults, &Faults::jitter)),
      field({"link.reorder", "", "", "share of frames that skip link.delay and overtake others", client,
             "reorders {}"},
            "link.reordered", share(), within(&Run::faults, &Faults::reordered)),
      field({"link.qdisc", "", "TEXT",
             "queueing discipline of both ends, in tc's syntax, such as 'prio bands 3'", client, "qdisc {}",
             "kernel default"},
            "link.qdisc", qdisc(), within(&Run::faults, &Faults::qdisc)),
      field({"link.message-priority", "", "", "priority of the messages' packets (SO_PRIORITY)", client,
             "sends messages with priority {}", "unchanged"},
            "link.message_priority", optional(number<int>(0, 15)),
            within(&Run::faults, &Faults::message_priority)),
      field({"link.traffic-priority", "", "", "priority of the traffic's packets (SO_PRIORITY)", client,
             "sends traffic with priority {}", "unchanged"},
            "link.traffic_priority", optional(number<int>(0, 15)),
            within(&Run::faults, &Faults::traffic_priority)),
      field({"link.dscp", "", "", "DSCP of the messages' IP packets, such as 46 (EF)", client,
             "marks messages with DSCP {}", "unchanged"},
            "link.dscp", optional(number<int>(0, 63)), within(&Run::faults, &Faults::dscp)),
      field({"launch-time", "", "",
             "launch time of each message, after its due time; needs an etf in link.qdisc", client,
             "launched {} after it was due"},
            "launch_us", launch_ns, within(&Run::task, &Task::config, &transport::Config::launch_ns)),
      cut()};
}

// The record stores a rate in Hz instead of a period.
Codec<nanoseconds> rate() {
  const auto hz = [](nanoseconds period) { return 1e9 / static_cast<double>(period.count()); };
  return {period_of_rate,
          [=](nanoseconds period) { return fmt::format("{:g} Hz", hz(period)); },
          [=](nanoseconds period) { return json(hz(period)); },
          [](Json from) {
            const auto ns = 1e9 / finite(from);
            if (!(ns >= 1) || ns > 9e18) throw std::invalid_argument(from.dump() + " is not a rate");
            return nanoseconds(std::llround(ns));
          },
          "RATE",
          Field::Unit::hz};
}

template <typename Value>
Field of_background(Field how, const std::string& name, Codec<Value> codec,
                    Value roundtrip::BackgroundOptions::*what) {
  how.path = "background." + how.path;
  auto made = field(std::move(how), "neighbours." + name, codec, within(&Run::task, &Task::background, what));
  return name == "topics" ? made : said(made, [set = made.set](Run& run, Text text) {
    run.describes_background = true;
    set(run, text);
  });
}

std::string cpus_of(Text text) {
  if (text == "none") return "";
  const auto cpus = realtime::cpus_of(text);
  if (!cpus || cpus->empty())
    throw std::invalid_argument(fmt::format("'{}' is not none or a CPU list, such as 1 or 0-1,3", text));
  return realtime::list_of(*cpus);
}

// As systemd's CPUQuota: 100 % is one CPU, so several CPUs permit more.
double quota_of(Text text) {
  constexpr std::int64_t most = 102'400;  // of 1024 CPUs
  if (text == "none") return 0;
  constexpr std::string_view unit = " %";
  if (!text.ends_with(unit))
    throw std::invalid_argument(fmt::format("'{}' is not a share of a CPU's time, such as '50 %'", text));
  const auto percent = number_in<std::int64_t>(text.substr(0, text.size() - unit.size()));
  if (!percent || *percent < 1 || *percent > most)
    throw std::invalid_argument(fmt::format("'{}' is not a whole number from 1 % to {} %", text, most));
  return static_cast<double>(*percent) / 100;
}

void set_preset(Run& run, Text text) {
  if (text != "paper" && text != "none")
    throw std::invalid_argument(fmt::format("'{}' is not one of paper, none", text));
  run.kernel = text == "paper" ? settings::paper() : settings::Wishes{};
}

constexpr const char* unchanged = "as-is";

// Of "50" and of "50 us" "50".
std::string microseconds_of(Text text) {
  if (number_in<std::int64_t>(text)) return text;
  const auto time = duration_of(text);
  const auto whole = std::chrono::duration_cast<std::chrono::microseconds>(time);
  if (whole != time)
    throw std::invalid_argument(fmt::format("'{}' is not a whole number of microseconds", text));
  return std::to_string(whole.count());
}

// A size is a number of bytes to the kernel, a time of µs.
std::string wish_of(const settings::Setting& setting, Text text) {
  if (text == unchanged) return text;
  const std::string_view values = setting.values;
  return setting.stated(values == "SIZE"                   ? std::to_string(bytes_of(text))
                        : values == settings::microseconds ? microseconds_of(text)
                                                           : text);
}

void set_wish(Run& run, const settings::Setting& setting, Text text) {
  run.kernel.erase(setting.name);
  if (auto wish = wish_of(setting, text); wish != unchanged) run.kernel[setting.name] = std::move(wish);
}

}  // namespace

const char* word_of(Traffic::Direction direction) {
  static constexpr const char* words[] = {"both", "to-component", "to-controller"};
  return words[static_cast<std::size_t>(direction)];
}

Fields network_fields() {
  auto all = load_fields("controller", &Run::controller_load);
  add(all, load_fields("component", &Run::component_load));
  add(all, traffic_fields());
  add(all, link_fields());
  return all;
}

Fields background_fields() {
  using Options = roundtrip::BackgroundOptions;
  using roundtrip::Where, transport::Reliability;
  return {
      of_background({"topics", "", "", "number of background topics beside the critical one"}, "topics",
                    number<int>(1, 100), &Options::topics),
      of_background(
          {"where", "", "",
           "what background topics share with the critical one, the last four with ros2 only"},
          "where",
          words({Where::same_participant, Where::same_process, Where::other_process,
                 Where::same_callback_group, Where::same_node, Where::same_executor, Where::own_executor},
                static_cast<const char* (*)(Where)>(roundtrip::word_of)),
          &Options::where),
      of_background({"rate", "", "", "message rate of each background topic and direction"}, "rate_hz",
                    rate(), &Options::period),
      of_background({"payload", "", "", "payload of each background message"}, "payload_bytes",
                    size(payload_of), &Options::payload_bytes),
      of_background({"reliability", "", "", "reliability of background topics, which keep the last 10"},
                    "reliability", reliability(), &Options::reliability),
      {.path = "background.direction",
       .flag = "",
       .values = direction().values,
       .help = "direction of background messages",
       .by_default = "both",
       .set =
           [](Run& run, Text text) {
             run.describes_background = true;
             run.task.background.there = direction().of_text(text) != Direction::to_controller;
             run.task.background.back = direction().of_text(text) != Direction::to_component;
           },
       .parts = {"neighbours.there", "neighbours.back"}},
      recorded("neighbours.there", on_or_off(), within(&Run::task, &Task::background, &Options::there)),
      recorded("neighbours.back", on_or_off(), within(&Run::task, &Task::background, &Options::back)),
      of_background({"priority", "", "", "SCHED_FIFO priority of threads that only background topics use"},
                    "priority", number<int>(1, 99), &Options::priority),
      of_background({"callback", "", "", "CPU time that the callback of each background message takes"},
                    "callback_us", time(us, up_to_an_hour), &Options::callback)};
}

Fields isolation_fields() {
  auto cpus = text();
  cpus.of_text = cpus_of;
  return {
      field({"isolation.cpus", "", "LIST|none", "CPUs reserved for the two ends", client, "CPUs {} reserved"},
            "isolation.cpus", cpus, within(&Run::isolation, &Isolation::cpus)),
      field({"isolation.interrupts", "", "",
             "move the interface's interrupts and the kernel's unbound work to other CPUs", client,
             "interrupts on other CPUs"},
            "isolation.interrupts", on_or_off(), within(&Run::isolation, &Isolation::interrupts)),
      field({"isolation.load-quota", "", "PERCENT|none",
             "CPU time for load and traffic together; 100 % is one CPU", client,
             "load and traffic with {} of a CPU", "no limit"},
            "isolation.load_quota", share(quota_of), within(&Run::isolation, &Isolation::load_quota)),
      field({"isolation.load-weight", "", "1-10000|none",
             "weight of load and traffic together; other processes have 100", client,
             "load and traffic of weight {}"},
            "isolation.load_weight", number<int>([](Text text) {
              return text == "none" ? 0 : static_cast<int>(number_of(text, 1, 10'000));
            }),
            within(&Run::isolation, &Isolation::load_weight))};
}

Fields kernel_fields() {
  Fields all{{.path = "kernel.preset",
              .flag = "",
              .values = "paper|none",
              .help = "paper: irq-threads 90 and ksoftirqd 60, as in the paper",
              .by_default = "none",
              .set = set_preset}};
  for (const auto& [name, value] : settings::paper()) all.front().parts.push_back("kernel." + name);
  for (const auto& setting : settings::table())
    all.push_back({.path = fmt::format("kernel.{}", setting.name),
                   .flag = "",
                   .values = fmt::format("{}|{}", setting.values, unchanged),
                   .help = setting.help,
                   .by_default = unchanged,
                   .set = [&setting](Run& run, Text text) { set_wish(run, setting, text); },
                   .stated = [&setting](Text text) { return json(wish_of(setting, text)); },
                   .parts = {fmt::format("kernel.{}", setting.name)}});
  all.push_back(recorded("kernel", or_null(plain<settings::Wishes>()), &Run::kernel));
  return all;
}

}  // namespace ontime::conditions

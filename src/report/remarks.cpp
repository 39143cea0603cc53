// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <sstream>

#include <fmt/format.h>

#include "report/report.hpp"
#include "report/runs.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

using nlohmann::json;

// How a run ended, if not as asked.
std::string ending(const json& outcome) {
  if (outcome.is_null()) return "not ended (cut off, or still running): shown is what is recorded";
  if (const auto& error = at(outcome, "error"); !error.is_null()) return "failed: " + word(error);
  return is_true(at(outcome, "interrupted")) ? "interrupted before its end" : "";
}

// Whoever finds the table must not take it for a robot's.
std::string simulated(const json& outcome) {
  for (const auto& [host, facts] : at(outcome, "hosts").items())
    if (const auto& by = at(at(facts, "machine"), "simulated"); by.is_string())
      return fmt::format("SIMULATED by {}: it compares settings, and predicts no real machine's times",
                         word(by));
  return "";
}

// "12 at the component, 3 at the controller": of what each end's own reader says of its losses.
std::string losses(const json& outcome, const char* key, const char* where) {
  std::vector<std::string> parts;
  for (const auto* host : {"controller", "component"})
    if (const auto number = count(at(at(at(at(outcome, "hosts"), host), "losses"), key)); number > 0)
      parts.push_back(fmt::format("{} {} the {}", number, where, host));
  return join(parts, ", ");
}

// What was achieved of the concurrent traffic, loudly where it is not what was asked.
std::string traffic(const json& outcome) {
  std::vector<std::string> ways;
  bool is_short = false;
  for (const auto* way : {"to_component", "to_controller"}) {
    const auto& rates = at(at(outcome, "traffic"), way);
    if (!rates.is_object()) continue;
    is_short = is_short || is_true(at(rates, "short"));
    ways.push_back(fmt::format(
        "{} Mbit/s of {} arrived at the {}{}", megabits(at(rates, "received_bit_s")),
        megabits(at(rates, "asked_bit_s")), std::string_view(way).substr(sizeof("to_") - 1),
        is_true(at(rates, "short")) ? fmt::format(" ({} sent)", megabits(at(rates, "sent_bit_s"))) : ""));
  }
  if (ways.empty()) return "";
  return (is_short ? "NOT THE TRAFFIC THAT WAS ASKED FOR: " : "traffic: ") + join(ways, ", ");
}

// What became of the neighbours' messages, loudly where they were not those that were asked for.
std::string neighbours(const json& outcome) {
  std::vector<std::string> ways;
  bool is_short = false;
  for (const auto* way : {"to_component", "to_controller"}) {
    const auto& counted = at(at(outcome, "neighbours"), way);
    if (!counted.is_object()) continue;
    is_short = is_short || is_true(at(counted, "short"));
    auto text =
        fmt::format("{} of {} arrived at the {}", grouped(count(at(counted, "received"))),
                    grouped(count(at(counted, "sent"))), std::string_view(way).substr(sizeof("to_") - 1));
    const struct {
      const char *key, *what;
    } others[] = {{"lost", "{} lost"},
                  {"skipped_cycles", "{} not sent, for their sender overran its period"},
                  {"refused", "{} refused by the transport"},
                  {"overruns", "{} with a callback that took longer than its turn"},
                  {"strays", "and {} of somebody else's"}};
    std::vector<std::string> details;
    for (const auto& [key, what] : others)
      if (const auto number = count(at(counted, key)); number > 0)
        details.push_back(fmt::format(fmt::runtime(what), grouped(number)));
    ways.push_back(details.empty() ? text : text + " (" + join(details, ", ") + ")");
  }
  if (ways.empty()) return "";
  return (is_short ? "NOT THE NEIGHBOURS THAT WERE ASKED FOR: " : "neighbours: ") + join(ways, ", ");
}

// Where the kernel dropped something: loss has a place.
std::string drops(const json& outcome) {
  std::vector<std::string> parts;
  const struct {
    const char *key, *what;
  } places[] = {{"own_sockets", "{} for want of room in the sockets of the {}'s middleware"},
                {"udp_receive", "{} for want of room in UDP sockets of the {}, of anybody"},
                {"udp_send", "{} that the {}'s sockets could not send"},
                {"fragments", "{} on the {} of which not all fragments came"},
                {"interface_received", "{} that came to the {}'s interface"},
                {"interface_sent", "{} that were to leave by the {}'s interface"},
                {"backlog", "{} in the queues of the {}'s CPUs, on the whole machine"}};
  for (const auto* host : {"controller", "component"}) {
    const auto& dropped = at(at(at(outcome, "hosts"), host), "drops");
    for (const auto& [key, what] : places) {
      const auto number = count(at(dropped, key));
      if (number == 0) continue;
      if (std::string_view(key) == "udp_receive" && number == count(at(dropped, "own_sockets"))) continue;
      parts.push_back(fmt::format(fmt::runtime(what), number, host));
    }
  }
  return parts.empty() ? "" : "dropped by the kernel: " + join(parts, ", ");
}

// What of the loss was ours: "lost by link.loss 51 frames that came to the component".
std::string faults(const json& outcome) {
  std::vector<std::string> parts;
  const struct {
    const char *key, *what;
  } kinds[] = {{"lost_frames", "lost by link.loss {} that came to the {}"},
               {"cut_off_frames", "cut off by link.cut {} that came to the {}"},
               {"duplicated_frames", "sent twice by link.duplicate {} of the {}"}};
  for (const auto& [key, what] : kinds)
    for (const auto* host : {"controller", "component"})
      if (const auto frames = count(at(at(at(at(at(outcome, "hosts"), host), "link"), "faults"), key));
          frames > 0)
        parts.push_back(fmt::format(fmt::runtime(what), many(frames, "frame", "frames"), host));
  return join(parts, ", ");
}

// "dropped by etf 3 frames of the controller, whose launch time had passed or that had none".
std::string launches_missed(const json& outcome) {
  std::vector<std::string> parts;
  for (const auto* host : {"controller", "component"})
    if (const auto frames =
            count(at(at(at(at(at(outcome, "hosts"), host), "link"), "etf"), "dropped_frames"));
        frames > 0)
      parts.push_back(fmt::format("{} of the {}", many(frames, "frame", "frames"), host));
  return parts.empty() ? ""
                       : fmt::format("dropped by etf {}, whose launch time had passed or that had none",
                                     join(parts, ", "));
}

// The interface's own counters, where they do not fit what was measured. (Too little makes a run fail.)
constexpr std::uint64_t headers_bytes = 120;  // of a message, at most: Ethernet, IP, UDP, RTPS
constexpr std::uint64_t much = 10;            // times what the messages take
constexpr std::uint64_t little_bytes = 1 << 20;
// Of the traffic that was asked for, at least what it is of payload.
std::uint64_t traffic_bytes(const statistics::Summary& summary) {
  double bits = 0;
  for (const auto& [way, rates] : at(summary.run.outcome, "traffic").items())
    if (const auto& sent = at(rates, "sent_bit_s"); sent.is_number())
      bits += std::max(0.0, sent.get<double>());
  const auto& seconds = at(summary.run.asked, "duration_s");
  return static_cast<std::uint64_t>(
      std::clamp(seconds.is_number() ? bits / 8 * seconds.get<double>() : 0, 0.0, 1e15));
}
std::uint64_t neighbours_bytes(const statistics::Summary& summary) {
  std::uint64_t bytes = 0;
  for (const auto& [host, facts] : at(summary.run.outcome, "hosts").items()) {
    const auto& neighbours = at(facts, "neighbours");
    const auto payload = std::min<std::uint64_t>(count(at(neighbours, "payload_bytes")), 1 << 30);
    bytes += std::min<std::uint64_t>(count(at(neighbours, "sent")), 1 << 30) * (payload + headers_bytes);
  }
  return bytes;
}
std::vector<std::string> other_traffic(const statistics::Summary& summary) {
  const auto& hosts = at(summary.run.outcome, "hosts");
  const auto payload = std::min<std::uint64_t>(count(at(summary.run.asked, "payload_bytes")), 1 << 30);
  const auto expected =
      2 * summary.sent * (payload + headers_bytes) + traffic_bytes(summary) + neighbours_bytes(summary);
  std::vector<std::string> parts;
  json seen;  // both ends of loopback are one interface
  for (const auto* host : {"controller", "component"}) {
    const auto& link = at(at(hosts, host), "link");
    const auto bytes = count(at(link, "sent_bytes")) + count(at(link, "received_bytes"));
    const json which = {at(link, "interface"), at(at(at(hosts, host), "machine"), "boot_id")};
    if (bytes / much <= expected || bytes < little_bytes || which == seen) continue;
    seen = which;
    parts.push_back(fmt::format(
        "other traffic on {} of the {}: {:.0f} MB in all, where what was asked for takes {:.1f} MB",
        word(at(link, "interface")), host, static_cast<double>(bytes) / 1e6,
        static_cast<double>(expected) / 1e6));
  }
  return parts;
}

// What neither the network nor the other end is to blame for: the CPU given to others, our own thread asleep.
constexpr double much_stolen = 0.001;
std::vector<std::string> taken_away(const statistics::Summary& summary) {
  std::vector<std::string> parts;
  const auto& outcome = summary.run.outcome;
  const bool one_machine = record::on_one_machine(outcome);
  for (const auto* host : {"controller", "component"}) {
    const auto& stolen = at(at(at(outcome, "conditions"), host), "cpu_stolen");
    if (!stolen.is_number() || stolen.get<double>() < much_stolen) continue;
    parts.push_back(fmt::format("the hypervisor took {:.1f} % of the time of the {}'s CPUs",
                                stolen.get<double>() * 100, one_machine ? "machine" : host));
    if (one_machine) break;
  }
  if (!summary.shape.worst.empty()) {
    const auto& [took_ns, before, message, after] = summary.shape.worst.front();
    const auto woke_late = static_cast<double>(roundtrip::wake_up_latency_ns(message));
    if (summary.wake_up.count > 0 && woke_late * 2 >= static_cast<double>(took_ns))
      parts.push_back(fmt::format("of the longest answered wait, {} µs, the sender's wake-up took {}",
                                  microseconds(static_cast<double>(took_ns)), microseconds(woke_late)));
  }
  return parts;
}

// None of these is in any number above.
constexpr double long_s = 0.1;         // more than two clocks are read apart on a busy machine
constexpr double much_slew_ppm = 500;  // beyond any crystal and the usual correction of a time service
std::vector<std::string> clocks(const nlohmann::json& outcome) {
  std::vector<std::string> parts;
  const bool one_machine = record::on_one_machine(outcome);
  for (const auto* host : {"controller", "component"}) {
    if (one_machine && host != std::string_view("controller")) continue;
    const std::string machine = one_machine ? "the machine" : fmt::format("the {}'s machine", host);
    const auto& conditions = at(at(outcome, "conditions"), host);
    const auto &slept = at(conditions, "suspended_s"), &moved = at(conditions, "clock_moved_s");
    if (slept.is_number() && slept.get<double>() >= long_s)
      parts.push_back(fmt::format("{} was suspended for {:.1f} s, which no time counts that was measured",
                                  machine, slept.get<double>()));
    if (moved.is_number() && std::abs(moved.get<double>()) >= long_s)
      parts.push_back(
          fmt::format("the system clock of {} was moved by {:+.1f} s, by which nothing is measured", machine,
                      moved.get<double>()));
    const auto& slewed = at(conditions, "clock_slew_ppm");
    if (slewed.is_number() && std::abs(slewed.get<double>()) >= much_slew_ppm)
      parts.push_back(fmt::format(
          "the clock of {} was slewed by {:+.0f} ppm, and so is every time that it measured. Fix: "
          "measure once its time service has settled",
          machine, slewed.get<double>()));
  }
  return parts;
}

// A throttled CPU leaves its real-time threads waiting for the rest of the period; newer kernels' fair server
// does, for as long.
void add_throttling(std::vector<std::string>& parts, const statistics::Summary& summary) {
  if (!is_true(at(summary.run.asked, "realtime"))) return;
  const auto suspect = [&](const char* host, const char* what, std::int64_t ns) {
    const auto& machine = at(at(at(summary.run.outcome, "hosts"), host), "machine");
    const auto &runtime = at(machine, "rt_runtime_us"), &period = at(machine, "rt_period_us");
    if (!runtime.is_number() || !period.is_number() || runtime < 0) return;
    const double rest_us = period.get<double>() - runtime.get<double>();
    if (rest_us <= 0 || static_cast<double>(ns) < rest_us * 1e3) return;
    parts.push_back(fmt::format(
        "{} up to {} µs late, as RT throttling of the {} would make it (its "
        "kernel.sched_rt_runtime_us is {}; `dmesg` has its first time since boot), or, from Linux "
        "6.12 on, the fair server",
        what, microseconds(static_cast<double>(ns)), host, word(runtime)));
  };
  suspect("controller", "woke", summary.wake_up.max);
  suspect("component", "answered", summary.server.max);
  // A faulty or a full link delays as long by itself, and so does what is sent again.
  const auto& asked = summary.run.asked;
  const bool by_the_link = !at(asked, "link").is_null() || !at(asked, "traffic").is_null() ||
                           !losses(summary.run.outcome, "on_the_way", "to").empty();
  if (summary.parts && !by_the_link)
    suspect("component", "received", summary.parts->there.max - summary.parts->there.p50);
}

// "at 3.2 s: the pong left".
constexpr std::size_t most_notes = 5;
std::string text_of(const record::Note& note, const statistics::Summary& summary) {
  std::string text = printable(note.text.empty() ? note.kind : note.text);
  if (note.message) text += fmt::format(" (message {})", *note.message);
  if (!note.at_ns || summary.start_ns == 0) return text;
  if (*note.at_ns < summary.start_ns) return "before the first message: " + text;
  return fmt::format("at {:.1f} s: {}",
                     (static_cast<double>(*note.at_ns) - static_cast<double>(summary.start_ns)) / 1e9, text);
}

void add_notes(std::vector<std::string>& parts, const statistics::Summary& summary) {
  for (std::size_t i = 0; i < std::min(most_notes, summary.notes.size()); ++i)
    parts.push_back(text_of(summary.notes[i], summary));
  if (summary.notes.size() > most_notes)
    parts.push_back(many(summary.notes.size() - most_notes, "further note", "further notes"));
}

// A pong that died, a cable that was pulled: not every transport notices.
constexpr std::uint64_t surely_gone = 10;  // messages
void add_silence(std::vector<std::string>& parts, const statistics::Summary& summary) {
  if (summary.unanswered_at_end < surely_gone || summary.unanswered_at_end == summary.sent) return;
  const auto from_ns =
      static_cast<double>(summary.unanswered_from_ns) - static_cast<double>(summary.start_ns);
  parts.push_back(fmt::format("nothing was answered any more from {:.1f} s on: the last {} messages",
                              from_ns / 1e9, grouped(summary.unanswered_at_end)));
}

// Of the machines' settings, those that somebody changed while it was measured.
std::vector<std::string> changed_settings(const json& outcome) {
  std::vector<std::string> parts;
  for (const auto& [host, facts] : at(outcome, "hosts").items())
    for (const auto* group : {"kernel", "isolation"})
      for (const auto& [index, one] : at(facts, group).items())
        if (at(one, "now") != at(one, "after"))
          parts.push_back(fmt::format("{}.{} was no longer so at the end: {} of the {} was {}, not {}", group,
                                      word(at(one, "setting")), word(at(one, "thing")), word(host),
                                      at(one, "now").is_null() ? "gone" : word(at(one, "now")),
                                      word(at(one, "after"))));
  return parts;
}

struct Refused {
  std::string found, remedy;
  std::vector<std::string> asked;
};

// As word(), but lines stay lines, for they are to be copied.
std::string lines(const nlohmann::json& value) {
  if (!value.is_string()) return word(value);
  std::istringstream text(value.get<std::string>());
  std::vector<std::string> result;
  for (std::string line; std::getline(text, line);) result.push_back(word(line));
  return join(result, "\n");
}

void add_refusals(std::vector<Refused>& all, const nlohmann::json& end) {
  for (const auto& [index, refusal] : at(end, "refusals").items()) {
    const auto asked = word(at(refusal, "asked")), found = word(at(refusal, "found")),
               remedy = lines(at(refusal, "remedy"));
    auto same = std::find_if(all.begin(), all.end(), [&](const auto& other) {
      return other.found == found && other.remedy == remedy;
    });
    if (same == all.end()) same = all.insert(all.end(), {found, remedy, {}});
    if (std::find(same->asked.begin(), same->asked.end(), asked) == same->asked.end())
      same->asked.push_back(asked);
  }
}

std::vector<std::string> notes_of(const std::vector<Refused>& all) {
  std::vector<std::string> notes;
  notes.reserve(all.size());
  for (const auto& refused : all)
    notes.push_back(fmt::format("Asked but not given: {};\nfound: {};\nto permit it: {}",
                                join(refused.asked, ", "), refused.found, refused.remedy));
  return notes;
}

// Until ontime noted what each worker was given, stress-ng divided the stated sizes among the workers.
std::vector<std::string> divided_load(const json& asked, const json& outcome) {
  std::vector<std::string> texts;
  for (const auto& [host, load] : at(asked, "load").items()) {
    const auto& facts = at(at(outcome, "hosts"), host);
    if (!at(facts, "load_running").is_boolean() || !at(facts, "load").is_null()) continue;
    for (const auto* kind : {"vm", "hdd"}) {
      const auto bytes = count(at(load, fmt::format("{}_bytes", kind))), workers = count(at(load, kind));
      if (bytes > 0 && workers > 1)
        texts.push_back(fmt::format(
            "the load on the {} was smaller than stated: an older ontime divided {} among {} {} workers",
            word(host), size(bytes), workers, kind));
    }
  }
  return texts;
}

}  // namespace

std::string remarks(const statistics::Summary& summary) {
  const auto& outcome = summary.run.outcome;
  std::vector<std::string> parts;
  if (const auto text = ending(outcome); !text.empty()) parts.push_back(text);
  if (const auto text = simulated(outcome); !text.empty()) parts.push_back(text);
  for (const auto& [host, facts] : at(outcome, "hosts").items())
    if (at(facts, "load_running") == false)
      parts.push_back("the load on the " + word(host) + " had died by the end");
  for (auto& text : divided_load(summary.run.asked, outcome)) parts.push_back(std::move(text));
  if (const auto text = traffic(outcome); !text.empty()) parts.push_back(text);
  if (const auto text = neighbours(outcome); !text.empty()) parts.push_back(text);
  if (!at(summary.run.asked, "link").is_null())
    for (const auto& [host, facts] : at(outcome, "hosts").items())
      if (const auto& gone = at(at(facts, "link"), "gone"); gone.is_string())
        parts.push_back("THE LINK'S FAULTS NEED NOT HAVE BEEN THERE on the " + word(host) + ": " +
                        word(gone));
  if (const auto& why = at(outcome, "link_unproved"); why.is_string()) parts.push_back(word(why));
  for (const auto& text : changed_settings(outcome)) parts.push_back(text);
  add_notes(parts, summary);
  add_silence(parts, summary);
  if (const auto text = drops(outcome); !text.empty()) parts.push_back(text);
  if (const auto text = faults(outcome); !text.empty()) parts.push_back(text);
  if (const auto text = launches_missed(outcome); !text.empty()) parts.push_back(text);
  for (const auto& text : taken_away(summary)) parts.push_back(text);
  for (const auto& text : clocks(outcome)) parts.push_back(text);
  add_throttling(parts, summary);
  if (summary.skipped_cycles > 0)
    parts.push_back(
        many(summary.skipped_cycles, "skipped cycle", "skipped cycles") +
        fmt::format(" (response time up to {} µs)", microseconds(static_cast<double>(summary.response.max))));
  if (const auto text = losses(outcome, "overwritten", "at"); !text.empty())
    parts.push_back("overwritten before they were read: " + text);
  if (const auto text = losses(outcome, "on_the_way", "to"); !text.empty())
    parts.push_back("lost on the way: " + text);
  for (const auto& text : other_traffic(summary)) parts.push_back(text);
  if (!summary.no_parts.empty()) parts.push_back(summary.no_parts);
  const struct {
    const char *key, *one, *several;
  } counters[] = {{"duplicates", "duplicate", "duplicates"},
                  {"strays", "stray answer", "stray answers"},
                  {"reordered", "answer out of order", "answers out of order"},
                  {"wrong_size", "answer of another payload size, which settles no message",
                   "answers of another payload size, which settle no message"},
                  {"wrong_server_times", "answer with server times that do not fit into its round trip",
                   "answers with server times that do not fit into their round trips"},
                  {"refused_sends", "message refused by the transport", "messages refused by the transport"},
                  {"dropped_records", "sample not recorded, and missing above",
                   "samples not recorded, and missing above"}};
  for (const auto& [key, one, several] : counters)
    if (const auto number = count(at(outcome, key)); number > 0) parts.push_back(many(number, one, several));
  return join(parts, "; ");
}

std::vector<std::string> refusals(const Summaries& summaries) {
  std::vector<Refused> all;
  for (const auto& summary : summaries)
    for (const auto& [host, end] : at(summary.run.outcome, "hosts").items()) add_refusals(all, end);
  return notes_of(all);
}

std::vector<std::string> refusals_of(const nlohmann::json& end) {
  std::vector<Refused> all;
  add_refusals(all, end);
  return notes_of(all);
}

}  // namespace ontime::report

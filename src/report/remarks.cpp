// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <cstdio>
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

// A simulated machine's table must not pass for a robot's.
std::string simulated(const json& outcome) {
  for (const auto& [host, facts] : at(outcome, "hosts").items())
    if (const auto& by = at(at(facts, "machine"), "simulated"); by.is_string())
      return fmt::format("SIMULATED by {}: compares settings, predicts no real machine's times", word(by));
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
  return (is_short ? "TRAFFIC SHORTFALL: " : "traffic: ") + join(ways, ", ");
}

// What became of the background topics' messages, loudly where fewer were sent than requested.
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
                  {"skipped_cycles", "{} not sent because their sender overran its period"},
                  {"refused", "{} refused by the transport"},
                  {"overruns", "{} with a callback that took longer than its turn"},
                  {"strays", "{} of another sender"}};
    std::vector<std::string> details;
    for (const auto& [key, what] : others)
      if (const auto number = count(at(counted, key)); number > 0)
        details.push_back(fmt::format(fmt::runtime(what), grouped(number)));
    ways.push_back(details.empty() ? text : text + " (" + join(details, ", ") + ")");
  }
  if (ways.empty()) return "";
  return (is_short ? "BACKGROUND TOPICS SHORTFALL: " : "background topics: ") + join(ways, ", ");
}

// Where the kernel dropped something: loss has a place.
std::string drops(const json& outcome) {
  std::vector<std::string> parts;
  const struct {
    const char *key, *what;
  } places[] = {{"own_sockets", "{} because a socket buffer of the {}'s middleware was full"},
                {"udp_receive", "{} because a UDP socket buffer of any process of the {} was full"},
                {"udp_send", "{} that the {}'s sockets could not send"},
                {"fragments", "{} on the {} because fragments were missing"},
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

using Weight = Remark::Weight;

std::string percent(double share) { return fmt::format("{:.2g} %", share * 100); }

// Causes outside the network and the other end: the CPU was given to others, or our own thread slept.
constexpr double much_stolen = 0.001;
void add_taken_away(std::vector<Remark>& remarks, const statistics::Summary& summary) {
  const auto& outcome = summary.run.outcome;
  const bool one_machine = record::on_one_machine(outcome);
  for (const auto* host : {"controller", "component"}) {
    const auto& stolen = at(at(at(outcome, "conditions"), host), "cpu_stolen");
    if (!stolen.is_number() || stolen.get<double>() < much_stolen) continue;
    remarks.push_back(
        {Weight::caution,
         fmt::format("the hypervisor took {{}} of the time of the {}'s CPUs", one_machine ? "machine" : host),
         stolen.get<double>(), percent});
    if (one_machine) break;
  }
  if (summary.shape.worst.empty() || summary.wake_up.count == 0) return;
  const auto& [took_ns, before, message, after] = summary.shape.worst.front();
  const auto woke_late = static_cast<double>(roundtrip::wake_up_latency_ns(message));
  if (woke_late * 2 >= static_cast<double>(took_ns))
    remarks.push_back(
        {Weight::detail, fmt::format("of the longest answered wait, {} µs, the sender's wake-up took {}",
                                     microseconds(static_cast<double>(took_ns)), microseconds(woke_late))});
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
      parts.push_back(fmt::format("{} was suspended for {:.1f} s; no measured time includes that", machine,
                                  slept.get<double>()));
    if (moved.is_number() && std::abs(moved.get<double>()) >= long_s)
      parts.push_back(fmt::format("the system clock of {} was moved by {:+.1f} s; no measured time uses it",
                                  machine, moved.get<double>()));
    const auto& slewed = at(conditions, "clock_slew_ppm");
    if (slewed.is_number() && std::abs(slewed.get<double>()) >= much_slew_ppm)
      parts.push_back(fmt::format(
          "the clock of {} was slewed by {:+.0f} ppm, and so is every time that it measured. Fix: "
          "measure once its time service has settled",
          machine, slewed.get<double>()));
  }
  return parts;
}

// Whether the kernel had a thread of this role, or where none has it any thread, under real-time scheduling.
bool ran_in_real_time(const json& host, const char* role) {
  bool of_role = false, any = false, has_role = false;
  for (const auto& thread : at(host, "threads")) {
    const auto& policy = at(thread, "policy");
    const bool real_time = policy == "fifo" || policy == "rr" || policy == "deadline";
    any = any || real_time;
    if (at(thread, "role") != role) continue;
    has_role = true;
    of_role = of_role || real_time;
  }
  return has_role ? of_role : any;
}

// What keeps a CPU from its real-time threads for a while each second, and how long.
struct Throttle {
  std::string name;
  double least_ns = 0;
};
std::optional<Throttle> throttle_of(const json& machine) {
  const auto release = word(at(machine, "kernel_release"));
  int major = 0, minor = 0;
  const bool known = std::sscanf(release.c_str(), "%d.%d", &major, &minor) == 2;
  // RT throttling became the fair server: 50 ms of each second for ordinary threads.
  if (known && (major > 6 || (major == 6 && minor >= 12))) return Throttle{"the fair server", 50e6};
  const auto &runtime = at(machine, "rt_runtime_us"), &period = at(machine, "rt_period_us");
  if (!runtime.is_number() || !period.is_number() || runtime < 0) return std::nullopt;
  const double rest_us = period.get<double>() - runtime.get<double>();
  if (rest_us <= 0) return std::nullopt;
  return Throttle{fmt::format("RT throttling (kernel.sched_rt_runtime_us is {})", word(runtime)),
                  rest_us * 1e3};
}

void add_throttling(std::vector<Remark>& remarks, const statistics::Summary& summary) {
  const auto suspect = [&](const char* host, const char* role, const char* what, std::int64_t ns) {
    const auto& facts = at(at(summary.run.outcome, "hosts"), host);
    const auto throttle = throttle_of(at(facts, "machine"));
    if (!throttle || static_cast<double>(ns) < throttle->least_ns || !ran_in_real_time(facts, role)) return;
    remarks.push_back(
        {Weight::caution, fmt::format("{} up to {} µs late, as {} of the {} would make it", what,
                                      microseconds(static_cast<double>(ns)), throttle->name, host)});
  };
  suspect("controller", "send", "woke", summary.wake_up.max);
  suspect("component", "receive", "answered", summary.server.max);
  // A faulty or a full link delays as long by itself, and so does a repeated transmission.
  const auto& asked = summary.run.asked;
  const bool by_the_link = !at(asked, "link").is_null() || !at(asked, "traffic").is_null() ||
                           !losses(summary.run.outcome, "on_the_way", "to").empty();
  if (summary.parts && !by_the_link)
    suspect("component", "receive", "received", summary.parts->there.max - summary.parts->there.p50);
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

void add_notes(std::vector<Remark>& remarks, const statistics::Summary& summary) {
  for (std::size_t i = 0; i < std::min(most_notes, summary.notes.size()); ++i)
    remarks.push_back({Weight::caution, text_of(summary.notes[i], summary)});
  if (summary.notes.size() > most_notes)
    remarks.push_back(
        {Weight::detail, many(summary.notes.size() - most_notes, "further note", "further notes")});
}

// A pong that died, a cable that was pulled: not every transport notices.
constexpr std::uint64_t surely_gone = 10;  // messages
void add_silence(std::vector<Remark>& remarks, const statistics::Summary& summary) {
  if (summary.unanswered_at_end < surely_gone || summary.unanswered_at_end == summary.sent) return;
  const auto from_ns =
      static_cast<double>(summary.unanswered_from_ns) - static_cast<double>(summary.start_ns);
  remarks.push_back({Weight::caution, fmt::format("no answer from {:.1f} s on: the last {} messages",
                                                  from_ns / 1e9, grouped(summary.unanswered_at_end))});
}

// Settings of a machine that another process changed during the run.
std::vector<std::string> changed_settings(const json& outcome) {
  std::vector<std::string> parts;
  for (const auto& [host, facts] : at(outcome, "hosts").items())
    for (const auto* group : {"kernel", "isolation"})
      for (const auto& [index, one] : at(facts, group).items())
        if (at(one, "now") != at(one, "after"))
          parts.push_back(fmt::format("{}.{} did not last: at the end {} of the {} was {}, not {}", group,
                                      word(at(one, "setting")), word(at(one, "thing")), word(host),
                                      at(one, "now").is_null() ? "gone" : word(at(one, "now")),
                                      word(at(one, "after"))));
  return parts;
}

// What one remedy permits.
struct Refused {
  std::string remedy;
  std::vector<std::string> found, asked;
};

void add_once(std::vector<std::string>& all, const std::string& text) {
  if (std::find(all.begin(), all.end(), text) == all.end()) all.push_back(text);
}

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
    auto same =
        std::find_if(all.begin(), all.end(), [&](const auto& other) { return other.remedy == remedy; });
    if (same == all.end()) same = all.insert(all.end(), {remedy, {}, {}});
    add_once(same->found, found);
    add_once(same->asked, asked);
  }
}

std::vector<std::string> notes_of(const std::vector<Refused>& all) {
  std::vector<std::string> notes;
  notes.reserve(all.size());
  for (const auto& refused : all)
    notes.push_back(fmt::format("Requested, denied: {};\nfound: {};\nfix: {}", join(refused.asked, ", "),
                                join(refused.found, "; "), refused.remedy));
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

// A file grows, and is begun anew: half of it is sure to be seen where it is ever written to its end.
std::vector<std::string> small_files(const json& outcome) {
  std::vector<std::string> texts;
  for (const auto& [host, facts] : at(outcome, "hosts").items()) {
    const auto &load = at(facts, "load"), &seen = at(load, "hdd_file_bytes");
    const auto requested = count(at(load, "hdd_bytes"));
    if (seen.is_number() && count(seen) < requested / 2)
      texts.push_back(fmt::format(
          "HDD LOAD NOT AS LARGE AS REQUESTED on the {}: an hdd worker had {} in its file at most, "
          "requested: {}. Measure for longer, or give hdd-bytes a smaller value",
          word(host), size(count(seen)), size(requested)));
  }
  return texts;
}

}  // namespace

std::vector<Remark> remarks_of(const statistics::Summary& summary) {
  const auto& outcome = summary.run.outcome;
  std::vector<Remark> remarks;
  const auto add = [&](Weight weight, std::string text) {
    if (!text.empty()) remarks.push_back({weight, std::move(text)});
  };
  const auto is_short = [&](const char* beside) {
    return is_true(at(at(at(outcome, beside), "to_component"), "short")) ||
           is_true(at(at(at(outcome, beside), "to_controller"), "short"));
  };
  add(Weight::not_applied, ending(outcome));
  add(Weight::caution, simulated(outcome));
  for (const auto& [host, facts] : at(outcome, "hosts").items())
    if (at(facts, "load_running") == false)
      add(Weight::not_applied, "the load on the " + word(host) + " had died by the end");
  for (auto& text : divided_load(summary.run.asked, outcome)) add(Weight::not_applied, std::move(text));
  for (auto& text : small_files(outcome)) add(Weight::not_applied, std::move(text));
  add(is_short("traffic") ? Weight::not_applied : Weight::detail, traffic(outcome));
  add(is_short("neighbours") ? Weight::not_applied : Weight::detail, neighbours(outcome));
  if (!at(summary.run.asked, "link").is_null())
    for (const auto& [host, facts] : at(outcome, "hosts").items())
      if (const auto& gone = at(at(facts, "link"), "gone"); gone.is_string())
        add(Weight::not_applied, "LINK FAULTS NOT VERIFIED on the " + word(host) + ": " + word(gone));
  if (const auto& why = at(outcome, "link_unproved"); why.is_string()) add(Weight::caution, word(why));
  for (const auto& text : changed_settings(outcome)) add(Weight::not_applied, text);
  add_notes(remarks, summary);
  add_silence(remarks, summary);
  add(Weight::detail, drops(outcome));
  add(Weight::detail, faults(outcome));
  add(Weight::detail, launches_missed(outcome));
  add_taken_away(remarks, summary);
  for (const auto& text : clocks(outcome)) add(Weight::caution, text);
  add_throttling(remarks, summary);
  if (summary.skipped_cycles > 0)
    add(Weight::detail, many(summary.skipped_cycles, "skipped cycle", "skipped cycles") +
                            fmt::format(" (response time up to {} µs)",
                                        microseconds(static_cast<double>(summary.response.max))));
  if (const auto text = losses(outcome, "overwritten", "at"); !text.empty())
    add(Weight::detail, "overwritten before they were read: " + text);
  if (const auto text = losses(outcome, "on_the_way", "to"); !text.empty())
    add(Weight::detail, "lost on the way: " + text);
  for (const auto& text : other_traffic(summary)) add(Weight::caution, text);
  add(Weight::detail, summary.no_parts);
  const struct {
    Weight weight;
    const char *key, *one, *several;
  } counters[] = {
      {Weight::detail, "duplicates", "duplicate", "duplicates"},
      {Weight::detail, "strays", "stray answer", "stray answers"},
      {Weight::detail, "reordered", "answer out of order", "answers out of order"},
      {Weight::caution, "wrong_size", "answer of another payload size, which settles no message",
       "answers of another payload size, which settle no message"},
      {Weight::caution, "wrong_server_times", "answer with server times that do not fit into its round trip",
       "answers with server times that do not fit into their round trips"},
      {Weight::detail, "refused_sends", "message refused by the transport",
       "messages refused by the transport"},
      {Weight::caution, "dropped_records", "sample not recorded, and missing above",
       "samples not recorded, and missing above"}};
  for (const auto& [weight, key, one, several] : counters)
    if (const auto number = count(at(outcome, key)); number > 0) add(weight, many(number, one, several));
  return remarks;
}

std::string remarks(const statistics::Summary& summary) {
  std::vector<std::string> texts;
  for (const auto& remark : remarks_of(summary))
    texts.push_back(remark.amount ? replace_all(remark.text, "{}", remark.shown(*remark.amount))
                                  : remark.text);
  return join(texts, "; ");
}

std::string name_of_some(const std::vector<std::string>& names, const std::vector<std::size_t>& places) {
  constexpr std::size_t most = 3;
  if (places.size() == names.size() && names.size() > 1) return "all runs";
  std::vector<std::string> some;
  for (std::size_t i = 0; i < std::min(most, places.size()); ++i) some.push_back(names.at(places[i]));
  if (places.size() <= most) return join(some, ", ");
  return fmt::format("{} of {} runs ({}, …)", places.size(), names.size(), join(some, ", "));
}

std::vector<SharedRemark> shared_remarks(const std::vector<const statistics::Summary*>& runs) {
  struct Gathered {
    Remark remark;
    double most = 0;
    std::vector<std::size_t> runs;
  };
  std::vector<Gathered> all;
  for (std::size_t run = 0; run < runs.size(); ++run)
    for (const auto& remark : remarks_of(*runs[run])) {
      auto same = std::find_if(all.begin(), all.end(), [&](const Gathered& other) {
        return other.remark.text == remark.text &&
               other.remark.amount.has_value() == remark.amount.has_value();
      });
      if (same == all.end())
        same = all.insert(all.end(), {remark, remark.amount.value_or(0), {}});
      else if (remark.amount) {
        same->most = std::max(same->most, *remark.amount);
        same->remark.amount = std::min(*same->remark.amount, *remark.amount);
      }
      if (same->runs.empty() || same->runs.back() != run) same->runs.push_back(run);
    }
  std::vector<SharedRemark> shared;
  for (auto& [remark, most, of] : all) {
    auto text = remark.text;
    if (remark.amount) {
      const auto low = remark.shown(*remark.amount), high = remark.shown(most);
      text = replace_all(text, "{}", low == high ? low : fmt::format("{} to {}", low, high));
    }
    shared.push_back({remark.weight, std::move(text), std::move(of)});
  }
  return shared;
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

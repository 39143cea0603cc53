// SPDX-License-Identifier: Apache-2.0
#include "listen/listen.hpp"

#include <algorithm>
#include <deque>
#include <exception>
#include <filesystem>
#include <iterator>
#include <numeric>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "commands.hpp"
#include "flags.hpp"
#include "listen_budget.hpp"
#include "listen_chains.hpp"
#include "listen_cost.hpp"
#include "listen_results.hpp"
#include "listen_words.hpp"
#include "listening.hpp"
#include "output.hpp"
#include "table/table.hpp"
#include "terminal.hpp"
#include "watch/watch.hpp"

namespace ontime::app {
namespace {

using namespace std::chrono_literals;
using nlohmann::ordered_json;

constexpr auto look_for_list = 3s;

// From a day on, recording every message would fill a disk.
constexpr auto most_whole = 24h;
constexpr std::uint64_t usual_keep = 150'000'000, least_keep = 10'000'000;

std::optional<std::chrono::nanoseconds> time_of(const char* flag, const std::string& text) {
  return text.empty() ? std::nullopt : std::optional(duration_flag(flag, text));
}

std::optional<std::chrono::nanoseconds> time_to_listen(const std::string& text) {
  const auto time = time_of("--for", text);
  if (time && *time < 1s) throw wrong("--for: '{}' is too short; the minimum is 1s", text);
  return time;
}

// The bound of a results file that keeps only the worst messages; empty: it keeps all.
std::optional<std::uint64_t> bound_of(const ListenArguments& arguments,
                                      std::optional<std::chrono::nanoseconds> time) {
  if (arguments.keep.empty())
    return !arguments.results.empty() && time && *time >= most_whole ? std::optional(usual_keep)
                                                                     : std::nullopt;
  if (arguments.results.empty())
    throw wrong("--keep limits the size of a results file. Fix: add --results FILE");
  if (arguments.is_recording()) throw wrong("--keep: a recording is always kept whole. Fix: remove --keep");
  if (const auto bytes = bytes_flag("--keep", arguments.keep); bytes >= least_keep) return bytes;
  throw wrong("--keep: '{}' is too small; the minimum is 10 MB", arguments.keep);
}

class Listening {
 public:
  explicit Listening(const ListenArguments& arguments)
      : arguments_(arguments),
        limits_{time_of("--deadline", arguments.deadline), time_of("--period", arguments.period),
                time_of("--age", arguments.age)},
        chains_(chains_of(arguments.chains)),
        topics_(arguments.topics.begin(), arguments.topics.end()),
        time_(time_to_listen(arguments.time)),
        most_bytes_(bound_of(arguments, time_)),
        as_json_(is_json_flag(arguments.format)),
        output_(arguments.output, as_json_ ? Kind::json : Kind::text),
        width_(arguments.output.empty() ? reading_columns() : std::string::npos) {
    if (arguments.is_recording() && time_)
      throw wrong("--for: a recording is always read to its end. Fix: remove --for");
    if (arguments.list && !time_ && !arguments.is_recording()) time_ = look_for_list;
    if (arguments.list && !arguments.results.empty())
      throw wrong("--results: --list records no messages. Fix: remove one of the two");
    if (arguments.reader && arguments.list) throw wrong("--reader: it lists no topics. Fix: remove --list");
    if (arguments.reader && topics_.empty()) throw wrong("--reader: name the topics to read");
    if (!arguments.budget.empty()) {
      budget_.emplace(arguments.budget);
      if (arguments.list || !arguments.is_in_processes())
        throw wrong(
            "--budget limits probes in processes. Fix: remove it, or --list, --packets, --pcap and --reader");
    }
    if (chains_.empty()) return;
    if (arguments.list) throw wrong("--chain: --list judges nothing. Fix: remove one of the two");
    if (!arguments.is_in_processes())
      throw wrong(
          "--chain: only probes in processes can follow a message through a node. Fix: remove --packets, "
          "--pcap and --reader");
    for (const auto& chain : chains_)
      for (const auto& step : chain.steps) topics_.insert(step.topic);
  }

  int run() {
    auto& interrupts = catch_interrupts();
    Terminal terminal;
    terminal.does(arguments_.is_recording()      ? "reading"
                  : arguments_.is_in_processes() ? "setting probes"
                                                 : "starting to listen");
    const auto sensor = sensor_of(arguments_, limits_, chains_, topics_);
    auto explainer = make_explainer();
    counters_ = watch::TopicCounters(limits_, topics_);
    const auto metrics = metrics_at(arguments_.metrics);
    std::optional<record::Writer> writer;
    std::optional<ListenResults> results;
    if (!arguments_.results.empty()) {
      if (const auto news = most_bytes_ ? set_lone_log_aside(arguments_.results) : ""; !news.empty())
        print_error(news);
      writer.emplace(arguments_.results);
      if (most_bytes_) writer->keep_worst(*most_bytes_);
      results.emplace(*writer, limits_, nlohmann::json{{"command_line", command_line()}},
                      arguments_.is_recording(), most_bytes_.has_value());
      results->owns_file = !arguments_.is_recording();
      sensor->keep_rows([&](const listen::Row& row) { results->keep(row); });
    }
    sensor->listen_for(0ms);  // finds the nodes and sets probes, which takes seconds on a busy machine
    cost_.begin();
    if (budget_) budget_->begin(*sensor, explainer != nullptr);
    bool has_listened = false;
    std::chrono::steady_clock::time_point hand_over_at;
    const auto serve = [&] {
      if (metrics && metrics->is_wanted())
        metrics->set(counters_.metrics(results ? std::optional(!results->failure().empty()) : std::nullopt));
    };
    while (interrupts == 0 && (!time_ || cost_.listened() < *time_)) {
      has_listened = true;
      const bool goes_on = listen_on(*sensor, results);
      take(ready(sensor->take_misses()), explainer.get(), results ? &*results : nullptr);
      if (budget_) budget_->keep(*sensor, explainer);
      // This copies all flows: once a second is enough.
      if (const auto now = std::chrono::steady_clock::now();
          (now >= hand_over_at && (metrics || results || terminal.shows_progress())) ||
          (results && results->is_full())) {
        hand_over_at = now + 1s;
        auto seen = wanted(sensor->findings());
        terminal.waits(progress_of(seen));
        if (metrics) counters_.add(seen, cost_.listened());
        serve();  // first: a disk may hang
        if (results) {
          results->write(with_chains(std::move(seen)).flows);
          tell_news(*results);
        }
      }
      serve();
      if (!goes_on) break;
    }
    terminal.does("ending");
    sensor->end();
    sort_worst_first(waiting_);
    take(std::exchange(waiting_, {}), explainer.get(), results ? &*results : nullptr);
    auto findings = sensor->findings();
    const bool is_all_seen = add_unseen(findings, topics_, arguments_);
    std::ranges::move(breaks_of(findings), std::back_inserter(findings.remarks));
    add_not_judged(findings);
    findings = wanted(std::move(findings));
    // Live listening may end by Ctrl-C at any time, also before --for does.
    const bool is_cut_off = interrupts > 0 && (arguments_.is_recording() || !has_listened);
    if (results) {
      results->end(with_chains(findings), is_cut_off, budget_ ? budget_->of_pauses() : "");
      tell_news(*results);
    }
    if (output_failed_) std::rethrow_exception(output_failed_);
    write(findings);
    output_.finish();
    if (results) tell_of(*results);
    if (results && !results->failure().empty()) return 3;
    if (is_cut_off) return 130;
    return exit_code_of(findings, limits_, arguments_, is_all_seen);
  }

 private:
  static void tell_news(ListenResults& results) {
    if (const auto news = results.take_news(); !news.empty()) print_error(news);
  }

  // A damaged file adds nothing to the results file.
  static bool listen_on(listen::Sensor& sensor, std::optional<ListenResults>& results) try {
    return sensor.listen_for(200ms);
  } catch (const listen::WrongInput&) {
    if (results) results->forget();
    throw;
  }

  // "3 topics, 1,234 messages, 4 s left".
  std::string progress_of(const listen::Findings& findings) const {
    std::set<std::string> topics;
    std::uint64_t messages = 0;
    for (const auto& flow : findings.flows) {
      topics.insert(flow.topic);
      messages += flow.messages;
    }
    const auto time = time_                       ? about(*time_ - cost_.listened()) + " left"
                      : arguments_.is_recording() ? about(cost_.listened())
                                                  : about(cost_.listened()) + "; Ctrl-C ends it";
    return fmt::format("{}: {}, {}, {}", arguments_.is_recording() ? "reading" : "listening",
                       table::many(topics.size(), "topic", "topics"),
                       table::many(messages, "message", "messages"), time);
  }

  // A node that starts or logs meanwhile misses no limit.
  bool is_wanted(const std::string& topic) const {
    return topics_.contains(topic) ||
           (topics_.empty() && (!limits_.any() || arguments_.list || !listen::is_own_of_ros(topic)));
  }

  void add_not_judged(listen::Findings& findings) const {
    std::set<std::string> topics;
    for (const auto& flow : findings.flows)
      if (topics_.empty() && !is_wanted(flow.topic)) topics.insert(topic_of(flow.topic));
    if (!topics.empty())
      findings.remarks.push_back(
          fmt::format("left out: {}, ROS 2's own. To judge one, name it", fmt::join(topics, ", ")));
  }

  static listen::Findings with_chains(listen::Findings findings) {
    for (const auto& chain : findings.chains)
      for (auto& flow : flows_of(chain)) findings.flows.push_back(std::move(flow));
    return findings;
  }

  listen::Findings wanted(listen::Findings findings) const {
    std::erase_if(findings.flows, [&](const auto& flow) { return !is_wanted(flow.topic); });
    const auto is_others = [&](const auto& topic) {
      return !is_wanted(topic.first) && topic.first != listen::Findings::any_topic;
    };
    std::erase_if(findings.misses_left_out, is_others);
    std::erase_if(findings.forgotten, is_others);
    return findings;
  }

  // nullptr: no limit is set, there are no probes, or this machine cannot record (which it reports).
  std::unique_ptr<listen::Explainer> make_explainer() const {
    if (!limits_.any() || !arguments_.is_in_processes() || arguments_.list || arguments_.no_explain)
      return nullptr;
    try {
      return std::make_unique<listen::Explainer>(most_bytes_.has_value());
    } catch (const listen::Error& error) {
      print_error(fmt::format("late messages are not explained: {}", error.what()));
      return nullptr;
    }
  }

  // If only the worst are kept, misses wait until the events after them are recorded.
  std::vector<listen::Miss> ready(std::vector<listen::Miss> misses) {
    if (!most_bytes_) return misses;
    std::move(misses.begin(), misses.end(), std::back_inserter(waiting_));
    const auto now_ns = std::chrono::nanoseconds(std::chrono::steady_clock::now().time_since_epoch()).count();
    const auto waits = std::stable_partition(waiting_.begin(), waiting_.end(), [&](const auto& miss) {
      return miss.course.taken_ns + listen::window_after_ns <= now_ns;
    });
    std::vector<listen::Miss> taken(std::move_iterator(waiting_.begin()), std::move_iterator(waits));
    waiting_.erase(waiting_.begin(), waits);
    sort_worst_first(taken);
    return taken;
  }

  // Because only the first are explained.
  void sort_worst_first(std::vector<listen::Miss>& misses) const {
    std::ranges::stable_sort(misses, [this](const auto& one, const auto& other) {
      return times_its_limit(one) > times_its_limit(other);
    });
  }

  double times_its_limit(const listen::Miss& miss) const {
    const auto limit = miss.kind == listen::Miss::Kind::age ? limits_.age : limits_.longest_gap();
    return static_cast<double>(miss.value_ns) /
           static_cast<double>(std::max<std::int64_t>(limit.value_or(0ns).count(), 1));
  }

  // Prints misses as they arrive; as JSON, keeps the last ones.
  void take(std::vector<listen::Miss> misses, listen::Explainer* explainer, ListenResults* results) {
    std::erase_if(misses, [&](const auto& miss) { return !is_wanted(miss.topic); });
    if (misses.empty() || arguments_.list) return;
    if (explainer != nullptr) explainer->explain(misses);
    if (results != nullptr) note(misses, explainer != nullptr, *results);
    counters_.add(misses);
    std::ranges::stable_sort(misses, {}, &listen::Miss::at_ns);
    if (!as_json_) return print_unless_failed(misses);
    std::move(misses.begin(), misses.end(), std::back_inserter(misses_));
    for (; misses_.size() > listen::most_misses; ++misses_left_out_) misses_.pop_front();
  }

  // If only the worst are kept: those that were explained, or as many.
  void note(const std::vector<listen::Miss>& misses, bool is_explained, ListenResults& results) const {
    std::size_t noted = 0;
    for (const auto& miss : misses)
      if (!most_bytes_ || (noted < listen::most_explained && (miss.surroundings || !is_explained))) {
        results.note(miss);
        ++noted;
      }
  }

  // The results are recorded to their end, also where standard output cannot be written any more (`| head`).
  void print_unless_failed(const std::vector<listen::Miss>& misses) {
    if (output_failed_) return;
    try {
      output_.write(lines_of(misses, width_, day_));
      output_.flush();
    } catch (...) {
      if (arguments_.results.empty()) throw;
      output_failed_ = std::current_exception();
    }
  }

  void tell_of(const ListenResults& results) const {
    if (!results.failure().empty())
      print_error(fmt::format("results: not all messages were recorded: {}", results.failure()));
    else if (results.runs() == 0)
      print_error(fmt::format(
          "results: no run was added to {}: {}", arguments_.results,
          results.known() > 0 ? "it has those of this recording already" : "no age or period was measured"));
    else
      print_error(
          fmt::format("results: added {} to {}, one per age and period of a flow{}{}. Next: ontime {} {}",
                      table::many(results.runs(), "run", "runs"), arguments_.results,
                      results.known() > 0 ? "; it has the others of this recording already" : "",
                      most_bytes_ ? ", with the worst late messages" : "", most_bytes_ ? "explain" : "report",
                      table::shell_line({arguments_.results})));
  }

  std::uint64_t misses_left_out(const listen::Findings& findings) const {
    return std::accumulate(findings.misses_left_out.begin(), findings.misses_left_out.end(), misses_left_out_,
                           [](auto sum, const auto& topic) { return sum + topic.second; });
  }

  void write(const listen::Findings& findings) {
    const auto forgotten = findings.all_forgotten();
    if (as_json_) {
      auto cost = cost_.json(findings.cost);
      cost["budget"] = budget_ ? budget_->json() : ordered_json();
      const auto to_json = [](const auto& one) { return json_of(one); };
      const ordered_json json{
          {"counted_from_ns", arguments_.is_recording() ? ordered_json() : ordered_json(cost_.from_ns())},
          {"flows", report::array_of(findings.flows, to_json)},
          {"chains", report::array_of(findings.chains, to_json)},
          {"misses", report::array_of(misses_, to_json)},
          {"misses_left_out", misses_left_out(findings)},
          {"forgotten",
           {{"flows", forgotten.flows},
            {"messages", forgotten.messages},
            {"with_misses", forgotten.with_misses}}},
          {"sensor_lost", findings.sensor_lost},
          {"cost", cost},
          {"remarks", findings.remarks}};
      return output_.write(report::json_text(json));
    }
    if (findings.flows.empty()) output_.write("No message was seen.\n");
    for (const auto& flow : findings.flows)
      output_.write(wrapped_lines(arguments_.list ? way_of(flow) : text_of(flow, limits_), width_));
    for (const auto& chain : findings.chains) output_.write(text_of(chain));
    if (!arguments_.list && std::ranges::any_of(with_chains(findings).flows, [](const auto& flow) {
          return flow.not_judged + flow.lost_not_judged > 0;
        }))
      output_.write(wrapped_lines(
          "not judged: messages that ontime may have delayed while it set or removed probes", width_));
    if (!arguments_.list && !arguments_.is_recording())
      output_.write(cost_.text(findings.cost) + (budget_ ? budget_->text() : ""));
    if (findings.sensor_lost > 0) print_error(unseen_of(findings.sensor_lost));
    if (const auto count = misses_left_out(findings); count > 0)
      print_error(fmt::format("{} late ages and periods are counted but not listed: buffer full",
                              table::grouped(count)));
    if (forgotten.flows > 0)
      print_error(
          fmt::format("{} flows of ended processes are not listed: {} messages in total; {} of these flows "
                      "missed a limit",
                      table::grouped(forgotten.flows), table::grouped(forgotten.messages),
                      table::grouped(forgotten.with_misses)));
    for (const auto& remark : findings.remarks) print_error(remark);
  }

  const ListenArguments& arguments_;
  const listen::Limits limits_;
  const std::vector<listen::ChainWish> chains_;
  std::set<std::string> topics_;  // requested; empty: all
  std::optional<std::chrono::nanoseconds> time_;
  std::optional<ListenBudget> budget_;
  const std::optional<std::uint64_t> most_bytes_;  // of results that keep only the worst
  std::vector<listen::Miss> waiting_;              // for the events after them
  const bool as_json_;
  Output output_;
  std::exception_ptr output_failed_;
  const std::size_t width_;  // of its lines
  std::string day_;          // of the last late message that was told
  ListenCost cost_;
  watch::TopicCounters counters_;
  std::deque<listen::Miss> misses_;
  std::uint64_t misses_left_out_ = 0;  // of `misses_`
};

}  // namespace

void add_limits(Command& command, ListenArguments& arguments, const char* age_help) {
  add_value(command, "--deadline", arguments.deadline, "TIME",
            "a message is late when it comes later than this after the previous one");
  add_value(command, "--period", arguments.period, "TIME",
            "the expected period; a message is late when it comes after 1.5 times this");
  add_value(command, "--age", arguments.age, "TIME", age_help);
}

int listen_to(const ListenArguments& arguments) {
  std::error_code ignored;
  for (const auto* input : {&arguments.pcap, &arguments.bag})
    if (!input->empty() && std::filesystem::equivalent(*input, arguments.output, ignored))
      throw wrong("--output: {} is also the input. Choose another file.", arguments.output);
  try {
    return Listening(arguments).run();
  } catch (const listen::WrongInput& error) {
    const auto* flag = !arguments.packets.empty() ? "--packets: " : !arguments.pcap.empty() ? "--pcap: " : "";
    throw wrong("{}{}", flag, error.what());
  }
}

void add_listen(Command& app) {
  auto* command = app.add_subcommand(
      "listen",
      "Checks the messages of a running robot, in its processes or on the wire, without changing it");
  auto arguments = std::make_shared<ListenArguments>();
  command->add_option("TOPIC", arguments->topics, "only these topics (default: all)");
  add_value(
      *command, "--chain", arguments->chains, "TOPIC,TOPIC…[@TIME]",
      "follow messages through nodes from the first topic to the last, such as /scan,/map,/cmd_vel@50ms "
      "(late after 50 ms); latest:/map links /map to the latest message that its process took")
      ->one_a_flag();
  add_limits(*command, *arguments, "a message is late when its age at the take exceeds this");
  add_value(*command, "--for", arguments->time, "TIME", "end after this time (default: at Ctrl-C)");
  command->add_flag("--list", arguments->list, "list the topics with their writers and readers, after 3 s");
  command->add_flag("--no-explain", arguments->no_explain,
                    "do not record kernel events, and do not explain late messages");
  add_value(*command, "--budget", arguments->budget, "SHARE",
            "limit probes and ontime to this share of one CPU, such as 1%: first stop recording kernel "
            "events, then pause at times");
  add_value(*command, "--packets", arguments->packets, "NAME",
            "check RTPS packets on this interface (any: all interfaces) instead of processes");
  add_file(*command, "--pcap", arguments->pcap, "check RTPS packets in this capture file (pcap, pcapng)")
      ->excludes("--packets");
  command
      ->add_flag(
          "--reader", arguments->reader,
          "last resort, without privileges: add a DDS reader of each TOPIC; its writers then also send to it")
      ->excludes("--packets")
      ->excludes("--pcap");
  add_format(*command, arguments->format);
  add_output(*command, arguments->output);
  add_metrics(*command, arguments->metrics);
  add_results(*command, arguments->results,
              "record every message as runs in this results file, for report, compare and plot");
  add_value(
      *command, "--keep", arguments->keep, "SIZE",
      "with --results, for weeks: limit the file to this size. It keeps counts, and the worst late messages "
      "with the kernel events around them (default: 150MB if --for is a day or more, else every message)");
  command->calls([arguments] { return listen_to(*arguments); });
}

}  // namespace ontime::app

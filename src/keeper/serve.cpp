// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <iterator>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include <fmt/format.h>
#include <unistd.h>

#include "background/child.hpp"
#include "journal/journal.hpp"
#include "keeper/flows.hpp"
#include "keeper/isolated.hpp"
#include "keeper/keeper.hpp"
#include "keeper/links.hpp"
#include "keeper/tuned.hpp"
#include "machine/machine.hpp"
#include "orders/orders.hpp"
#include "realtime/privileges.hpp"
#include "trace/trace.hpp"
#include "transport/transport.hpp"

namespace ontime::keeper {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;

constexpr auto patience_with_load = 10s;  // once all else is to be given back

std::optional<machine::Cable> cable_of(const json& ends) {
  if (ends.is_null()) return {};
  return machine::Cable{ends.at("controller"), ends.at("component")};
}

machine::Wire wire_of(const json& wire) {
  if (wire.is_null()) return {};
  return {.bits_per_s = wire.at("bits_per_s"), .vlan = wire.at("vlan")};
}

json lacks(const json& transports) {
  auto reasons = json::array();
  for (const std::string name : transports) try {
      transport::find(name);
    } catch (const transport::Error& error) {
      reasons.push_back(error.what());
    }
  return reasons;
}

class Keeper final : public orders::Worker {
 public:
  explicit Keeper(orders::Events& events) : events_(events) {}

  void obey(const std::string& order, const json& body) override {
    if (order == "open") {
      if (const auto& holder = body.value("holder", json()); holder.is_object())
        journal_.held_for({holder.value("pid", getpid()), holder.at("command")});
      const auto notes = journal::revert_abandoned(kinds());
      events_.tell("opened", {{"machine", machine::describe()},
                              {"notes", notes},
                              {"program", orders::this_program()},
                              {"lacks", lacks(body.value("transports", json::array()))}});
    } else if (order == "join") {
      auto hosts = json::object();
      for (const auto& end : machine::join_namespaces(journal_, body.at("components"),
                                                      cable_of(body.at("cable")), wire_of(body.at("wire"))))
        hosts[end.host] = {{"place", end.prefix},
                           {"interface", end.interface},
                           {"address", end.address},
                           {"port", end.port}};
      events_.tell("joined", {{"hosts", hosts}});
    } else if (order == "tune") {
      events_.tell("tuned", tuned_.apply(body));
    } else if (order == "look") {
      events_.tell("looked", look(body));
    } else if (order == "isolate") {
      events_.tell("isolated", isolated_.apply(body));
    } else if (order == "keep") {
      events_.tell("kept", isolated_.keep(body.at("pid")));
    } else if (order == "restore") {
      events_.doing("restoring settings");
      auto notes = tuned_.take_back();
      std::ranges::move(isolated_.take_back(), std::back_inserter(notes));
      events_.doing("");
      events_.tell("restored", {{"notes", notes}});
    } else if (order == "load") {
      auto loaded = json::object();
      auto lack = or_lack([&] { loaded = load(body.at("host"), workers_of(body.at("load"))); });
      events_.tell("loaded", lack.empty() ? std::move(loaded) : std::move(lack));
    } else if (order == "check") {
      events_.tell("checked", or_lack([&] { background::check(faults_of(body.at("faults"))); }));
    } else if (order == "link") {
      events_.tell("linked", or_lack([&] { links_.add(body); }));
    } else if (order == "cut") {
      links_.cut(body.at("host"), std::chrono::milliseconds(body.at("after_ms")),
                 std::chrono::milliseconds(body.at("for_ms")));
      events_.tell("cutting");
    } else if (order == "traffic") {
      auto stream = body.at("stream").get<background::Stream>();
      stream.groups = isolated_.beside();
      events_.tell("flowing", or_lack([&] { flows_.add(body.at("host"), body.at("way"), stream); }));
    } else if (order == "trace") {
      events_.tell("tracing", trace());
    } else if (order == "cut-out") {
      cut_out(body.at("spans"));
    } else if (order == "unload") {
      unload();
    } else if (order == "begin") {
      machine_ = machine::describe();
      activity_ = machine::activity();
      flows_.begin();
      links_.begin();
      others_.clear();
      note_other();
      events_.tell("begun");
    } else if (order == "end") {
      note_other();
      events_.tell("ended", {{"conditions", machine::between(activity_, machine::activity())},
                             {"hosts", hosts(body.at("links"))},
                             {"traffic", flows_.end()},
                             {"links", links_.end()},
                             {"others", others_},
                             {"machine", machine_as_it_was()}});
    } else if (order == "close") {
      auto left = end_all();
      add_new(left, journal_.revert());
      events_.tell("closed", {{"notes", left}});
      told_ = std::move(left);  // only now: the connection may be gone
    } else {
      throw orders::Error(3, "unknown order '" + order + "' (a bug: please report)");
    }
  }

  std::chrono::milliseconds go_on() override {
    flows_.listen();
    for (const auto& [host, load] : loads_)
      if (writes(load)) load.running->hdd_bytes();
    if (unloading_) return go_on_unloading();
    return std::min<std::chrono::milliseconds>(500ms, links_.go_on([this](const auto& host, auto at) {
      events_.tell("cut", {{"host", host}, {"at_ns", at.count()}});
    }));
  }

  std::vector<std::string> give_back() noexcept override {
    try {
      auto notes = end_all();
      add_new(notes, journal_.revert());
      // The connection may be gone, and then none of these is read: each is told again at the next start.
      const auto tell = told_ ? journal::Tell::once : journal::Tell::always;
      add_new(notes, journal::revert_abandoned(kinds(), tell));
      if (told_)
        std::erase_if(notes,
                      [this](const auto& line) { return std::ranges::find(*told_, line) != told_->end(); });
      return notes;
    } catch (const std::exception& error) {
      return {error.what()};
    }
  }

 private:
  struct Load {
    std::string directory;
    std::unique_ptr<background::StressLoad> running{};
    record::GivenLoad given{};
  };

  // What could not be undone is tried again, and told once.
  static void add_new(std::vector<std::string>& notes, std::vector<std::string> lines) {
    for (auto& line : lines)
      if (std::ranges::find(notes, line) == notes.end()) notes.push_back(std::move(line));
  }

  void note_other() {
    if (auto other = journal_.other_holder(); !other.empty()) others_.insert(std::move(other));
  }

  static bool writes(const Load& load) { return load.running && load.given.hdd_bytes; }

  std::vector<std::string> end_at_once() {
    recorder_.reset();
    flows_.clear();
    return links_.clear();
  }

  // Returns what does not end, for people.
  std::vector<std::string> end_all() {
    events_.doing("stopping the load, restoring settings");
    auto notes = end_at_once();
    for (auto& [host, load] : std::exchange(loads_, {})) {
      if (!load.running) continue;
      if (!background::wait_until([&its = load] { return its.running->end(); }, patience_with_load))
        notes.push_back(fmt::format(
            "{} does not end: it is in an uninterruptible system call, such as a sync of a slow disk. It was "
            "killed, and ends when that call returns",
            load.running->name()));
    }
    return notes;
  }

  json trace() {
    record::Traced traced;
    try {
      recorder_.reset();
      recorder_ = std::make_unique<trace::Recorder>(journal_);
      traced.missing = recorder_->missing();
    } catch (const trace::Error& error) {
      traced.error = error.what();
    } catch (const journal::Error& error) {
      traced.error = error.what();
    }
    return record::to_json(traced);
  }

  // Each window in a frame of its own, none of which is too long then.
  void cut_out(const json& spans) {
    if (!recorder_) throw orders::Error(3, "order 'cut-out' came without a trace (a bug: please report)");
    std::vector<trace::Span> asked;
    for (const auto& span : spans) asked.push_back({span.at(0), span.at(1), span.at(2)});
    for (const auto& window : recorder_->cut(std::move(asked)))
      events_.tell("window", {{"window", trace::to_json(window)}});
  }

  // Returns the actual sizes: a default that is too large for this machine is reduced.
  json load(const std::string& host, const background::Workers& workers) {
    const bool is_first = loads_.empty();
    auto& load = loads_[host];
    load.directory = journal::add_directory(journal_, "stress");
    if (is_first) room_ = background::room_for(load.directory);
    const auto fitted = background::fit(workers, room_);
    load.running = background::stress(fitted.workers, load.directory, isolated_.beside());
    if (workers.vm > 0) {
      load.given.vm_bytes = fitted.workers.vm_bytes;
      load.given.vm_mapped_bytes = load.running->vm_bytes();
    }
    if (workers.hdd > 0) load.given.hdd_bytes = fitted.workers.hdd_bytes;
    return {{"scaled", fitted.scaled}};
  }

  // An error of this machine (a missing program, no permission) becomes the answer: the run fails, the keeper
  // goes on.
  template <typename Do>
  static json or_lack(const Do& what) {
    try {
      what();
      return json::object();
    } catch (const background::NeedsRoot& error) {
      return {{"error", error.what()},
              {"root_by", realtime::how_to_be_root_in_container(realtime::privileges())}};
    } catch (const background::Error& error) {
      return {{"error", error.what()}};
    } catch (const journal::Error& error) {
      return {{"error", error.what()}};
    }
  }

  // Does not block while the kernel takes long (a sync of a slow disk): if the coordinator disappears
  // meanwhile, all other settings must be restored. Folders leave the journal here, so that it does not grow
  // with the runs of a suite.
  void unload() {
    events_.doing("stopping load, traffic and link faults");
    left_of_links_ = end_at_once();
    unloading_ = true;
    go_on_unloading();
  }

  std::chrono::milliseconds go_on_unloading() {
    for (auto& [host, load] : loads_)
      if (load.running && !load.running->end()) {
        events_.doing(fmt::format("waiting until {} ends", load.running->name()));
        return 20ms;
      }
    unloading_ = false;
    auto notes = std::exchange(left_of_links_, {});
    for (const auto& [host, load] : std::exchange(loads_, {}))
      std::ranges::move(journal::remove_directory(journal_, load.directory), std::back_inserter(notes));
    events_.doing("");
    events_.tell("unloaded", {{"notes", notes}});
    return 500ms;
  }

  // By host, what it has.
  json hosts(const json& links) {
    record::ByName<record::Host> all;
    for (const auto& [host, load] : loads_) {
      all[host].load_running = load.running && load.running->running();
      all[host].load = load.given;
      if (writes(load)) all[host].load->hdd_file_bytes = load.running->hdd_bytes();
    }
    for (auto& [host, settings] : tuned_.now()) all[host].kernel = std::move(settings);
    for (const auto& [host, link] : links.items()) all[host].settings = present(link);
    for (auto& [host, things] : isolated_.now()) all[host].isolation = std::move(things);
    return record::to_json(all);
  }

  // As it was when the run began, but for the clock, which may have been set since then.
  json machine_as_it_was() {
    auto clock = machine::clock_state();
    if (machine_.is_null()) return machine::describe();
    const auto offset_ns = [](const json& state) {
      return state.at("realtime_offset_ns").get<std::int64_t>();
    };
    clock["moved_ns"] = offset_ns(clock) - offset_ns(machine_.at("clock"));
    machine_["clock"] = std::move(clock);
    return std::exchange(machine_, nullptr);
  }

  orders::Events& events_;
  journal::Journal journal_{kinds()};
  Tuned tuned_{journal_};
  Isolated isolated_{journal_};
  std::map<std::string, Load> loads_;  // by host; they end before the journal
  bool unloading_ = false;
  background::Room room_{};  // that no load has taken
  Links links_{journal_};
  std::vector<std::string> left_of_links_;  // while it unloads
  Flows flows_;
  std::unique_ptr<trace::Recorder> recorder_;
  machine::Activity activity_;
  json machine_;
  std::set<std::string> others_;                  // that held this machine at the begin or the end of the run
  std::optional<std::vector<std::string>> told_;  // once all was given back and told: what was left
};

}  // namespace

std::span<const journal::Kind> kinds() {
  static const auto all = [] {
    std::vector<journal::Kind> kinds;
    for (const auto& some : {settings::kinds(), isolation::kinds(), background::kinds(), trace::kinds()})
      kinds.insert(kinds.end(), some.begin(), some.end());
    return kinds;
  }();
  return all;
}

int serve() {
  return orders::serve("", [](orders::Events& events) { return std::make_unique<Keeper>(events); });
}

}  // namespace ontime::keeper

// SPDX-License-Identifier: Apache-2.0
#include "conditions/conditions.hpp"

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <set>
#include <sstream>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "record/record.hpp"
#include "scenario/scenario.hpp"

namespace ontime::conditions {
namespace {

using nlohmann::json;

// Runs that state every key at least once, each with its record's form.
class Recorded : public testing::Test {
 protected:
  Recorded() {
    unsetenv("ROS_DOMAIN_ID");  // the shell's own; NOLINT(concurrency-mt-unsafe): one thread
    const auto scenario = scenario::read_scenario(ONTIME_TEST_DATA "/conditions.yaml", {});
    for (const auto& run : scenario.runs)
      for (const auto& one : scenario::together(run, scenario.hosts)) {
        runs_.push_back(one);
        records_.push_back(asked(one, scenario.hosts));
      }
  }
  std::vector<conditions::Run> runs_;
  std::vector<json> records_;
};

// What `--resume` and comparisons with earlier results files stand on.
TEST_F(Recorded, RunKeepsItsKey) {
  std::string found;
  for (std::size_t i = 0; i < runs_.size(); ++i)
    found += fmt::format("#: {} {}\n", runs_[i].id, record::key_of(records_[i]));
  std::ifstream file(ONTIME_TEST_DATA "/conditions.yaml");
  std::string known;
  for (std::string line; std::getline(file, line);)
    if (line.starts_with("#: ")) known += line + "\n";
  EXPECT_EQ(found, known) << "the same conditions have another key: see record::key_of";
}

TEST_F(Recorded, RunComesBackWhole) {
  for (std::size_t i = 0; i < runs_.size(); ++i) {
    EXPECT_EQ(to_json(run_of(to_json(runs_[i]))), to_json(runs_[i]))
        << runs_[i].id << " " << runs_[i].variant;
    EXPECT_EQ(to_json(run_of_record(records_[i])), to_json(run_of(records_[i])));
  }
}

TEST_F(Recorded, EveryFieldDiffersFromItsDefaultSomewhere) {
  std::set<std::string> same;
  for (const auto& field : fields())
    if (field.to_json) same.insert(field.json);
  const auto none = to_json(conditions::Run{});
  for (const auto& record : records_)
    std::erase_if(same, [&](std::string path) {
      std::replace(path.begin(), path.end(), '.', '/');
      const json::json_pointer at("/" + path);
      return record.contains(at) && (!none.contains(at) || record.at(at) != none.at(at));
    });
  // An interface is a host's or a flag's; a repetition begins with 1.
  EXPECT_EQ(same, (std::set<std::string>{"interface", "repetition"}))
      << "add it to tests/data/conditions.yaml";
}

TEST_F(Recorded, EveryKeyIsFoundByTheNameOfAScenario) {
  const auto has = [](const json& record, const json::json_pointer& place) {
    return record.contains(place) && !record.at(place).is_null();
  };
  const auto is_recorded = [&](const std::string& key) {
    const auto places = places_of(key);
    return !places.empty() && std::ranges::any_of(records_, [&](const json& record) {
      return std::ranges::all_of(places, [&](const auto& place) { return has(record, place); });
    });
  };
  // Of these the file states some, and all are made alike.
  const auto is_one_of_many = [](const std::string& key) {
    return key.starts_with("kernel.") || (key.starts_with("realtime.") && key.ends_with(".cpus"));
  };
  for (const auto& key : keys()) EXPECT_TRUE(is_one_of_many(key.path) || is_recorded(key.path)) << key.path;
  for (const auto* key : {"kernel.preset", "kernel.irq-threads", "realtime.cpus", "options.config",
                          "component.options.rmw", "period_us"})
    EXPECT_TRUE(is_recorded(key)) << key;
  EXPECT_FALSE(is_recorded("period_ms"));
}

TEST(Record, InvalidValuesKeepTheirDefaults) {
  const json strange{{"period_us", "soon"},
                     {"payload_bytes", -1},
                     {"schedule", "sometimes"},
                     {"qos", 7},
                     {"link", {{"loss", nullptr}, {"cut", "yes"}}},
                     {"realtime_settings", {1}},
                     {"domain", 1e300},
                     {"timeout_us", 1e300},
                     {"deadline_us", 20000.0}};
  auto wanted = conditions::Run{};
  wanted.task.client.deadline = std::chrono::milliseconds(20);
  EXPECT_EQ(to_json(run_of_record(strange)), to_json(wanted));
  EXPECT_THROW(run_of(strange), std::exception);
  EXPECT_EQ(to_json(run_of_record("no object")), to_json(conditions::Run{}));
}

TEST(Record, IdThatScenariosCannotHaveIsRead) {
  EXPECT_NE(flaw_of_id("3"), "");
  EXPECT_EQ(run_of(json{{"id", "3"}}).id, "3") << "of an earlier version";
}

TEST(Fields, HaveOneNameEach) {
  std::set<std::string> paths, flags, names;
  const auto is_first = [](std::set<std::string>& known, const std::string& name) {
    return name.empty() || known.insert(name).second;
  };
  for (const auto& field : fields()) {
    EXPECT_TRUE(is_first(paths, field.path)) << field.path;
    EXPECT_TRUE(is_first(flags, field.flag)) << field.flag;
    EXPECT_TRUE(is_first(names, field.json)) << field.json;
    EXPECT_EQ(field.path.empty(), field.help.empty()) << field.path;
    EXPECT_EQ(field.path.empty(), !field.set) << field.json;
    EXPECT_TRUE(field.path.empty() || field.json.empty() || field.stated) << field.path;
  }
  for (const auto& key : keys()) EXPECT_NE(key.values, "") << key.path;
}

TEST(Fields, DefaultIsWhatARunHas) {
  std::map<std::string, std::string> defaults;
  std::set<std::string> no_values;
  for (const auto& key : keys()) {
    defaults[key.path] = key.by_default;
    conditions::Run stated;
    try {
      key.set(stated, key.by_default);
      if (key.path.ends_with("-bytes") || key.by_default == "as transport") continue;
      EXPECT_EQ(to_json(stated), to_json(conditions::Run())) << key.path << ": " << key.by_default;
    } catch (const std::invalid_argument&) {
      no_values.insert(key.by_default);
    }
  }
  EXPECT_EQ(no_values, (std::set<std::string>{"", "none", "no limit", "unchanged", "kernel default",
                                              "$ROS_DOMAIN_ID, or 0"}));
  for (const auto& [path, value] : std::map<std::string, std::string>{{"period", "10 ms"},
                                                                      {"duration", "10 s"},
                                                                      {"payload", "500 B"},
                                                                      {"warm-up", "10"},
                                                                      {"schedule", "next-free"},
                                                                      {"explain", "off"},
                                                                      {"security", "off"},
                                                                      {"namespace", "/"},
                                                                      {"topics.ping", "ping"},
                                                                      {"load.component.cpu", "0"},
                                                                      {"background.rate", "100 Hz"},
                                                                      {"link.loss", "none"},
                                                                      {"link.delay", "none"},
                                                                      {"link.dscp", "unchanged"},
                                                                      {"launch-time", "none"},
                                                                      {"listen.topics", "none"},
                                                                      {"isolation.cpus", "none"},
                                                                      {"domain", "$ROS_DOMAIN_ID, or 0"},
                                                                      {"transport", ""},
                                                                      {"realtime.cpus", ""}})
    EXPECT_EQ(defaults.at(path), value) << path;
}

std::string text_of_file(const std::string& name) {
  std::ifstream file(ONTIME_TEST_SOURCE "/" + name);
  return {std::istreambuf_iterator<char>(file), {}};
}

// "qos" of "qos.depth"; "realtime" of "realtime", which has parts.
std::string group_of(const std::string& path) {
  const auto group = path.substr(0, path.find('.'));
  return std::any_of(keys().begin(), keys().end(),
                     [&](const Key& key) { return key.path.starts_with(group + "."); })
             ? group
             : "Run";
}

std::string code(std::string text) {
  for (auto at = text.find('|'); at != text.npos; at = text.find('|', at + 2)) text.insert(at, "\\");
  return text.empty() ? "" : "`" + text + "`";
}

std::string key_tables() {
  std::vector<std::pair<std::string, std::string>> groups{{"Run", ""}};
  for (const auto& key : keys()) {
    const auto row = fmt::format("| {} | {} | {} | {} | {} | {} |\n", code(key.path), code(key.values),
                                 key.by_default, code(key.flag), code(key.json), key.help);
    const auto known = std::find_if(groups.begin(), groups.end(),
                                    [&](const auto& group) { return group.first == group_of(key.path); });
    if (known != groups.end())
      known->second += row;
    else
      groups.emplace_back(group_of(key.path), row);
  }
  std::string all;
  for (const auto& [group, rows] : groups)
    all += fmt::format(
        "\n## {}\n\n| key | values | default | flag | name in `asked` | what "
        "|\n|---|---|---|---|---|---|\n{}",
        group, rows);
  return all;
}

template <typename Of>
std::string table_of(const char* title, const std::vector<PartKey<Of>>& part) {
  auto table = fmt::format("\n## {}\n\n| key | values | what |\n|---|---|---|\n", title);
  for (const auto& key : part)
    table += fmt::format("| {} | {} | {} |\n", code(key.path), code(key.values), key.help);
  return table;
}

std::string key_words() {
  std::vector<std::string> texts{"hosts", "wire"};
  const auto add = [&](const auto& all) {
    for (const auto& key : all) texts.insert(texts.end(), {key.path, key.values});
  };
  add(keys());
  add(host_keys());
  add(wire_keys());
  std::set<std::string> words;
  for (auto& text : texts) {
    std::replace_if(
        text.begin(), text.end(), [](char c) { return c == '.' || c == '|'; }, ' ');
    std::stringstream parts(text);
    for (std::string part; parts >> part;)
      if (part.find_first_not_of("abcdefghijklmnopqrstuvwxyz-") == part.npos)
        words.insert("\"" + part + "\"\n");
  }
  return fmt::format("{}", fmt::join(words, ""));
}

// The end of a file, below a line that says so, is made of the fields: with ONTIME_WRITE_REFERENCE anew.
TEST(Reference, IsWrittenFromTheFields) {
  const std::string mark = "made from src/conditions by `scripts/docs --keys`";
  for (const auto& [name, tail] :
       {std::pair{"docs/reference/keys.md", key_tables()},
        std::pair{"docs/reference/scenario.md",
                  table_of("Keys of a host", host_keys()) + table_of("Keys of the wire", wire_keys())},
        std::pair{"tests/fuzz/scenario.dict", key_words()}}) {
    const auto text = text_of_file(name);
    const auto at = text.find(mark);
    ASSERT_NE(at, text.npos) << name;
    const auto wanted = text.substr(0, text.find('\n', at) + 1) + tail;
    if (std::getenv("ONTIME_WRITE_REFERENCE"))  // NOLINT(concurrency-mt-unsafe): one thread
      std::ofstream(ONTIME_TEST_SOURCE "/" + std::string(name)) << wanted;
    else
      EXPECT_TRUE(text == wanted) << name << " is not up to date: scripts/docs --keys";
  }
}

}  // namespace
}  // namespace ontime::conditions

// SPDX-License-Identifier: Apache-2.0
#include "conditions/conditions.hpp"

#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <fstream>
#include <set>
#include <sstream>

#include <fmt/format.h>
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

TEST(Record, WhatNoRunCanHaveIsLeftOut) {
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
  }
  for (const auto& key : keys()) EXPECT_NE(key.values, "") << key.path;
}

// Whether a name, or its last part, stands in a text as a word.
bool tells(const std::string& text, const std::string& name) {
  const auto last = name.substr(name.rfind('.') + 1);
  const auto is_part = [&](std::size_t at) {
    return at < text.size() &&
           (std::isalnum(static_cast<unsigned char>(text[at])) != 0 || text[at] == '-' || text[at] == '_');
  };
  for (auto at = text.find(last); at != text.npos; at = text.find(last, at + 1))
    if (!is_part(at - 1) && !is_part(at + last.size())) return true;
  return false;
}

std::string text_of_file(const std::string& name) {
  std::ifstream file(ONTIME_TEST_SOURCE "/" + name);
  return {std::istreambuf_iterator<char>(file), {}};
}

TEST(Fields, AreInTheReferenceAndInTheDictionary) {
  const auto docs = text_of_file("docs/scenario.md") + text_of_file("docs/realtime.md") +
                    text_of_file("docs/tune.md"),
             dictionary = text_of_file("tests/fuzz/scenario.dict");
  for (const auto& key : keys()) {
    EXPECT_TRUE(tells(docs, key.path)) << key.path << " is missing in docs/scenario.md";
    std::stringstream parts(key.path);
    for (std::string part; std::getline(parts, part, '.');)
      EXPECT_THAT(dictionary, testing::HasSubstr("\"" + part + "\""))
          << "it is missing in tests/fuzz/scenario.dict";
  }
}

}  // namespace
}  // namespace ontime::conditions

// SPDX-License-Identifier: Apache-2.0
// Where scenarios are: as files, as folders of them, and as they came with ontime.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace ontime::app {

// The folder that came with this program, installed or in its source tree; empty if it is nowhere.
std::filesystem::path own_scenarios();
// What is in it, by the names that scenario_files() takes: "demo", "paper/test1".
std::vector<std::string> own_scenario_names();

// The files that names stand for: a file, or of a folder all *.yaml by name. What is no path here is looked
// for among those that came with ontime ("paper", "paper/test1", "scenarios/paper"), but not "./paper",
// "/paper" and "paper.yaml". Throws orders::Error{2}.
std::vector<std::string> scenario_files(const std::vector<std::string>& names);

// Whether only root and this user (under sudo: who called it) can choose what this name runs: an
// installed scenario, or a file that only they can change or replace; a folder, if they alone can add files
// to it and this holds for its scenarios.
bool is_trusted(const std::string& name);

}  // namespace ontime::app

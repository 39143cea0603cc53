// SPDX-License-Identifier: Apache-2.0
// Results in formats of other programs.
// Ordinary thread.
#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "gate/gate.hpp"
#include "record/record.hpp"

namespace ontime::report {

// Every sample of these runs, a line each, in order of run and message; docs/reference/results-file.md names
// the columns. `write` is given pieces of the text: memory does not grow with the number of samples.
enum class SampleFormat { csv, jsonl };
void export_samples(const record::Reader&, const std::vector<record::Run>&, SampleFormat,
                    const std::function<void(std::string_view)>& write);

// Results of gates for a CI: JUnit XML as Jenkins, GitLab and GitHub Actions read it. A missed gate is a
// failure; a gate that cannot be judged is an error.
std::string junit(const std::vector<gate::Judgement>&);

}  // namespace ontime::report

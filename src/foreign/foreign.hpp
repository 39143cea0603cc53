// SPDX-License-Identifier: Apache-2.0
// Imports files of other tools as runs. The files are not trusted: an error in one throws record::WrongFile,
// which names the line or the key. Ordinary thread.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "record/record.hpp"

namespace ontime::foreign {

enum class Form {
  cyclictest_histogram,  // what `cyclictest -h N` or `-H N` prints or writes into its --histfile
  cyclictest_json,       // what `cyclictest -h N --json=FILE` writes
};

// A run for record::Writer::begin_run() and end_run(). It has no samples: the tool kept how often each value
// occurred, but not when. docs/reference/json.md describes `imported` and `histogram`.
struct Import {
  nlohmann::json asked, outcome;
};

struct What {
  Form form = Form::cyclictest_histogram;
  std::string id = "cyclictest";  // of all runs in the file
  std::int64_t unit_ns = 1000;    // of the numbers in a histogram; JSON states its unit
};
// A run for each of cyclictest's threads.
std::vector<Import> read(const std::string& file, const What&);

}  // namespace ontime::foreign

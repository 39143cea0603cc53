// SPDX-License-Identifier: Apache-2.0
// Why messages of runs were late or lost.
// Ordinary thread; returns text, prints nothing.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "explain/explain.hpp"
#include "record/record.hpp"
#include "report/report.hpp"

namespace ontime::report {

struct Explained {
  record::Run run;
  explain::Account account;
  std::vector<record::Note>
      notes{};  // of a run of `ontime listen`: why messages were late, as it was seen then
};
// As table, whose lines fit so many columns, Markdown or JSON.
std::string render_explained(const std::vector<Explained>&, Format, std::size_t columns = 80);
// All of one message's delay.
std::string render_explained(const Explained&, const explain::Message&, Format, std::size_t columns = 80);

// What was seen around these messages of a run, for ui.perfetto.dev and chrome://tracing.
std::string perfetto_of(const record::Reader&, const record::Run&, const std::vector<explain::Message>&,
                        const explain::Pong* = nullptr);

// Its words, all of them printable.
const char* word_of(const explain::Message&);  // its fate
const char* word_of(explain::State);
std::string faults_of(const explain::Account&);  // "2 late, 0 lost, 3 more late by response time"
std::string span_of(std::int64_t ns);            // "310 µs", "41.2 ms"
// "pong's receive thread waited for a CPU while hog [4 processes] ran: 4.0 ms to 30.0 ms".
std::string sentence_of(const explain::Group&);

}  // namespace ontime::report

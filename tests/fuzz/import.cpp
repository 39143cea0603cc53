// SPDX-License-Identifier: Apache-2.0
// Any bytes as what cyclictest wrote (the first says in which form): refused in words, or runs that are
// reported.
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string>

#include "folder.hpp"
#include "foreign/foreign.hpp"
#include "page/page.hpp"
#include "report/report.hpp"

using namespace ontime;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const fuzz::Folder folder;
  if (size == 0) return 0;
  foreign::What what;
  what.form = data[0] % 2 == 0 ? foreign::Form::cyclictest_histogram : foreign::Form::cyclictest_json;
  const auto file = folder.file("old.txt", data + 1, size - 1);
  std::vector<foreign::Import> runs;
  try {
    runs = foreign::read(file, what);
  } catch (const record::WrongFile&) {
    return 0;
  }
  if (runs.empty()) std::abort();
  if (runs.size() > 64) return 0;  // so many more are only slower
  const auto results = folder.path("results.ontime");
  {
    record::Writer writer(results);
    for (const auto& run : runs) writer.end_run(writer.begin_run(run.asked), run.outcome);
  }
  const record::Reader reader(results);
  std::vector<statistics::Summary> summaries;
  for (const auto& run : reader.runs()) summaries.push_back(statistics::summarise(reader, run));
  if (summaries.size() != runs.size()) std::abort();
  for (const auto format : {report::Format::table, report::Format::json})
    if (report::render(summaries, format).empty()) std::abort();
  if (page::page_of(reader, summaries, {.file = "fuzz"}).empty()) std::abort();
  return 0;
}

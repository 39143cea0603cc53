// SPDX-License-Identifier: Apache-2.0
// Any bytes as a results file: it is read, left as it was, and, where it is one, takes another run.
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <string>

#include "folder.hpp"
#include "record/record.hpp"

namespace {

using namespace ontime;

std::string bytes_of(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

void read_all(const std::string& path) {
  const record::Reader reader(path);
  for (const auto& run : reader.runs()) {
    if (run.key.size() != 32) std::abort();
    reader.notes(run.number);
    reader.each_sample(run.number, [](const roundtrip::Sample& sample) {
      if ((sample.fate == roundtrip::Fate::lost) != (sample.received_ns == 0)) std::abort();
    });
  }
}

void add_run(const std::string& path) {
  const roundtrip::Sample sample{.index = 7,
                                 .intended_ns = 1,
                                 .due_ns = 2,
                                 .woke_ns = 3,
                                 .passed_wake_ns = 4,
                                 .sent_ns = 5,
                                 .received_ns = 6,
                                 .server_received_ns = 0,
                                 .server_sent_ns = 0,
                                 .skipped_cycles = 1,
                                 .fate = roundtrip::Fate::late};
  record::Writer writer(path);
  const auto run = writer.begin_run({{"id", "fuzz"}});
  writer.append(run, {&sample, 1});
  writer.note(run, {"kind", "text", 1, 7});
  writer.end_run(run, {{"sent", 1}});
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const fuzz::Folder folder;
  const auto path = folder.file("results.ontime", data, size);
  try {
    read_all(path);
  } catch (const record::Error&) {
    if (bytes_of(path) != std::string(reinterpret_cast<const char*>(data), size)) std::abort();
    return 0;
  }
  if (bytes_of(path) != std::string(reinterpret_cast<const char*>(data), size)) std::abort();
  try {
    add_run(path);
    read_all(path);
  } catch (const record::Error&) {  // damaged where only a Writer comes
  }
  return 0;
}

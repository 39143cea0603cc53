// SPDX-License-Identifier: Apache-2.0
#include "trace/instance.hpp"

#include <fmt/format.h>

#include "trace/trace.hpp"
#include "trace/tracefs.hpp"

namespace ontime::trace {
namespace {

using journal::Value;

bool accepts(const std::string& what) { return what == instance_name; }

template <class Job>
auto on_tracefs(Job job) {
  try {
    return job(Tracefs());
  } catch (const Error& error) {
    throw journal::Error(error.what());
  }
}

Value read(const std::string&) {
  return on_tracefs([](const Tracefs& tracefs) -> Value {
    struct stat found {};
    if (!tracefs.look(instance_path, found)) return {};
    return fmt::format("{}", found.st_ino);
  });
}

void write(const std::string&, const Value& value, const Value&) {
  on_tracefs(
      [&](const Tracefs& tracefs) { value ? tracefs.make(instance_path) : tracefs.remove(instance_path); });
}

}  // namespace

const journal::Kind instance_kind = {"trace-instance", journal::Scope::machine, accepts, read, write};

std::span<const journal::Kind> kinds() { return {&instance_kind, 1}; }

}  // namespace ontime::trace

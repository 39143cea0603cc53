// SPDX-License-Identifier: Apache-2.0
#include "explain/callbacks.hpp"

#include <fmt/format.h>

namespace ontime::explain {
namespace {

using nlohmann::json;
using record::at;

std::string text_of(const json& value) { return value.is_string() ? value.get<std::string>() : ""; }

// Whether the callbacks of its background topics run on the thread that receives its messages.
bool shares_callbacks(const record::Run& run, const std::string& end) {
  const auto& neighbours = at(run.asked, "neighbours");
  if (at(neighbours, end == "component" ? "there" : "back") != true) return false;
  const bool is_component = end == "component";
  const auto where = text_of(at(neighbours, "where"));
  const auto transport = text_of(at(run.asked, is_component ? "component_transport" : "transport"));
  if (where == "same-callback-group") return true;
  if (where == "same-node" || where == "same-executor")
    return text_of(at(at(run.asked, is_component ? "component_options" : "options"), "executor")) != "multi";
  if (text_of(at(run.asked, "receive")) == "waitset") return false;
  return (where == "same-participant" && transport != "ros2") ||
         (where == "same-process" && transport == "cyclonedds");
}

}  // namespace

std::optional<Remedy> remedy_of_callbacks(const Part& part, const record::Run& run) {
  const auto& callback_us = at(at(run.asked, "neighbours"), "callback_us");
  if (part.cause != Cause::busy || part.thread != "receive" || !callback_us.is_number() ||
      callback_us.get<double>() <= 0 || !shares_callbacks(run, part.end))
    return {};
  return Remedy{{{"neighbours.where", "a place with a thread of its own"}},
                fmt::format("callbacks of the background topics, {:g} ms each, run on this thread too",
                            callback_us.get<double>() / 1e3)};
}

}  // namespace ontime::explain

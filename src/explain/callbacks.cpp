// SPDX-License-Identifier: Apache-2.0
#include "explain/callbacks.hpp"

#include <fmt/format.h>

#include "transport/shipped.hpp"

namespace ontime::explain {
namespace {

using roundtrip::Where;

// Whether the callbacks of its background topics run on the thread that receives its messages.
bool shares_callbacks(const record::Run& run, const std::string& end) {
  const auto& task = run.asked.task;
  const auto& neighbours = task.neighbours;
  const bool is_component = end == "component";
  if (!(is_component ? neighbours.there : neighbours.back)) return false;
  const auto& transport = is_component ? run.asked.component_transport : task.transport;
  const auto& options = is_component ? run.asked.component_options : task.config.options;
  const auto executor = options.find("executor");
  const auto* const own = transport::shipped(transport);
  const bool ours = task.config.receive == transport::Receive::waitset;  // a thread for each topic
  switch (neighbours.where) {
    case Where::same_callback_group:
      return true;
    case Where::same_node:
    case Where::same_executor:
      return executor == options.end() || executor->second != "multi";
    case Where::same_participant:
      return !ours && (own == nullptr || !own->can.nodes);
    case Where::same_process:
      return !ours && own != nullptr && own->can.shares_threads;
    default:
      return false;
  }
}

}  // namespace

std::optional<Remedy> remedy_of_callbacks(const Part& part, const record::Run& run) {
  const auto callback = run.asked.task.neighbours.callback;
  if (part.cause != Cause::busy || part.thread != "receive" || callback.count() <= 0 ||
      !shares_callbacks(run, part.end))
    return {};
  return Remedy{{{"neighbours.where", "a place with a thread of its own"}},
                fmt::format("callbacks of the background topics, {:g} ms each, run on this thread too",
                            static_cast<double>(callback.count()) / 1e6)};
}

}  // namespace ontime::explain

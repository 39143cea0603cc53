// SPDX-License-Identifier: Apache-2.0
// Callbacks of a run's own background topics, which may run on the thread that receives its messages.
#pragma once

#include <optional>

#include "explain/explain.hpp"

namespace ontime::explain {

// What helps where they keep that thread busy; nullopt: they do not.
std::optional<Remedy> remedy_of_callbacks(const Part&, const record::Run&);

}  // namespace ontime::explain

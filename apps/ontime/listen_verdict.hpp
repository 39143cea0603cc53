// SPDX-License-Identifier: Apache-2.0
// What the findings of `ontime listen` lack of the request, and which exit code they have. Ordinary thread.
#pragma once

#include <set>
#include <string>

#include "listen/listen.hpp"
#include "listening.hpp"

namespace ontime::app {

// Adds remarks on requested topics of which no message was seen. True: all were seen.
bool add_unseen(listen::Findings&, const std::set<std::string>& topics, const ListenArguments&);

// Once they are printed. 1: a limit was missed, or is open, which it says; 2: a topic or chain without a
// limit was not seen; 0. `is_all_seen`: a message of each topic that was asked for.
int exit_code_of(const listen::Findings&, const listen::Limits&, const ListenArguments&, bool is_all_seen);

}  // namespace ontime::app

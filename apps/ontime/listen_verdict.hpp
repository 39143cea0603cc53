// SPDX-License-Identifier: Apache-2.0
// Which exit code the findings of `ontime listen` have, once they are printed. Ordinary thread.
#pragma once

#include "listen/listen.hpp"
#include "listening.hpp"

namespace ontime::app {

// 1: a limit was missed, or is open, which it says; 2: a topic or chain without a limit was not seen; 0.
// `is_all_seen`: a message of each topic that was asked for.
int exit_code_of(const listen::Findings&, const listen::Limits&, const ListenArguments&, bool is_all_seen);

}  // namespace ontime::app

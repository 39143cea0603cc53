// SPDX-License-Identifier: Apache-2.0
// What a mistyped word may have meant: a command, an option, a key, a transport.
#pragma once

#include <string>
#include <vector>

namespace ontime::spelling {

// The one of `words` that needs the fewest changes (a letter added, left out, replaced, or swapped with its
// neighbour), at most one for every three letters; or one that begins with `word`. "": none.
std::string nearest(const std::string& word, const std::vector<std::string>& words);

// " (did you mean 'udp'?)", or "".
std::string suggestion(const std::string& word, const std::vector<std::string>& words);

}  // namespace ontime::spelling

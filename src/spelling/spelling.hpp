// SPDX-License-Identifier: Apache-2.0
// Suggestions for a mistyped word: a command, an option, a key, a transport.
#pragma once

#include <string>
#include <vector>

namespace ontime::spelling {

// One that begins with `word`, or else needs the fewest changes (a letter added, left out, replaced, or
// swapped with the next), at most one for every three letters. "": none.
std::string nearest(const std::string& word, const std::vector<std::string>& words);

// " (did you mean 'udp'?)", or "".
std::string suggestion(const std::string& word, const std::vector<std::string>& words);

}  // namespace ontime::spelling

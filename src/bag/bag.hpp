// SPDX-License-Identifier: Apache-2.0
// Recorded messages: a bag of rosbag2 (a folder, or a file of SQLite or MCAP) is judged as listen judges the
// messages of a robot that runs. Files may be foreign and hostile: memory is bounded. Ordinary thread.
#pragma once

#include <memory>
#include <set>
#include <string>

#include "listen/listen.hpp"

namespace ontime::bag {

// Reads the bag to its end. A truncated bag is judged up to its end, with a remark. open() and listen_for()
// throw listen::WrongInput if the file is not a bag or is damaged; the message names the file and the place.
// Remarks on odd messages are on those of `topics`; empty: of all.
std::unique_ptr<listen::Sensor> open(const std::string& path, const listen::Limits&,
                                     std::set<std::string> topics = {});

}  // namespace ontime::bag

// SPDX-License-Identifier: Apache-2.0
// Which sensor `ontime listen` and `ontime import BAG` look through.
#pragma once

#include <memory>
#include <set>
#include <string>
#include <vector>

#include "listen/listen.hpp"
#include "listening.hpp"

namespace ontime::app {

// Probes; if they are denied, campaign::Error has the command line to paste.
std::unique_ptr<listen::Sensor> sensor_in_processes(const listen::Limits&,
                                                    std::vector<listen::ChainWish> = {});

// A reader of our own reads `topics`, in the domain of ROS_DOMAIN_ID. Throws campaign::Error, and as the
// sensors do.
std::unique_ptr<listen::Sensor> sensor_of(const ListenArguments&, const listen::Limits&,
                                          const std::vector<listen::ChainWish>&,
                                          const std::set<std::string>& topics);

}  // namespace ontime::app

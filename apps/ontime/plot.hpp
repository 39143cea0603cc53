// SPDX-License-Identifier: Apache-2.0
// Figures for papers, drawn by gnuplot.
#pragma once

#include <string>

#include "plot/plot.hpp"

namespace ontime::app {

// By the ending of a file's name, which `flag` gave. Throws campaign::Error.
plot::Plot::Form form_of(const char* flag, const std::string& output);

// The figure that gnuplot makes of these commands. What gnuplot prints goes to standard error. Throws
// campaign::Error.
std::string drawn(const std::string& commands);

}  // namespace ontime::app

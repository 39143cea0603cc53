// SPDX-License-Identifier: Apache-2.0
// Figures for papers, as commands for gnuplot, which writes the figure to its standard output.
// Ordinary thread; returns text, prints nothing.
#pragma once

#include <string>
#include <vector>

#include "report/comparison.hpp"
#include "statistics/statistics.hpp"

namespace ontime::plot {

// One column's width, or `wide`, of both. Letters are of 7 pt at that size.
struct Plot {
  enum class Figure { time, ccdf, conditions, payload, background } figure = Figure::time;
  enum class Form { svg, pdf, png } form = Form::svg;
  bool wide = false;
};
// Of runs that were measured. A long run is drawn as the extremes of as many stretches of time as can be told
// apart, so that none is missing.
std::string gnuplot_of(const std::vector<statistics::Summary>&, const Plot&);
// The runs that it does not draw: a figure that pools repetitions leaves out a flawed one (cut off, failed,
// not applied) if another one is sound. Against payload or rate, one that failed or was not applied is a
// mark.
std::vector<const statistics::Summary*> left_out(const std::vector<statistics::Summary>&, const Plot&);
// B / A of each metric with its interval. Empty: there is nothing to compare.
std::string gnuplot_of(const report::Comparison&, const Plot&);

}  // namespace ontime::plot

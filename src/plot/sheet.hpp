// SPDX-License-Identifier: Apache-2.0
// A sheet of paper for gnuplot: axes, texts and a legend, each where it is put, in centimetres from the left
// and the top. gnuplot's own titles and keys are cut off or printed over each other where a name is long;
// these are not.
#pragma once

#include <string>
#include <vector>

#include "plot/plot.hpp"

namespace ontime::plot {

inline constexpr double line_cm = 0.34;    // of text
double text_width_cm(const std::string&);  // in DejaVu Sans, which is wider than Helvetica and Arial
std::string colour(std::size_t i);  // seven that colour-blind readers can tell apart, then from the start
std::string dash(std::size_t i);    // four, the first one solid
inline constexpr std::size_t colours = 7, dashes = 4;

// Lines no longer than that, broken at spaces; not between a number and its unit.
std::vector<std::string> wrapped(const std::string&, double width_cm);

// Of a title.
struct Line {
  std::string text, style;
};
inline constexpr const char* grey_text = "left textcolor rgb '#555555'";
void add_lines(std::vector<Line>& title, const std::string& text, double width_cm,
               const char* style = "left");

struct Box {
  double left, top, right, bottom;
};

class Sheet {
 public:
  Sheet(const Plot&, double height_cm);
  static double width_cm(const Plot&);

  // Styles are gnuplot's: "linewidth 1 linecolor rgb '#000000'".
  void text(double x, double y, const std::string&,
            const std::string& style = "left");  // y: the line's middle
  void line(double x, double from_y, double to_x, double to_y, const std::string& style);
  void point(double x, double y, const std::string& style);
  void add(const std::string& command);                           // a line of its own
  void draw(const std::string& part) { parts_.push_back(part); }  // of gnuplot's "plot"
  // Data of this name, and how they are drawn: "using 1:2 with lines"; without lines neither.
  void draw(const std::string& name, const std::string& lines, const std::string& with);
  // Draws all since the last one, with its axes there, which may be all of it.
  void plot(const Box& axes);
  std::string commands() const { return commands_ + "unset multiplot\n"; }

 private:
  std::string at(double x, double y) const;
  double width_, height_;
  std::string commands_;
  std::vector<std::string> parts_;
};

// What colours, lines and signs mean; as many in a row as fit.
struct Entry {
  std::string text;
  std::string line = {}, point = {};  // styles; either may be empty
  std::string note = {};              // below it, in grey
};
class Legend {
 public:
  Legend(std::vector<Entry>, double width_cm);
  double height_cm() const { return height_; }
  void draw(Sheet&, double left, double top) const;

 private:
  struct Placed {
    Entry entry;
    std::vector<Line> lines;
    double x, y;
  };
  std::vector<Placed> placed_;
  double height_ = 0;
};

std::string number_text(double);  // without an exponent: "0.02", "1.25", "4,000,000"

// A logarithmic axis of times or shares, whose ticks are written out: "10 µs", "1 %".
std::string time_tics(const char* axis, double least_ms, double greatest_ms);
std::string share_tics(const char* axis, double least);

}  // namespace ontime::plot

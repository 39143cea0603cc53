// SPDX-License-Identifier: Apache-2.0
// Text for people: what may reach a terminal, and how wide it is there. Tables before they have a form, and
// their forms: terminal, Markdown, LaTeX, CSV, HTML.
// Ordinary thread; returns text, prints nothing.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace ontime::table {

// On one line, and as UTF-8, whatever it was: what would steer a terminal, or show a text otherwise than it
// is (control characters, marks and overrides of direction, what cannot be seen), becomes '?'. For all that
// comes from elsewhere: a results file, the network. The forms of tables pass all their text through it.
std::string printable(const std::string& text);
std::string printable_lines(const std::string& text);  // its lines stay lines
// What fits so many columns of a terminal, with "…" where there is more.
std::string shortened(const std::string& text, std::size_t most);

std::size_t width_of(const std::string&);  // of UTF-8, in columns of a terminal
// Between words, or between values, which are two blanks apart. The lines after the first are indented
// further.
std::string wrapped(const std::string& paragraph, std::size_t width, const std::string& indent = "");
// "cost     ontime 0.6 % of one CPU …": the text from this column on. Of fewer columns than these it is below
// its label.
inline constexpr std::size_t fewest_for_two = 60;
std::string labelled(const std::string& label, const std::string& text, std::size_t column,
                     std::size_t width);

std::string grouped(std::uint64_t number);                                     // "4,320,000"
std::string many(std::uint64_t number, const char* one, const char* several);  // "1 run", "2,000 runs"
std::string megabits(double bit_s);                                            // "80", "38.2", "10000"
// In percent without "%", in so many digits: "0", "0.05", "99.9"; 0 and 100 only if exact.
std::string percent(double share, int digits);
// A limit of an interval, which no rounding makes narrower; 0 and 100 only if exact, or almost 0.
enum class Limit { low, high };
std::string percent(double share, int digits, Limit limit);
std::string points(double difference);     // of two shares: "+20", "-0.008"
int decimals_that_show(double below_one);  // enough not to print 0: 2 for 0.05
std::string join(const std::vector<std::string>& parts, std::string_view separator);
template <class All, class TextOf>
std::vector<std::string> texts_of(const All& all, TextOf text_of) {  // of each one
  std::vector<std::string> texts;
  texts.reserve(all.size());
  for (const auto& one : all) texts.push_back(std::invoke(text_of, one));
  return texts;
}
std::vector<std::string> split(const std::string& text, char separator);  // at least one
// As one command, which a POSIX shell, zsh and fish take for these words.
std::string shell_line(const std::vector<std::string>& words);
// For texts that users paste; nothing, if a word has a character that a terminal may show as another.
std::optional<std::string> line_to_paste(const std::vector<std::string>& words);
std::string as_operand(const std::string& file);  // of "-x" "./-x", which is no option
std::string replace_all(std::string_view text, std::string_view what, std::string_view with);

struct Column {
  enum class Align { left, right };
  std::string name;  // '\n' where a narrow form may break it
  Align align = Align::right;
  bool drawn = false;  // of blocks, each in its place: for a terminal alone
  int dropped = 0;     // where a terminal is too narrow: 1 first; 0 never
};

struct Table {
  std::string title = {};
  std::string conditions = {};
  std::vector<Column> columns = {};
  std::vector<std::vector<std::string>> rows = {};
  // What follows a '\n' in one stays on its line, so that a command can be copied.
  std::vector<std::string> notes = {};
  std::string legend = {};  // of this table alone, for a form that has no page around it
};

inline std::vector<std::string> names_of(const Table& table) {
  return texts_of(table.columns, &Column::name);
}

// Of its name's lines, and of its cells.
std::size_t width_of_column(const Table&, std::size_t column);

struct Page {
  std::vector<Table> tables = {};
  std::vector<std::string> notes = {};  // on all of them
  std::string legend = {};
};

// Each text as printable() has it; a line of a note or of a column's name stays one. A form that is for a
// terminal needs it.
Page printable(Page);
Page without_drawings(Page);
Table without_unknown(Table);  // columns whose cells are all unknown, "-"

// Lines of at most `width` columns where cells and words allow it: a table that is wider drops columns, or
// has the names of its rows on lines of their own.
std::string as_text(const Page&, std::size_t width);
std::string as_markdown(const Page&);
std::string as_latex(const Page&);
// RFC 4180, lines ended by '\n'.
std::string as_csv(const std::vector<std::string>& header, const std::vector<std::vector<std::string>>& rows);

// Escaped for HTML, between tags and within quoted attributes. Characters that are not printable() are
// replaced, too.
std::string escaped(const std::string& text);
std::string escaped_lines(const std::string& text);  // its lines stay lines
std::string note_as_html(const std::string& note);   // its lines stay lines
std::string as_html(const Table&);                   // with its caption, conditions and notes
extern const std::string_view style;                 // page.css, as it was when this was built
// One file that opens anywhere, without a network: page.css is its style. A content security policy lets no
// script run but these. `body` is markup.
std::string standing_alone(const std::string& title, const std::string& body,
                           const std::vector<std::string_view>& scripts = {});
std::string as_html(const Page&);  // standing alone

}  // namespace ontime::table

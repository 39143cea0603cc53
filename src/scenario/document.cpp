// SPDX-License-Identifier: Apache-2.0
#include "scenario/document.hpp"

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <sstream>
#include <system_error>

#include <boost/locale/utf.hpp>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <yaml-cpp/eventhandler.h>

#include "spelling/spelling.hpp"

namespace ontime::scenario {
namespace {

namespace fs = std::filesystem;
namespace utf = boost::locale::utf;

constexpr std::size_t most_bytes = std::size_t{1} << 20U;
constexpr std::size_t most_nodes = 100'000;
constexpr std::size_t most_levels = 32;

bool is_text(utf::code_point c) {
  const bool control = (c < 0x20 && c != '\t' && c != '\n' && c != '\r') || (c >= 0x7f && c < 0xa0);
  return utf::is_valid_codepoint(c) && !control;
}

// The first byte that is not valid UTF-8, or a control character.
std::size_t first_of_no_text(const std::string& text) {
  for (auto at = text.begin(); at != text.end();) {
    const auto begin = at;
    if (!is_text(utf::utf_traits<char>::decode(at, text.end())))
      return static_cast<std::size_t>(begin - text.begin());
  }
  return text.npos;
}

YAML::Mark mark_of(const std::string& text, std::size_t at) {
  const auto line_begin = at == 0 ? text.npos : text.rfind('\n', at - 1);
  YAML::Mark mark;
  mark.line =
      static_cast<int>(std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(at), '\n'));
  mark.column = static_cast<int>(at - (line_begin == text.npos ? 0 : line_begin + 1));
  return mark;
}

void check_characters(const std::string& file, const std::string& text) {
  const auto wrong = first_of_no_text(text);
  if (wrong == text.npos) return;
  const auto byte = static_cast<unsigned char>(text[wrong]);
  fail_at(file, mark_of(text, wrong), "byte 0x{:02x} is {}; a scenario is text in UTF-8", byte,
          byte < 0x80 || byte == 0xc2 ? "a control character" : "not UTF-8");
}

// Counts what the parser finds, and stops it at the limits.
class Bounds final : public YAML::EventHandler {
 public:
  void OnDocumentStart(const YAML::Mark& mark) override {
    if (++documents_ > 1) fail(mark, "a second document begins here; a scenario has one");
  }
  void OnDocumentEnd() override {}
  void OnNull(const YAML::Mark& mark, YAML::anchor_t anchor) override { add(mark, anchor, {1, 1}); }
  void OnScalar(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor,
                const std::string& value) override {
    check(mark, tag);
    if (first_of_no_text(value) != value.npos) fail(mark, "this value contains a control character");
    add(mark, anchor, {1, 1});
  }
  void OnAlias(const YAML::Mark& mark, YAML::anchor_t anchor) override {
    const auto whole = whole_.find(anchor);
    if (whole == whole_.end()) fail(mark, "this alias is inside its own anchor and would never end");
    add(mark, 0, whole->second);
  }
  void OnSequenceStart(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor,
                       YAML::EmitterStyle::value) override {
    begin(mark, tag, anchor);
  }
  void OnSequenceEnd() override { end(); }
  void OnMapStart(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor,
                  YAML::EmitterStyle::value) override {
    begin(mark, tag, anchor);
  }
  void OnMapEnd() override { end(); }

  // Where the innermost list or map that has not ended begins. An exception inside a bracket comes after it.
  const YAML::Mark& innermost() const { return open_.back().mark; }

 private:
  // Size of a node and all below it, with aliases expanded.
  struct Extent {
    std::size_t nodes, levels;
  };
  struct Open {
    YAML::Mark mark;
    YAML::anchor_t anchor;
    std::size_t nodes_before;
    std::size_t levels;
  };

  [[noreturn]] static void fail(const YAML::Mark& mark, const std::string& message) {
    throw YAML::ParserException(mark, message);
  }

  // yaml-cpp gives "?" for a value without a tag, and "!" for a quoted one.
  static void check(const YAML::Mark& mark, const std::string& tag) {
    if (!tag.empty() && tag != "?" && tag != "!")
      fail(mark, fmt::format("the tag '{}' has no effect in a scenario: leave it out", tag));
  }
  void add(const YAML::Mark& mark, YAML::anchor_t anchor, Extent extent) {
    nodes_ += extent.nodes;
    if (nodes_ > most_nodes)
      fail(mark, fmt::format("more than {} keys and values, with aliases expanded; split the scenario",
                             most_nodes));
    if (open_.size() + extent.levels > most_levels)
      fail(mark, fmt::format("more than {} levels of nesting", most_levels));
    if (!open_.empty()) open_.back().levels = std::max(open_.back().levels, extent.levels + 1);
    if (anchor != 0) whole_[anchor] = extent;
  }
  void begin(const YAML::Mark& mark, const std::string& tag, YAML::anchor_t anchor) {
    check(mark, tag);
    const auto before = nodes_;
    add(mark, 0, {1, 1});
    open_.push_back({mark, anchor, before, 1});
  }
  void end() {
    const auto closed = open_.back();
    open_.pop_back();
    if (!open_.empty()) open_.back().levels = std::max(open_.back().levels, closed.levels + 1);
    if (closed.anchor != 0) whole_[closed.anchor] = {nodes_ - closed.nodes_before, closed.levels};
  }

  int documents_ = 0;
  std::size_t nodes_ = 0;
  std::vector<Open> open_;
  std::map<YAML::anchor_t, Extent> whole_;
};

void parse(const std::string& text, Bounds& bounds) {
  std::istringstream in(text);
  YAML::Parser parser(in);
  while (parser.HandleNextDocument(bounds)) {  // OnDocumentStart refuses a second document
  }
}

// Before a line break, a blank or a quote at the end of the text, yaml-cpp drops a quote that is not closed,
// and all below it, without an error.
bool ends_within_quotes(const std::string& text) try {
  Bounds bounds;
  parse(text.substr(0, text.find_last_not_of(" \t\r\n") + 1) + 'x', bounds);
  return false;
} catch (const YAML::Exception& error) {
  return error.msg == YAML::ErrorMsg::EOF_IN_SCALAR;
}

// Where a quote opens that is not closed; yaml-cpp does not say it. It is the last before which the text is
// not within quotes. npos: it is further up than the bound on the work.
std::size_t open_quote_of(const std::string& text) {
  int tries = 50;
  for (auto at = text.size(); at > 0 && tries > 0;) {
    at = text.find_last_of("\"'", at - 1);
    if (at == text.npos) break;
    const char before = at == 0 ? ' ' : text[at - 1];
    if (before == (text[at] == '"' ? '\\' : '\'')) continue;  // it stands for itself
    if (!ends_within_quotes(text.substr(0, at))) return at;
    --tries;
  }
  return text.npos;
}

void check_quotes(const std::string& file, const std::string& text) {
  if (!ends_within_quotes(text)) return;
  const auto at = open_quote_of(text);
  if (at == text.npos) fail_at(file, mark_of(text, text.size()), "a quote above is not closed");
  fail_at(file, mark_of(text, at), "this {0} is not closed: a second {0} is missing", text[at]);
}

// Where a list item or a key of the block is expected, and there is something else. "": not known.
std::string flaw_of_block(const std::string& line, std::size_t column) {
  const auto from = line.find_first_not_of(' ');
  if (column == from)
    return line[column] != '-' || column + 1 == line.size()
               ? "this line is no part of the block above it. Fix: align it with the keys or list items that "
                 "it belongs "
                 "to, and check that ':' follows a key"
           : line[column + 1] != ' '
               ? "a space is needed after '-'"
               : "this list item is no part of the block above it. Fix: check its indentation";
  const char before = line[line.find_last_not_of(' ', column - 1)];
  if (before == '"' || before == '\'')
    return fmt::format("this text follows a closing {}. Fix: look for a quote that is missing above", before);
  return before == ']' || before == '}' ? fmt::format("this text follows a closing {}", before) : "";
}

// The parser's own words name neither a tab, a text that needs quotes, wrong indentation, nor the bracket
// that is not closed.
[[noreturn]] void fail_in_plain_words(const std::string& file, const std::string& text,
                                      const YAML::Exception& error, const Bounds& bounds) {
  std::istringstream lines(text);
  std::string line;
  for (int number = 0; number <= error.mark.line; ++number) std::getline(lines, line);
  const auto column = std::min(static_cast<std::size_t>(std::max(error.mark.column, 0)), line.size());
  auto mark = error.mark;
  if (const auto tab = line.find('\t'); tab != line.npos && line.find_first_not_of(" -") == tab) {
    mark.column = static_cast<int>(tab);
    fail_at(file, mark, "this line begins with a tab; YAML needs spaces ({})", error.msg);
  }
  const bool of_map = error.msg == YAML::ErrorMsg::END_OF_MAP_FLOW;
  const bool in_bracket = of_map || error.msg == YAML::ErrorMsg::END_OF_SEQ_FLOW;
  const bool has_key = line.find(": ") < column;
  // Below an open bracket, the next line's key ends the text of a value as well.
  const bool in_text =
      in_bracket && line.substr(column, 1) == ":" && bounds.innermost().line == error.mark.line;
  if ((error.msg == YAML::ErrorMsg::MAP_VALUE && has_key) || in_text)
    fail_at(file, mark, "a text with ': ' needs quotes, such as title: 'a: b'");
  if (error.msg == YAML::ErrorMsg::MAP_VALUE)
    fail_at(file, mark,
            "this line is read as part of the text above it. Fix: check its indentation, and that a space "
            "follows ':' or '-' above");
  if (in_bracket)
    fail_at(file, bounds.innermost(),
            "this {} is not closed: a {} or a comma is missing before line {}, column {}", of_map ? '{' : '[',
            of_map ? '}' : ']', mark.line + 1, mark.column + 1);
  if (column < line.size()) {
    const bool of_block = error.msg == YAML::ErrorMsg::END_OF_MAP || error.msg == YAML::ErrorMsg::END_OF_SEQ;
    if (const auto flaw = of_block ? flaw_of_block(line, column) : ""; !flaw.empty())
      fail_at(file, mark, "{}", flaw);
    if (error.msg == YAML::ErrorMsg::FLOW_END) fail_at(file, mark, "this {} closes nothing", line[column]);
  }
  fail_at(file, mark, "{}", error.msg);
}

}  // namespace

std::string meant_of(const std::string& key, const std::vector<std::string>& keys) {
  const auto meant = spelling::suggestion(key, keys);
  return meant.empty() ? fmt::format("; allowed keys: {}", fmt::join(keys, ", ")) : meant;
}

std::string scalar_of(const std::string& file, const YAML::Node& node, const std::string& key) {
  if (!node.IsScalar() || node.Scalar().empty())
    fail_at(file, node.Mark(), "{}: a value is needed here", key);
  return node.Scalar();
}

void once_each(const std::string& file, const YAML::Node& map) {
  std::set<std::string> seen;
  for (const auto& entry : map) {
    if (!entry.first.IsScalar()) fail_at(file, entry.first.Mark(), "a key must be a word");
    if (entry.first.Scalar() == "<<")
      fail_at(file, entry.first.Mark(),
              "merge keys (<<) are not supported. Fix: move keys that all runs share to `defaults`");
    if (!seen.insert(entry.first.Scalar()).second)
      fail_at(file, entry.first.Mark(), "'{}' occurs twice", entry.first.Scalar());
  }
}

void note_renamed(Notices& notices, const std::string& file, const YAML::Mark& mark,
                  const std::string& earlier, const std::string& current) {
  notices.emplace(earlier.substr(0, earlier.find('.')),
                  fmt::format("{}:{}:{}: '{}' is now called '{}'. This version reads both names.", file,
                              mark.line + 1, mark.column + 1, earlier, current));
}

std::string text_of(const std::string& file) {
  std::error_code none;
  const bool folder = fs::is_directory(file, none);
  std::ifstream in(file);
  if (folder || !in)
    throw Error(fmt::format("scenario {} cannot be read: {}", file,
                            std::generic_category().message(folder ? EISDIR : errno)));
  std::string text(most_bytes + 1, '\0');
  in.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(in.gcount()));
  if (text.size() > most_bytes) {
    const auto size = fs::is_regular_file(file, none) ? fs::file_size(file, none) : text.size();
    throw Error(fmt::format("scenario {} has {} bytes{}; at most {} are allowed: split the scenario", file,
                            size, fs::is_regular_file(file, none) ? "" : " or more", most_bytes));
  }
  return text;
}

YAML::Node document_of(const std::string& file, const std::string& text) {
  check_characters(file, text);
  check_quotes(file, text);
  Bounds bounds;
  try {
    parse(text, bounds);
    return YAML::Load(text);
  } catch (const YAML::Exception& error) {
    fail_in_plain_words(file, text, error, bounds);
  }
}

}  // namespace ontime::scenario

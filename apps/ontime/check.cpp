// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <functional>

#include <fmt/format.h>

#include "commands.hpp"
#include "fitness/fitness.hpp"
#include "flags.hpp"
#include "machine/machine.hpp"
#include "output.hpp"
#include "table/table.hpp"
#include "terminal.hpp"

namespace ontime::app {
namespace {

using fitness::Finding;
using fitness::Severity;
using table::printable;

// Not a command alone, which stays on its line, so that it can be copied.
bool is_prose(const std::string& remedy) {
  return remedy.find('\n') == remedy.npos &&
         (remedy.find("; ") != remedy.npos || remedy.find(": ") != remedy.npos ||
          remedy.find(", ") != remedy.npos);
}

std::string text_of(const Finding& finding, std::size_t columns) {
  const bool narrow = columns < table::fewest_for_two, fine = finding.severity == Severity::fine;
  const std::string mark = fine ? "" : fitness::word_of(finding.severity);
  const std::string below(narrow ? 2 : 10, ' ');
  const auto found = finding.check + ": " + printable(finding.is);
  auto text = narrow && !fine ? table::wrapped(mark + " " + found, columns)
                              : table::wrapped(found, columns, std::string(narrow ? 2 : 8, ' '));
  if (!narrow) text.replace(0, mark.size(), mark);
  for (const auto& [label, words] : {std::pair{"should be", finding.should}, {"because", finding.why}})
    if (!words.empty())
      text += table::wrapped(fmt::format("{}: {}", label, printable(words)), columns, below);
  if (finding.remedy.empty()) return text;
  const auto fix = "fix: " + table::printable_lines(finding.remedy);
  return text + (is_prose(finding.remedy) ? table::wrapped(fix, columns, below) : below + fix + "\n");
}

nlohmann::json json_of(const Finding& finding) {
  // The old names of `level` and `fix`, for one version.
  static constexpr const char* severities[] = {"fine", "hint", "wrong"};
  return {{"check", finding.check},
          {"level", fitness::word_of(finding.severity)},
          {"severity", severities[static_cast<std::size_t>(finding.severity)]},
          {"is", finding.is},
          {"should_be", finding.should},
          {"because", finding.why},
          {"fix", finding.remedy},
          {"to_mend_it", finding.remedy}};
}

// The names of the checks with errors, each once.
std::string errors_of(const std::vector<Finding>& findings) {
  std::vector<std::string> names;
  for (const auto& finding : findings)
    if (finding.severity == Severity::wrong && std::ranges::find(names, finding.check) == names.end())
      names.push_back(finding.check);
  return table::join(names, ", ");
}

int print_findings(std::vector<Finding> findings, bool as_json) {
  const bool fit = fitness::fit(findings);
  if (as_json) {
    auto all = nlohmann::json::array();
    for (const auto& finding : findings) all.push_back(json_of(finding));
    print_json(nlohmann::json{{"fit", fit}, {"findings", all}});
    return fit ? 0 : 1;
  }
  const auto columns = output_columns();
  std::ranges::stable_sort(findings, std::greater(), &Finding::severity);
  for (const auto& finding : findings) print(text_of(finding, columns));
  const auto warnings =
      static_cast<std::uint64_t>(std::ranges::count(findings, Severity::hint, &Finding::severity));
  print(table::wrapped(
      fit ? "OK: " + fitness::counts_of(findings)
          : fmt::format("not OK: {}; {}", errors_of(findings), table::many(warnings, "warning", "warnings")),
      columns));
  return fit ? 0 : 1;
}

}  // namespace

void add_check(Command& app) {
  auto* command =
      app.add_subcommand("check", "Checks whether this machine is ready for real-time, and shows the fixes");
  command->footer("Exit codes: 0 no errors · 1 errors prevent real-time · 2 invalid usage");
  struct Arguments {
    std::string interface, peer, format = "table";
  };
  auto arguments = std::make_shared<Arguments>();
  add_link(*command, arguments->interface, arguments->peer,
           "check this interface (default: all hardware interfaces)");
  add_format(*command, arguments->format);
  command->calls([arguments] {
    const bool as_json = is_json_flag(arguments->format);
    fitness::Subject subject;
    if (!arguments->peer.empty()) subject.interfaces = {machine::interface_to(arguments->peer, "")};
    if (!arguments->interface.empty()) {
      if (std::ranges::none_of(machine::interfaces(),
                               [&](const auto& one) { return one.name == arguments->interface; }))
        throw wrong("--interface: this machine has no interface {}", arguments->interface);
      subject.interfaces = {arguments->interface};
    }
    return print_findings(fitness::check(subject), as_json);
  });
}

}  // namespace ontime::app

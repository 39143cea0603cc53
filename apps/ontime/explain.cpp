// SPDX-License-Identifier: Apache-2.0
#include "explain/explain.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "chosen_runs.hpp"
#include "commands.hpp"
#include "flags.hpp"
#include "listen_results.hpp"
#include "output.hpp"
#include "report/explained.hpp"

namespace ontime::app {
namespace {

struct ExplainArguments {
  std::string results, format = "table", perfetto, pong;
  std::vector<std::string> only;
  std::optional<std::int64_t> message;
};

orders::Error without_traces(const report::Explained& one) {
  return wrong("run {} has no traces. Fix: measure with --explain", one.run.number);
}

const explain::Message& message_of(const report::Explained& one, std::int64_t index) {
  const auto& messages = one.account.messages;
  const auto found = std::ranges::find_if(messages, [&](const auto& message) {
    return static_cast<std::int64_t>(message.sample.index) == index;
  });
  if (messages.empty()) throw without_traces(one);
  if (found == messages.end())
    throw wrong(
        "--message: message {} has no trace. This run has traces of its {} worst messages (--format json "
        "lists them)",
        index, messages.size());
  return *found;
}

void write_perfetto(const ExplainArguments& arguments, const record::Reader& reader,
                    const report::Explained& one, const explain::Pong* pong) {
  const auto messages =
      arguments.message ? std::vector{message_of(one, *arguments.message)} : one.account.messages;
  if (messages.empty()) throw without_traces(one);
  write_whole(arguments.perfetto, report::perfetto_of(reader, one.run, messages, pong), Kind::json);
}

int explain(const ExplainArguments& arguments) {
  using report::Format;
  const auto format =
      word_flag<Format>("--format", arguments.format,
                        {{"table", Format::table}, {"json", Format::json}, {"markdown", Format::markdown}});
  const record::Reader reader(arguments.results);
  const auto runs = chosen_runs(reader, arguments.results, arguments.only);
  if (const char* const flag = arguments.message             ? "--message"
                               : !arguments.perfetto.empty() ? "--perfetto"
                               : !arguments.pong.empty()     ? "--pong"
                                                             : nullptr;
      flag != nullptr && runs.size() != 1)
    throw wrong("{} needs one run, but {} are selected. Fix: add --only RUN", flag, runs.size());
  std::vector<report::Explained> all;
  all.reserve(runs.size());
  std::optional<explain::Pong> pong;
  if (!arguments.pong.empty()) pong.emplace(record::Reader(arguments.pong), reader, runs.front());
  for (const auto& run : runs)
    all.push_back({run, explain::account_of(reader, run, pong ? &*pong : nullptr), notes_of(reader, run)});
  if (!arguments.perfetto.empty()) write_perfetto(arguments, reader, all.front(), pong ? &*pong : nullptr);
  const auto columns = output_columns();
  write_whole("", arguments.message
                      ? report::render_explained(all.front(), message_of(all.front(), *arguments.message),
                                                 format, columns)
                      : report::render_explained(all, format, columns));
  return 0;
}

}  // namespace

void add_explain(Command& app) {
  auto* command = app.add_subcommand(
      "explain", "Explains why messages were late or lost, with fixes, for runs with `explain: on`");
  auto arguments = std::make_shared<ExplainArguments>();
  command->add_option("RESULTS", arguments->results, "a results file")->required();
  add_only(*command, arguments->only, ",--run");
  command->add_option("--message", arguments->message, "show each part of this message's delay", "N");
  add_file(*command, "--pong", arguments->pong,
           "traces from the other machine, recorded by `ontime pong --explain --results FILE`");
  command->add_option("--format", arguments->format, "table, json or markdown (default: table)", "FORMAT");
  add_file(*command, "--perfetto", arguments->perfetto,
           "write the traces of these messages to this file, for ui.perfetto.dev");
  command->calls([arguments] { return explain(*arguments); });
}

}  // namespace ontime::app

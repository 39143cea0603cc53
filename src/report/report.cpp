// SPDX-License-Identifier: Apache-2.0
#include "report/report.hpp"

#include "report/page.hpp"
#include "report/runs.hpp"

namespace ontime::report {
namespace {

std::string text_of(const nlohmann::ordered_json& value) {
  return value.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

std::string page_text(const Page& page, Format format) {
  switch (format) {
    case Format::markdown:
      return as_markdown(page);
    case Format::latex:
      return as_latex(page);
    default:
      return as_text(page);
  }
}

}  // namespace

std::optional<Format> format_of(const std::string& word) {
  if (word == "table") return Format::table;
  if (word == "json") return Format::json;
  if (word == "csv") return Format::csv;
  if (word == "markdown") return Format::markdown;
  if (word == "latex") return Format::latex;
  return std::nullopt;
}

std::string render(const Summaries& summaries, Format format) {
  if (format == Format::csv) return csv_of(summaries);
  if (format != Format::json) return page_text(page_of(summaries), format);
  auto runs = nlohmann::ordered_json::array();
  for (const auto& summary : summaries) runs.push_back(json_of(summary));
  return text_of({{"ontime", ONTIME_VERSION}, {"runs", runs}});
}

std::string render_threads(const Summaries& summaries, Format format) {
  if (format == Format::csv) return threads_csv_of(summaries);
  if (format == Format::json) return text_of(threads_json_of(summaries));
  return page_text(threads_page_of(summaries), format);
}

std::string render_layers(const Summaries& summaries, Format format) {
  if (format == Format::json) return text_of(layers_json_of(summaries));
  const auto page = layers_page_of(summaries);
  if (format != Format::csv) return page_text(page, format);
  if (page.tables.empty()) return "";
  return as_csv(names_of(page.tables.front()), page.tables.front().rows);
}

}  // namespace ontime::report

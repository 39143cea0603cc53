// SPDX-License-Identifier: Apache-2.0
#include "report/report.hpp"

#include "report/comparison.hpp"
#include "report/runs.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

std::string page_text(const Page& unchecked, Format format, std::size_t width) {
  const auto page = format == Format::table ? printable(unchecked) : without_drawings(printable(unchecked));
  return format == Format::markdown ? as_markdown(page)
         : format == Format::latex  ? as_latex(page)
         : format == Format::html   ? as_html(page)
                                    : as_text(page, width);
}

}  // namespace

std::string render(const Summaries& summaries, Format format, const Origin& origin, std::size_t width) {
  if (format == Format::csv) return csv_of(summaries, origin.running_from);
  if (format != Format::json) return page_text(page_of(summaries, origin.running_from), format, width);
  return json_text(nlohmann::ordered_json{
      {"ontime", ONTIME_VERSION},
      {"answer", json_of(answer_of(summaries, origin))},
      {"runs",
       array_of(summaries, [&](const auto& summary) { return json_of(summary, origin.running_from); })},
      {"searches", searches_json_of(summaries)}});
}

std::string render_answer(const Summaries& summaries, Format format, const Origin& origin,
                          std::size_t width) {
  return format == Format::table ? text_of(answer_of(summaries, origin), width)
                                 : render(summaries, format, origin, width);
}

std::string render(const Comparison& comparison, const std::vector<gate::Judgement>& judgements,
                   Format format, std::size_t width) {
  if (format == Format::json) return json_text(json_of(comparison, judgements));
  if (format == Format::csv) return csv_of(comparison);
  return page_text(page_of(comparison, judgements), format, width);
}

std::string render_threads(const Summaries& summaries, Format format, std::size_t width) {
  if (format == Format::csv) return threads_csv_of(summaries);
  if (format == Format::json) return json_text(threads_json_of(summaries));
  return page_text(threads_page_of(summaries), format, width);
}

std::string render_layers(const Summaries& summaries, Format format, std::size_t width) {
  if (format == Format::json) return json_text(layers_json_of(summaries));
  if (format == Format::csv) return layers_csv_of(summaries);
  return page_text(layers_page_of(summaries), format, width);
}

}  // namespace ontime::report

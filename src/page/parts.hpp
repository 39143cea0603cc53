// SPDX-License-Identifier: Apache-2.0
// What web/*.js draw, as data, and why messages were late, as markup.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include <nlohmann/json.hpp>

#include "explain/explain.hpp"
#include "record/record.hpp"
#include "report/runs.hpp"

namespace ontime::page {

using namespace report;  // a page shows what report says

// The scripts of a page: the files in web/, and D3 as Debian has it. CMake puts them in.
namespace web {
extern const std::string_view course, figures, time_plot, way;  // *.js
extern const std::string_view d3, d3_licence;
}  // namespace web

// Of web/figures.js and web/time_plot.js. Reads the samples.
nlohmann::json figures_of(const record::Reader&, const Summaries&);

// What web/way.js draws of a message's path: {"span_ns", "marks": [[name, ns] …], "stages": [[name,
// from, to, is the culprit's] …], "lanes": [{"of": "thread" | "cpu" | "packet", "end", "name", "bars":
// [[from, to, look, name, is the culprit's] …]} …], "names", "uncertainty_ns"}; times are after the begin of
// what is shown. Bounded: the most involved CPUs, a dozen threads; bars that are too short to be seen are
// joined, more of them the more there are. null: still too much.
inline constexpr std::size_t most_of_a_drawing = 25'000;  // bytes
nlohmann::json drawing_of(const explain::Message&, const explain::Scene&, std::int64_t deadline_ns);

// For a run with `explain: on`: each culprit's share, and the figures of its worst messages, which draw
// `drawings` from `first_drawing` on, or a note that they are not drawn. Empty for other runs.
struct Why {
  std::string html;
  std::vector<nlohmann::json> drawings;
};
// Commands to paste name the results `file`.
Why why_of(const record::Reader&, const record::Run&, const std::string& file, std::size_t first_drawing,
           std::size_t most_drawings);

}  // namespace ontime::page

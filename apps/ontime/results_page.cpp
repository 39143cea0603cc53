// SPDX-License-Identifier: Apache-2.0
#include "results_page.hpp"

#include <filesystem>
#include <fstream>
#include <system_error>

#include <fmt/format.h>

#include "campaign/campaign.hpp"
#include "output.hpp"
#include "page/page.hpp"

namespace ontime::app {
namespace {

namespace fs = std::filesystem;

bool is_a_page(const std::string& path) {
  std::error_code none;
  if (!fs::is_regular_file(path, none)) return false;
  std::string beginning(1024, '\0');
  std::ifstream(path, std::ios::binary)
      .read(beginning.data(), static_cast<std::streamsize>(beginning.size()));
  return beginning.find("<meta name=\"generator\" content=\"ontime") != std::string::npos;
}

}  // namespace

std::string write_page_beside(const std::string& results, const record::Reader& reader,
                              const std::vector<statistics::Summary>& summaries) {
  const bool is_usual = fs::path(results).extension() == ".ontime";  // "day.1" and "day.2" have a page each
  auto path = is_usual ? fs::path(results).replace_extension("html").string() : results + ".html";
  std::error_code none;
  if (fs::exists(path, none) && !is_a_page(path))
    throw campaign::Error(
        2, fmt::format("{} is there and no page of ontime's. Name another: ontime report {} --format "
                       "html --output FILE",
                       path, results));
  Output output(path);
  output.write(page::page_of(reader, summaries, fs::path(results).filename().string()));
  output.finish();
  return path;
}

}  // namespace ontime::app

// SPDX-License-Identifier: Apache-2.0
#include "report/html.hpp"

#include <array>

#include <fmt/format.h>
#include <sodium.h>

#include "report/web.hpp"
#include "report/words.hpp"

namespace ontime::report {
namespace {

// As a content security policy names a script or a style.
std::string hash_of(std::string_view text) {
  std::array<unsigned char, crypto_hash_sha256_BYTES> hash;
  crypto_hash_sha256(hash.data(), reinterpret_cast<const unsigned char*>(text.data()), text.size());
  constexpr int variant = sodium_base64_VARIANT_ORIGINAL;
  std::array<char, sodium_base64_ENCODED_LEN(crypto_hash_sha256_BYTES, variant)> base64;
  sodium_bin2base64(base64.data(), base64.size(), hash.data(), hash.size(), variant);
  return fmt::format("'sha256-{}'", base64.data());
}

// Within <script type="application/json"> nothing ends the element, whatever the texts are.
std::string text_of(const nlohmann::json& data) {
  return replace_all(data.dump(-1, ' ', true, nlohmann::json::error_handler_t::replace), "<", "\\u003c");
}

}  // namespace

std::string as_html(const Page& page) {
  std::string body = "<main>\n";
  for (const auto& table : page.tables) body += as_html(table);
  for (const auto& note : page.notes) body += note_as_html(note);
  if (!page.legend.empty()) body += note_as_html(page.legend);
  return standing_alone("ontime", body + "</main>\n");
}

std::string standing_alone(const std::string& title, const std::string& body, const nlohmann::json& data) {
  std::string scripts, hashes;
  if (!data.is_null()) {
    scripts += "<script type=\"application/json\" id=\"data\">" + text_of(data) + "</script>\n";
    scripts += fmt::format("<!--\n{}-->\n", web::d3_licence);
    for (const auto script : {web::d3, web::course, web::figures, web::way, web::time_plot}) {
      scripts += fmt::format("<script>{}</script>\n", script);
      hashes += " " + hash_of(script);
    }
  }
  return fmt::format(R"(<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="generator" content="ontime {}">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; script-src{}; style-src {}; img-src blob:; base-uri 'none'; form-action 'none'">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{}</title>
<style>{}</style>
</head>
<body>
{}{}</body>
</html>
)",
                     ONTIME_VERSION, hashes.empty() ? " 'none'" : hashes, hash_of(web::style), escaped(title),
                     web::style, body, scripts);
}

}  // namespace ontime::report

// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <utility>

#include <fmt/format.h>
#include <sodium.h>

#include "table/table.hpp"

namespace ontime::table {
namespace {

std::string cells_of(const std::vector<std::string>& row, const std::vector<Column>& columns) {
  std::string text;
  for (std::size_t i = 0; i < row.size(); ++i) {
    if (columns[i].drawn) continue;
    const bool left = columns[i].align == Column::Align::left;
    text += i == 0 ? fmt::format("<th scope=\"row\">{}</th>", escaped(row[i]))
                   : fmt::format("<td{}>{}</td>", left ? "" : " class=\"number\"", escaped(row[i]));
  }
  return "<tr>" + text + "</tr>\n";
}

// As a content security policy names a script or a style.
std::string hash_of(std::string_view text) {
  std::array<unsigned char, crypto_hash_sha256_BYTES> hash;
  crypto_hash_sha256(hash.data(), reinterpret_cast<const unsigned char*>(text.data()), text.size());
  constexpr int variant = sodium_base64_VARIANT_ORIGINAL;
  std::array<char, sodium_base64_ENCODED_LEN(crypto_hash_sha256_BYTES, variant)> base64;
  sodium_bin2base64(base64.data(), base64.size(), hash.data(), hash.size(), variant);
  return fmt::format("'sha256-{}'", base64.data());
}

}  // namespace

std::string escaped(const std::string& text) {
  auto result = printable(text);
  for (const auto& [sign, entity] :
       {std::pair{"&", "&amp;"}, {"<", "&lt;"}, {">", "&gt;"}, {"\"", "&quot;"}, {"'", "&#39;"}})
    result = replace_all(std::move(result), sign, entity);
  return result;
}

std::string escaped_lines(const std::string& text) {
  return join(texts_of(split(text, '\n'), escaped), "\n");
}

std::string note_as_html(const std::string& note) {
  return "<p class=\"note\">" + escaped_lines(note) + "</p>\n";
}

std::string as_html(const Table& table) {
  std::string text = "<div class=\"wide\" tabindex=\"0\" role=\"region\" aria-label=\"" +
                     escaped(table.title) + "\">\n<table>\n<caption>" + escaped(table.title) +
                     "</caption>\n<thead><tr>";
  for (const auto& column : table.columns)
    if (!column.drawn)
      text +=
          fmt::format("<th scope=\"col\"{}>{}</th>",
                      column.align == Column::Align::left ? "" : " class=\"number\"", escaped(column.name));
  text += "</tr></thead>\n<tbody>\n";
  for (const auto& row : table.rows) text += cells_of(row, table.columns);
  text += "</tbody>\n</table>\n</div>\n";
  if (!table.conditions.empty()) text = "<p>" + escaped(table.conditions) + "</p>\n" + text;
  for (const auto& note : table.notes) text += note_as_html(note);
  return text;
}

std::string as_html(const Page& page) {
  std::string body = "<main>\n";
  for (const auto& table : page.tables) body += as_html(table);
  for (const auto& note : page.notes) body += note_as_html(note);
  if (!page.legend.empty()) body += note_as_html(page.legend);
  return standing_alone("ontime", body + "</main>\n");
}

std::string standing_alone(const std::string& title, const std::string& body,
                           const std::vector<std::string_view>& scripts) {
  std::string elements, hashes;
  for (const auto script : scripts) {
    elements += fmt::format("<script>{}</script>\n", script);
    hashes += " " + hash_of(script);
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
                     ONTIME_VERSION, hashes.empty() ? " 'none'" : hashes, hash_of(style), escaped(title),
                     style, body, elements);
}

}  // namespace ontime::table

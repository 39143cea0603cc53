// SPDX-License-Identifier: Apache-2.0
#include "transport/xml.hpp"

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <fstream>
#include <iomanip>
#include <iterator>
#include <sstream>
#include <system_error>

#include <boost/property_tree/xml_parser.hpp>

#include "transport/transport.hpp"

namespace ontime::transport::xml {

using boost::algorithm::iequals;
namespace reader = boost::property_tree::xml_parser;

namespace {

// 48 bits of FNV-1a: enough to tell the texts of one user apart.
std::string hash_of(const std::string& text) {
  std::uint64_t hash = 0xcbf29ce484222325;
  for (const char byte : text) hash = (hash ^ static_cast<unsigned char>(byte)) * 0x100000001b3;
  std::ostringstream out;
  out << std::hex << std::setw(12) << std::setfill('0') << (hash >> 16U);
  return out.str();
}

}  // namespace

Document parse(std::istream& in, const std::string& origin, const std::string& who) {
  const std::string text{std::istreambuf_iterator<char>(in), {}};
  std::istringstream again(text);
  try {
    Document document{origin, {}, hash_of(text)};
    read_xml(again, document.tree, reader::no_comments | reader::trim_whitespace);
    return document;
  } catch (const reader::xml_parser_error& error) {
    throw Error(who + ": " + origin + ", line " + std::to_string(error.line()) + ": " + error.message());
  }
}

Document parse_file(const std::string& path, const std::string& named_by, const std::string& who) {
  std::ifstream in(path);
  // A folder can be opened, but not read. Of it, and of an empty file, the reader of XML has no plain words.
  in.peek();
  if (!in.good())
    throw Error(who + ": cannot open the configuration " + path + ", named by " + named_by + ": " +
                (in.eof() ? "it is empty" : std::generic_category().message(errno)));
  return parse(in, path, who);
}

std::string text_of(const Tree& tree) {
  std::ostringstream out;
  write_xml(out, tree);
  return out.str();
}

bool erase(Tree& tree, std::initializer_list<const char*> names) {
  return erase_if(tree, [&](const std::string& name, const Tree&) {
    return std::ranges::any_of(names, [&](const char* one) { return iequals(name, one); });
  });
}

bool has(const Tree& tree, const std::string& element) {
  bool found = false;
  for_each_element(tree, [&](const std::string& name, const Tree&) { found |= iequals(name, element); });
  return found;
}

std::string child_text(const Tree& tree, const std::string& element) {
  for (const auto& [name, child] : tree)
    if (iequals(name, element)) return child.data();
  return {};
}

void refuse(const Document& document, std::initializer_list<Forbidden> forbidden, const std::string& who,
            const std::string& instead) {
  for_each_element(document.tree, [&](const std::string& name, const Tree& element) {
    for (const Forbidden& one : forbidden) {
      if (!iequals(name, one.element) || (one.only != nullptr && !iequals(element.data(), one.only)))
        continue;
      std::string text = who;
      text.append(": ").append(document.origin).append(" has <").append(one.element);
      text.append(">, which ").append(one.does).append(": not permitted in an option of a scenario");
      throw WrongInput(text.append(". Fix: put it into ").append(instead));
    }
  });
}

}  // namespace ontime::transport::xml

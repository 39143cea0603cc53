// SPDX-License-Identifier: Apache-2.0
// The users' XML of the DDS vendors, read and changed before the vendor gets it. Names of elements are
// compared as Cyclone DDS does, without regard to case.
#pragma once

#include <istream>
#include <string>

#include <boost/algorithm/string/predicate.hpp>
#include <boost/property_tree/ptree.hpp>

namespace ontime::transport::xml {

using Tree = boost::property_tree::ptree;

struct Document {
  std::string origin;  // for people: a file, or a variable
  Tree tree;
  std::string hash = {};  // of its text
  // "/home/me/cyclonedds.xml (content 1a2b3c4d5e6f)": the same file may have another content in another run.
  std::string source() const { return origin + " (content " + hash + ")"; }
};

// Both throw Error that begins with `who` and names the origin: the line that is not XML, or the missing file
// and what named it.
Document parse(std::istream& in, const std::string& origin, const std::string& who);
Document parse_file(const std::string& path, const std::string& named_by, const std::string& who);
std::string text_of(const Tree& tree);

template <typename Visit>
void for_each_element(const Tree& tree, const Visit& visit) {
  for (const auto& [name, child] : tree) {
    visit(name, child);
    for_each_element(child, visit);
  }
}

// Erases elements for which `unwanted(name, element)` is true, and returns whether any existed.
template <typename Unwanted>
bool erase_if(Tree& tree, const Unwanted& unwanted) {
  bool erased = false;
  for (auto it = tree.begin(); it != tree.end();) {
    if (unwanted(it->first, it->second)) {
      it = tree.erase(it);
      erased = true;
    } else {
      erased |= erase_if(it->second, unwanted);
      ++it;
    }
  }
  return erased;
}

bool erase(Tree& tree, std::initializer_list<const char*> names);  // the elements of these names
bool has(const Tree& tree, const std::string& element);
std::string child_text(const Tree& tree, const std::string& element);  // empty if there is no such child

// A part of the XML that only the user's own settings may have, not a scenario.
struct Forbidden {
  const char* element;
  const char* does;            // "writes files"
  const char* only = nullptr;  // only if this is its text
};
// Throws WrongInput with the fix: put it into `instead`.
void refuse(const Document& document, std::initializer_list<Forbidden> forbidden, const std::string& who,
            const std::string& instead);

}  // namespace ontime::transport::xml

// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <sstream>

#include <boost/property_tree/ptree.hpp>
#include <boost/property_tree/xml_parser.hpp>

#include "report/report.hpp"
#include "report/words.hpp"

namespace ontime::report {

using boost::property_tree::ptree;
using gate::Judgement;

std::string junit(const std::vector<Judgement>& judgements) {
  const auto count = [&](Judgement::Result result) {
    return std::ranges::count_if(judgements,
                                 [&](const Judgement& judgement) { return judgement.result == result; });
  };
  ptree suite;
  const auto add_counts = [&](ptree& to) {
    to.put("<xmlattr>.tests", judgements.size());
    to.put("<xmlattr>.failures", count(Judgement::Result::missed));
    to.put("<xmlattr>.errors", count(Judgement::Result::cannot_judge));
  };
  suite.put("<xmlattr>.name", "ontime");
  add_counts(suite);
  suite.put("<xmlattr>.skipped", 0);
  suite.put("<xmlattr>.time", 0);
  for (const auto& judgement : judgements) {
    ptree test;  // what XML has no characters for is not printable either
    test.put("<xmlattr>.classname", printable(judgement.run));
    test.put("<xmlattr>.name", printable(judgement.gate));
    test.put("<xmlattr>.time", 0);
    const auto says = printable(judgement.says);
    if (judgement.result == Judgement::Result::held) {
      test.put("system-out", says);
    } else {
      const bool missed = judgement.result == Judgement::Result::missed;
      ptree why;
      why.put("<xmlattr>.message", says);
      why.put("<xmlattr>.type", missed ? "missed" : "cannot-judge");
      test.add_child(missed ? "failure" : "error", why);
    }
    suite.add_child("testcase", test);
  }
  ptree suites;
  suites.put("<xmlattr>.name", "ontime");
  add_counts(suites);
  suites.add_child("testsuite", suite);
  ptree document;
  document.add_child("testsuites", suites);
  std::ostringstream text;
  write_xml(text, document, boost::property_tree::xml_writer_make_settings<std::string>(' ', 2));
  return text.str() + "\n";
}

}  // namespace ontime::report

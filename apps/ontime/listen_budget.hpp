// SPDX-License-Identifier: Apache-2.0
// `ontime listen --budget 1%`: limits probes and ontime to a share of one CPU, and reports what it left out.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include <nlohmann/json.hpp>

#include "listen/budget.hpp"
#include "listen/listen.hpp"

namespace ontime::app {

class ListenBudget {
 public:
  // "1%": of one CPU. Throws campaign::Error{2}.
  explicit ListenBudget(const std::string& text);

  // CPU time before this call, such as of the start, does not count.
  void begin(const listen::Sensor&, bool records_kernel_events);
  // Call it often after begin().
  void keep(listen::Sensor&, std::unique_ptr<listen::Explainer>&);

  std::string text() const;
  std::string of_pauses() const;  // which share of the time was listened to; "" without pauses
  nlohmann::ordered_json json() const;

 private:
  double share_ = 0;
  bool measures_probes_ = true, dropped_kernel_events_ = false;
  std::optional<listen::Budget> budget_;
};

}  // namespace ontime::app

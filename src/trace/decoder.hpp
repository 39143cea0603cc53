// SPDX-License-Identifier: Apache-2.0
// The tracepoints that we want of a kernel, as far as it has them, and what their bytes mean, by its own
// description of them.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "trace/ring.hpp"
#include "trace/trace.hpp"
#include "trace/tracefs.hpp"

struct tep_event;
struct tep_handle;

namespace ontime::trace {

class Decoder {
 public:
  explicit Decoder(const Tracefs&);  // throws Error if the kernel lacks an indispensable tracepoint

  // What makes an instance record them: to be written to its files, in this order.
  struct Setting {
    std::string file, text;
  };
  const std::vector<Setting>& settings() const { return settings_; }
  const std::vector<std::string>& missing() const { return missing_; }

  std::optional<Kind> kind_of(const RawEvent&) const;
  // Packets are numbered as they are met, beginning anew with each map.
  using Packets = std::map<std::uint64_t, std::int32_t>;
  Event decode(const RawEvent&, Packets&);
  // Of a switch: less than decode() does.
  struct Switch {
    std::int32_t left, came;
    bool sleeps;  // who left waits to be woken
  };
  Switch switch_of(const RawEvent&) const;
  std::int32_t woken(const RawEvent&) const;    // or moved
  std::int32_t who_ran(const RawEvent&) const;  // who had the CPU; of a switch: who left it

 private:
  struct Field {
    int offset = -1, size = 0;
    bool is_signed = false, is_elsewhere = false;
  };
  struct Shape {
    Kind kind;
    tep_event* event;
    Field running, thread, name, priority, other, other_name, other_priority, what, packet, bytes, place;
  };
  const Shape* shape_of(const RawEvent&) const;
  static std::int64_t number(const Field&, const RawEvent&);
  static std::string text(const Field&, const RawEvent&);
  std::string what_of(const Shape&, const RawEvent&);
  std::string functions_of(const Shape&, const RawEvent&);
  const std::string& function_at(std::uint64_t address) const;  // of the kernel; "": none that it shows

  std::unique_ptr<tep_handle, void (*)(tep_handle*)> tep_;
  std::map<int, Shape> shapes_;  // by the id that the kernel gave
  std::vector<Setting> settings_;
  std::vector<std::string> missing_;
  std::vector<std::pair<std::uint64_t, std::string>> functions_;  // the kernel's, by where they begin
};

}  // namespace ontime::trace

// SPDX-License-Identifier: Apache-2.0
// Stores many values exactly in little memory. Values close together are counted; others take about two
// bytes, at most four. Negative values and those beyond 4.29 s take eight.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "statistics/statistics.hpp"
#include "statistics/wrapping.hpp"

namespace ontime::statistics {

// least, least + step …: `count` of them.
struct Series {
  // If the times overflow (a damaged file), all values equal the first.
  static Series of(std::int64_t least, std::int64_t step, std::uint64_t count);
  std::int64_t least, step;
  std::uint64_t count;
  std::int64_t greatest() const;
  std::uint64_t at_most(std::int64_t value) const;
  double sum() const;
};

class Values {
 public:
  static constexpr std::uint64_t short_series = 16;  // a shorter series takes less memory as single values
  void add(std::int64_t value);
  void add_series(const Series&);  // in the memory of one value
  std::uint64_t count() const { return count_; }

 private:
  friend class Ranks;
  // Values that have all but their lowest 16 bits in common: a list of those, or, once that is the shorter
  // form, how many there are of each.
  struct Page {
    std::vector<std::uint16_t> low;
    std::unique_ptr<std::uint32_t[]> counts;
  };
  static constexpr std::size_t pages_a_block = 256;
  using Block = std::array<Page, pages_a_block>;
  void place(std::int64_t value);

  std::array<std::unique_ptr<Block>, 256> blocks_;
  std::vector<std::int64_t> wide_;
  std::vector<Series> series_;
  std::uint64_t count_ = 0;
  std::int64_t min_ = 0, max_ = 0;
  std::int64_t sum_ = 0;
  long double large_sum_ = 0;  // the part that did not fit in sum_
};

// Sorts only as far as the calls need.
class Ranks {
 public:
  explicit Ranks(Values);
  std::uint64_t count() const { return values_.count_; }
  std::uint64_t at_most(std::int64_t value);  // how many are no greater
  std::int64_t at_rank(std::uint64_t rank);   // from 1
  Distribution distribution();
  Histogram histogram();
  std::vector<Ranked> some();

 private:
  struct Filled {
    std::uint32_t high;
    Values::Page* page;
    std::uint64_t before;  // values below this page
    std::uint64_t size;
    bool in_order = false;
  };
  std::uint64_t narrow_at_most(std::int64_t value);

  Values values_;
  std::vector<Filled> pages_;  // those that hold something
};

}  // namespace ontime::statistics

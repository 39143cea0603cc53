// SPDX-License-Identifier: Apache-2.0
// ros2 run ontime_ros2 allocations: what each layer allocates for a round trip, on the client's side, as a
// table. Ends with 1 if ontime's own part is anything.
#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <string>
#include <thread>
#include <vector>

#include <unistd.h>

#include "counter.hpp"
#include "transport/transport.hpp"
#include "two_ends/two_ends.hpp"

namespace ontime::allocations {
namespace {

using namespace std::chrono_literals;
using transport::Error;

constexpr std::uint64_t warm_up = 200;
constexpr std::uint64_t messages = 1000;
constexpr std::size_t payload_bytes = 500;

#ifdef ONTIME_HAS_TLSF
constexpr const char* allocators[] = {"default", "tlsf", "pmr"};
constexpr const char* left_out = "";
#else
constexpr const char* allocators[] = {"default", "pmr"};
constexpr const char* left_out = "\nleft out: tlsf, for tlsf_cpp was not there when this was built\n";
#endif

struct Case {
  std::string rmw;
  std::string allocator;
};

transport::Config config_of(const Case& what, transport::Role role) {
  transport::Config config;
  config.role = role;
  config.max_payload_bytes = payload_bytes;
  config.interface = "lo";
  config.address = "127.0.0.1";
  config.domain = 77;
  config.options = {{"rmw", what.rmw}, {"allocator", what.allocator}, {"statistics", "off"}};
  return config;
}

struct Arrivals final : transport::Sink {
  void arrived(std::uint64_t sequence, std::span<std::byte>, std::int64_t) noexcept override {
    last = sequence;
    last.notify_one();
  }
  std::atomic<std::uint64_t> last{0};
};

bool answered(const Arrivals& arrivals, std::uint64_t sequence) {
  for (int i = 0; i < 1000 && arrivals.last != sequence; ++i) std::this_thread::sleep_for(100us);
  return arrivals.last == sequence;
}

Counts measure(const Case& what) {
  Arrivals arrivals;
  const auto endpoint = two_ends::plugin().open(config_of(what, transport::Role::client), arrivals);
  if (!two_ends::await_match(*endpoint)) throw Error("no match; seen: " + endpoint->seen());
  const std::vector<std::byte> payload(payload_bytes);
  std::uint64_t done = 0;
  for (std::uint64_t sequence = 1; done < warm_up + messages; ++sequence) {
    if (sequence > 2 * (warm_up + messages)) throw Error("too many messages were lost");
    if (done == warm_up) arm();
    if (endpoint->send(sequence, payload) && answered(arrivals, sequence)) ++done;
  }
  return disarm();
}

void print(const std::vector<Case>& cases, const std::vector<Counts>& results) {
  std::printf("allocations per round trip, client's side, %zu bytes, executor single\n\n%-22s", payload_bytes,
              "");
  for (const Case& what : cases) std::printf("%22s", what.rmw.c_str());
  std::printf("\n%-22s", "layer");
  for (const Case& what : cases) std::printf("%22s", what.allocator.c_str());
  std::printf("\n");
  for (std::size_t layer = 0; layer < layer_names.size(); ++layer) {
    std::printf("%-22s", layer_names[layer]);
    for (const Counts& counts : results)
      std::printf("%22.2f", static_cast<double>(counts[layer]) / static_cast<double>(messages));
    std::printf("\n");
  }
  std::printf("%s", left_out);
}

int run(const std::vector<std::string>& rmws) {
  std::vector<Case> cases;
  for (const auto& rmw : rmws)
    for (const char* allocator : allocators) cases.push_back({rmw, allocator});
  std::vector<Counts> results;
  std::vector<Case> measured;
  for (const Case& what : cases) {
    const two_ends::Child server(
        [&](int end, int) { two_ends::serve(config_of(what, transport::Role::server), end); });
    two_ends::Child client([&](int, int result) {
      const Counts counts = measure(what);
      if (write(result, counts.data(), sizeof counts) < 0) throw Error("no pipe");
    });
    const std::string result = client.result();
    Counts counts{};
    if (result.size() != sizeof counts) {
      std::fprintf(stderr, "allocations: %s\n", result.c_str());
      continue;
    }
    std::memcpy(counts.data(), result.data(), sizeof counts);
    measured.push_back(what);
    results.push_back(counts);
  }
  print(measured, results);
  bool nothing_of_ours = measured.size() == cases.size();
  for (const Counts& counts : results)
    nothing_of_ours &= counts[static_cast<std::size_t>(Layer::ontime)] == 0;
  return nothing_of_ours ? 0 : 1;
}

}  // namespace
}  // namespace ontime::allocations

int main(int argc, char** argv) {
  std::vector<std::string> rmws(argv + 1, argv + argc);
  ontime::two_ends::isolate();
  if (rmws.empty()) rmws = {"rmw_cyclonedds_cpp", "rmw_fastrtps_cpp"};
  return ontime::allocations::run(rmws);
}

// SPDX-License-Identifier: Apache-2.0
// A plain Cyclone DDS program that keeps its own account of each message, against which `ontime listen` is
// held.
//   listen_node publish TOPIC COUNT PERIOD_US LOG   begins at SIGUSR1; every 997th message waits 30 ms more
//   listen_node take TOPIC DEPTH PERIOD_US LOG      takes until it is ended: the first 200 as they come, then
//   every
//                                                   PERIOD_US (0: as they come)
//   listen_node relay TOPIC EVERY 0 LOG TO          publishes each message of such a number on topic TO
// What it does wrong meanwhile: fault.hpp.
// It uses the DDS domain that the environment names (LISTEN_NODE_DOMAIN). LOG has a line for each message
// (account.hpp).
#include <array>
#include <cstdlib>
#include <string>

#include <dds/dds.h>

#include "account.hpp"
#include "message.h"

namespace {

dds_entity_t checked(dds_entity_t entity) {
  if (entity < 0) {
    std::fprintf(stderr, "listen_node: %s\n", dds_strretcode(entity));
    std::exit(3);
  }
  return entity;
}

void publish(dds_entity_t writer, std::uint64_t count, std::chrono::microseconds period,
             std::vector<Line>& lines) {
  const auto has_reader = [&] {
    dds_publication_matched_status_t matched{};
    dds_get_publication_matched_status(writer, &matched);
    return matched.current_count > 0;
  };
  publish_each(count, period, lines, has_reader, [&, message = listen_test_Message{}](auto number) mutable {
    message.number = number;
    dds_write(writer, &message);
  });
}

// Writes to `onwards`, if it is not 0, each message of which the number is a multiple of `every`.
void take(dds_entity_t reader, std::chrono::microseconds period, std::vector<Line>& lines,
          dds_entity_t onwards = 0, std::uint64_t every = 1) {
  constexpr std::size_t most = 128;
  const auto condition = checked(dds_create_readcondition(reader, DDS_ANY_STATE));
  const auto waitset = checked(dds_create_waitset(dds_get_participant(reader)));
  dds_waitset_attach(waitset, condition, 0);
  std::array<void*, most> samples{};
  std::array<dds_sample_info_t, most> infos{};
  const auto wait = [&] { dds_waitset_wait(waitset, nullptr, 0, DDS_MSECS(100)); };
  take_each(period, lines, wait, [&] {
    // A relay takes one at a time, as an executor does.
    const auto count = dds_take(reader, samples.data(), infos.data(), most, onwards == 0 ? most : 1);
    const auto at_ns = now_ns();
    for (int i = 0; i < count; ++i) {
      if (!infos[static_cast<std::size_t>(i)].valid_data) continue;
      const auto* const message = static_cast<listen_test_Message*>(samples[static_cast<std::size_t>(i)]);
      lines.push_back({message->number, at_ns, infos[static_cast<std::size_t>(i)].source_timestamp});
      if (onwards != 0 && message->number % every == 0) dds_write(onwards, message);
    }
    if (count > 0) dds_return_loan(reader, samples.data(), count);
  });
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 6 && argc != 7) return 2;
  catch_signals();
  const bool publishes = std::string(argv[1]) == "publish";
  const char* const domain =
      std::getenv("LISTEN_NODE_DOMAIN");  // NOLINT(concurrency-mt-unsafe): before any thread
  const auto participant = checked(dds_create_participant(
      domain == nullptr ? DDS_DOMAIN_DEFAULT : static_cast<dds_domainid_t>(std::strtoul(domain, nullptr, 10)),
      nullptr, nullptr));
  const auto topic =
      checked(dds_create_topic(participant, &listen_test_Message_desc, argv[2], nullptr, nullptr));
  const std::unique_ptr<dds_qos_t, void (*)(dds_qos_t*)> qos(dds_create_qos(), dds_delete_qos);
  dds_qset_reliability(qos.get(), DDS_RELIABILITY_RELIABLE, DDS_SECS(10));
  const auto number = std::strtoull(argv[3], nullptr, 10);
  const std::chrono::microseconds period(std::strtoll(argv[4], nullptr, 10));
  const bool relays = argc == 7;
  dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST,
                   publishes || relays ? 1000 : static_cast<std::int32_t>(number));
  std::vector<Line> lines;
  if (publishes) {
    publish(checked(dds_create_writer(participant, topic, qos.get(), nullptr)), number, period, lines);
  } else {
    dds_entity_t onwards = 0;
    if (relays)
      onwards = checked(dds_create_writer(
          participant,
          checked(dds_create_topic(participant, &listen_test_Message_desc, argv[6], nullptr, nullptr)),
          qos.get(), nullptr));
    take(checked(dds_create_reader(participant, topic, qos.get(), nullptr)), period, lines, onwards, number);
  }
  write_log(argv[5], lines);
  dds_delete(participant);
  return 0;
}

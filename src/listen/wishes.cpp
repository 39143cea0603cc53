// SPDX-License-Identifier: Apache-2.0
#include "listen/wishes.hpp"

#include <bpf/libbpf.h>

#include "listen/event.h"
#include "listen/library.hpp"
#include "listen/listen.hpp"
#include "listen/probes.skel.h"

namespace ontime::listen {
namespace {

// rmw_publisher_t and rmw_subscription_t alike: implementation_identifier, data, topic_name.
constexpr std::uint64_t way_of_rmw = 2 * sizeof(void*) << ontime_cookie_topic;

}  // namespace

Wishes rcl_wishes() { return {{}, {"rcl_timer_call"}}; }

Wishes rmw_wishes(const probes_bpf& probes) {
  const auto& programs = probes.progs;
  const auto publish = [&](const char* function) {
    return Wish{.function = function, .on_call = programs.publish, .cookie = way_of_rmw};
  };
  const auto take = [&](const char* function, std::size_t info) {
    return Wish{function, programs.rmw_take, programs.rmw_taken, {.taken = 2, .info = info}, way_of_rmw};
  };
  return {{publish("rmw_publish"), publish("rmw_publish_serialized_message"),
           publish("rmw_publish_loaned_message"), take("rmw_take", Wish::none),
           take("rmw_take_serialized_message", Wish::none), take("rmw_take_with_info", 3),
           take("rmw_take_serialized_message_with_info", 3), take("rmw_take_loaned_message_with_info", 3)},
          {"rmw_wait", "rmw_take_request", "rmw_take_response"}};
}

Wishes cyclonedds_wishes(const probes_bpf& probes) {
  const auto& programs = probes.progs;
  const auto write = [&](const char* function) {
    return Wish{.function = function, .on_call = programs.dds_write, .cookie = ontime_cookie_is_below_rmw};
  };
  // dds_take(reader, samples, info, …), dds_takecdr(reader, samples, most, info, …)
  const auto take = [&](const char* function, std::size_t info) {
    return Wish{function, programs.dds_take, programs.dds_taken, {.info = info}, ontime_cookie_is_below_rmw};
  };
  return {
      {write("dds_write"), write("dds_write_ts"), write("dds_writecdr"), take("dds_take", 2),
       take("dds_take_mask", 2), take("dds_take_wl", 2), take("dds_take_next", 2), take("dds_takecdr", 3)},
      {"dds_waitset_wait"}};
}

// The library's code shows where writer and reader store their topic, and the size of an entity. In a topic,
// the description follows the entity, and has the name behind its table of virtual functions.
std::optional<Wishes> fastdds_wishes(const probes_bpf& probes, const std::string& path) {
  const auto& programs = probes.progs;
  const std::string scope = "8eprosima7fastdds3dds", writer = "_ZN" + scope + "14DataWriterImpl",
                    reader = "_ZN" + scope + "14DataReaderImpl",
                    handle = "RKNS_8fastrtps4rtps16InstanceHandle_tE",
                    collections =
                        "ERNS1_18LoanableCollectionERNS1_16LoanableSequenceINS1_10SampleInfoESt17integral_"
                        "constantIbLb1EEEEi";
  std::uint64_t of_writer = ontime_cookie_is_below_rmw, of_reader = of_writer;
  bool knows_topics = true;
  try {
    const auto write = writer + "5writeEPv", topic_of_entity = "_ZNK" + scope + "10DataWriter9get_topicEv",
               topic_of_writer = "_ZNK" + scope + "14DataWriterImpl9get_topicEv",
               topic_of_reader = "_ZNK" + scope + "14DataReaderImpl20get_topicdescriptionEv";
    const Library library(path, {write, topic_of_entity, topic_of_writer, topic_of_reader});
    if (!library.entry(write, {})) return {};
    const auto entity = offset_of_member(library.code(topic_of_entity)),
               written = offset_of_member(library.code(topic_of_writer)),
               read = offset_of_member(library.code(topic_of_reader));
    knows_topics = entity && written && read;
    if (knows_topics) {
      const auto way = [](std::uint64_t topic, std::uint64_t name) {
        return topic << ontime_cookie_topic | name << ontime_cookie_name;
      };
      of_writer |= way(*written, *entity + sizeof(void*));
      of_reader |= way(*read, sizeof(void*));
    }
  } catch (const Error&) {  // reported where probes are set
  }
  const auto write = [&](const std::string& function) {
    return Wish{.function = writer + function, .on_call = programs.publish, .cookie = of_writer};
  };
  const auto take = [&](const std::string& function) {
    return Wish{reader + function,
                programs.fastdds_take,
                programs.fastdds_taken,
                {.info = 2},
                of_reader,
                reader + "12read_or_take" + collections + handle + "tttbbb"};
  };
  const auto take_next = [&](const std::string& function) {
    return Wish{
        reader + function, programs.fastdds_take, programs.fastdds_taken_next, {.info = 2}, of_reader};
  };
  return Wishes{{write("5writeEPv"), write("5writeEPvRNS_8fastrtps4rtps11WriteParamsE"),
                 write("5writeEPv" + handle), write("17write_w_timestampEPv" + handle + "RKNS4_6Time_tE"),
                 take("4take" + collections + "ttt"), take("13take_instance" + collections + handle + "ttt"),
                 take("18take_next_instance" + collections + handle + "ttt"),
                 take_next("16take_next_sampleEPvPNS1_10SampleInfoE"),
                 take_next("16read_next_sampleEPvPNS1_10SampleInfoE")},
                {"_ZNK" + scope + "7WaitSet4waitERSt6vectorIPNS1_9ConditionESaIS5_EENS_8fastrtps6Time_tE",
                 "_ZN" + scope + "10DataReader23wait_for_unread_messageERKNS_8fastrtps6Time_tE"},
                knows_topics};
}

}  // namespace ontime::listen

// SPDX-License-Identifier: Apache-2.0
// The transport through rclcpp.
#include <atomic>
#include <exception>
#include <filesystem>
#include <functional>
#include <memory>
#include <thread>
#include <utility>
#include <vector>

#include <link.h>
#include <ontime_msgs/msg/round_trip.hpp>
#include <rclcpp/rclcpp.hpp>
#include <rclcpp/version.h>

#include "allocator.hpp"
#include "environment.hpp"
#include "graph.hpp"
#include "lead.hpp"
#include "others.hpp"
#include "publishing.hpp"
#include "spinning.hpp"
#include "statistics.hpp"
#include "subscribing.hpp"
#include "threads.hpp"
#include "transport/clock.hpp"
#include "transport/dds.hpp"
#include "waiting.hpp"

namespace ontime::transport::ros2 {

using ontime_msgs::msg::RoundTrip;

// Each has a participant.
std::shared_ptr<rclcpp::Context> new_context(int domain) {
  rclcpp::InitOptions options;
  options.set_domain_id(static_cast<std::size_t>(domain));
  options.auto_initialize_logging(false);  // which would open a file
  auto context = std::make_shared<rclcpp::Context>();
  context->init(0, nullptr, options);
  return context;
}

// Of both ends where they are in one process: rclcpp's shortcut is within a context.
std::shared_ptr<rclcpp::Context> context_of(int domain) {
  static std::weak_ptr<rclcpp::Context> last;
  if (auto context = last.lock(); context && context->get_domain_id() == static_cast<std::size_t>(domain))
    return context;
  auto context = new_context(domain);
  last = context;
  return context;
}

// "/robot" of "/robot/ping": a node lives where its topics do.
std::string namespace_of(const std::string& topic) { return topic.substr(0, topic.rfind('/')); }

rclcpp::NodeOptions node_options(const rclcpp::Context::SharedPtr& context, bool intra_process) {
  return rclcpp::NodeOptions()
      .context(context)
      .use_intra_process_comms(intra_process)
      .enable_rosout(false)
      .start_parameter_services(false)
      .start_parameter_event_publisher(false);
}

// The DDS under the RMW has no function that tells its version, but the file that was loaded has it in its
// name.
std::string loaded_middleware() {
  std::string name;
  dl_iterate_phdr(
      [](dl_phdr_info* info, std::size_t, void* found) {
        const std::string file = std::filesystem::path(info->dlpi_name).filename();
        if (!file.starts_with("libddsc.so") && !file.starts_with("libfastrtps.so") &&
            !file.starts_with("libfastdds.so"))
          return 0;
        std::error_code gone;
        *static_cast<std::string*>(found) = std::filesystem::canonical(info->dlpi_name, gone).filename();
        return 1;
      },
      &name);
  return name;
}

// What an endpoint may share with those beside it.
struct Seat {
  std::string settings_source, settings_carrier;
  std::vector<pid_t> created;  // threads, with its participant
  rclcpp::Context::SharedPtr context;
  rclcpp::Node::SharedPtr node;
  rclcpp::CallbackGroup::SharedPtr group;  // nullptr: the node's own
  std::shared_ptr<Spinning> spinning;      // nullptr: we wait ourselves
};

class RosEndpoint final : public Endpoint, private Arrivals {
 public:
  RosEndpoint(const Config& config, const Options& options, Sink& sink);
  RosEndpoint(const Config& config, const Options& options, Sink& sink, const Seat& first, Where where);
  ~RosEndpoint() override;

  std::unique_ptr<Endpoint> beside(const Config& config, Sink& sink, Where where) override;
  Matched matched() override;
  Losses losses() override { return losses_of(options_.rmw, *subscription_); }
  std::string seen() override {
    return ros2::seen(config_, *seat_.node, publishing_->publisher(), *subscription_, matched());
  }
  bool send(std::uint64_t sequence, std::span<const std::byte> payload) noexcept override;
  void receive() noexcept override;
  void interrupt() noexcept override;
  std::vector<Thread> threads() override;
  std::map<std::string, std::string> facts() override;

 private:
  void take_seat(Where where);
  void open_participant(rclcpp::Context::SharedPtr (*context)(int domain));
  void open_node(const std::function<std::string()>& said);
  void open_topics();
  void start_spinning(const char* name);
  void start_waiting();
  void wake_executor() noexcept;
  void on_message(const RoundTrip& message) override;
  void take_all();
  void arrived(RoundTrip& message, std::int64_t arrival_ns) noexcept;
  std::string carrier() const;

  const Config config_;
  const Options options_;
  Sink& sink_;
  Seat seat_;
  std::unique_ptr<Publishing> publishing_;
  rclcpp::SubscriptionBase::SharedPtr subscription_;
  std::unique_ptr<Graph> graph_;  // of the first; who is beside it asks only before the first message
  std::unique_ptr<Statistics> statistics_;
  RoundTrip incoming_;
  std::atomic<bool> interrupted_{false};
  std::unique_ptr<Waiting> waiting_;
};

RosEndpoint::RosEndpoint(const Config& config, const Options& options, Sink& sink)
    : config_(config), options_(options), sink_(sink) {
  incoming_.data.reserve(config.max_payload_bytes);
  const auto sockets_before = dds::sockets();
  open_participant(context_of);
  refuse_namesake(*seat_.node);
  open_topics();
  if (options.statistics && config.role == Role::client)
    statistics_ = std::make_unique<Statistics>(*seat_.node, config.deadline_ns);
  dds::keep_to_link(sockets_before, config, "ros2");
  graph_ = std::make_unique<Graph>(seat_.context, *seat_.node, publishing_->publisher(), *subscription_);
  if (config.receive == Receive::waitset) {
    start_waiting();
  } else {
    start_spinning(Spinning::thread_name);
    seat_.spinning->add(seat_.node);
  }
}

RosEndpoint::RosEndpoint(const Config& config, const Options& options, Sink& sink, const Seat& first,
                         Where where)
    : config_(config), options_(options_beside(options)), sink_(sink), seat_(first) {
  incoming_.data.reserve(config.max_payload_bytes);
  const auto sockets_before = dds::sockets();
  take_seat(where);
  open_topics();
  dds::keep_to_link(sockets_before, config, "ros2");
  if (config.receive == Receive::waitset) start_waiting();
}

// Of another's, as much as is shared.
void RosEndpoint::take_seat(Where where) {
  if (where == Where::same_callback_group) return;
  seat_.group.reset();
  const bool shares_executor = where == Where::same_node || where == Where::same_executor;
  const bool shares_node = where == Where::same_node || where == Where::own_executor;
  if (where == Where::same_process)
    open_participant(new_context);
  else if (!shares_node)
    open_node([] { return std::string(); });
  if (!seat_.spinning) return;
  if (!shares_executor) start_spinning(Spinning::name_beside);
  if (!shares_node) return seat_.spinning->add(seat_.node);
  seat_.group = seat_.node->create_callback_group(rclcpp::CallbackGroupType::MutuallyExclusive, false);
  seat_.spinning->add(seat_.group, seat_.node);
}

RosEndpoint::~RosEndpoint() {
  seat_.spinning.reset();  // the last of its endpoints: first, for it calls all the others
  waiting_.reset();
  graph_.reset();
  // An executor that goes on holds the subscription while it calls it. From Jazzy on it holds it while it
  // waits, too, and lets go only when it is woken.
  const std::weak_ptr<rclcpp::SubscriptionBase> held = subscription_;
  subscription_.reset();
  while (!held.expired()) {
    wake_executor();
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

// As rclcpp wakes it for a new subscription: by the node, or by a callback group that was added alone.
void RosEndpoint::wake_executor() noexcept {
  try {
    seat_.node->get_node_base_interface()->get_notify_guard_condition().trigger();
    if (seat_.group) seat_.group->trigger_notify_guard_condition();
  } catch (const std::exception&) {
    // It is not there to be woken; the caller tries again.
  }
}

Matched RosEndpoint::matched() {
  if (graph_) return graph_->matched();
  return {.readers = static_cast<int>(publishing_->publisher().get_subscription_count()),
          .writers = static_cast<int>(subscription_->get_publisher_count())};
}

// It comes with the first node of its context.
void RosEndpoint::open_participant(rclcpp::Context::SharedPtr (*context)(int)) {
  const auto before = dds::tasks();
  {
    const auto leading = lead(options_.rmw, config_);
    seat_.settings_source = leading->source;
    seat_.settings_carrier = leading->carrier;
    // See without_localhost_only(). Empty is unset; from Jazzy on any value, also "0", makes it warn.
    const dds::Override localhost_only("ROS_LOCALHOST_ONLY", "");
    seat_.context = context(config_.domain);
    open_node([&] { return leading->said(); });
  }
  seat_.created.clear();
  // An executor beside may start its threads meanwhile.
  for (const auto& task : dds::started_since(before))
    if (task.name != Spinning::thread_name) seat_.created.push_back(task.tid);
}

void RosEndpoint::open_node(const std::function<std::string()>& said) {
  try {
    seat_.node = std::make_shared<rclcpp::Node>(options_.node, namespace_of(config_.ping_topic),
                                                node_options(seat_.context, options_.intra_process));
  } catch (const rclcpp::exceptions::NameValidationError& error) {
    throw WrongInput("ros2: option node: " + std::string(error.what()));
  } catch (const std::exception& error) {
    const std::string why = said();
    throw Error("ros2: no node starts in domain " + std::to_string(config_.domain) + " on " + options_.rmw +
                " as configured by " + seat_.settings_source + ": " + (why.empty() ? error.what() : why));
  }
}

void RosEndpoint::open_topics() {
  // First, for the subscription's callback may call send() at once.
  publishing_ = new_publishing(config_, options_, *seat_.node);
  subscription_ = new_subscription(config_, options_, *seat_.node, seat_.group, *this);
}

void RosEndpoint::start_spinning(const char* name) {
  seat_.spinning = std::make_shared<Spinning>(new_executor(options_, seat_.context), name);
}

void RosEndpoint::start_waiting() { waiting_ = new_waiting(options_.executor, seat_.context, subscription_); }

bool RosEndpoint::send(std::uint64_t sequence, std::span<const std::byte> payload) noexcept {
  if (payload.size() > config_.max_payload_bytes) return false;
  if (statistics_) statistics_->sent(sequence, now_ns());
  try {
    publishing_->publish(sequence, payload);
    return true;
  } catch (const std::exception&) {
    return false;
  }
}

void RosEndpoint::arrived(RoundTrip& message, std::int64_t arrival_ns) noexcept {
  if (statistics_) statistics_->arrived(message.seq, arrival_ns);
  sink_.arrived(message.seq, std::as_writable_bytes(std::span(message.data)), arrival_ns);
}

void RosEndpoint::on_message(const RoundTrip& message) {
  const std::int64_t arrival_ns = now_ns();
  if (options_.intra_process) {
    incoming_.seq = message.seq;
    incoming_.data.assign(message.data.begin(), message.data.end());
    arrived(incoming_, arrival_ns);
  } else {
    // Nothing else has it: the memory strategy made it for this call.
    arrived(const_cast<RoundTrip&>(message), arrival_ns);
  }
}

void RosEndpoint::take_all() {
  rclcpp::MessageInfo info;
  while (subscription_->take_type_erased(&incoming_, info)) {
    const std::int64_t arrival_ns = now_ns();
    arrived(incoming_, arrival_ns);
  }
}

void RosEndpoint::receive() noexcept {
  if (interrupted_) return;
  try {
    waiting_->wait();
    if (!interrupted_) take_all();
  } catch (const std::exception&) {
    // Nothing arrived; the next call tries again.
  }
}

void RosEndpoint::interrupt() noexcept {
  interrupted_ = true;
  try {
    if (waiting_) waiting_->interrupt();
  } catch (const std::exception&) {
    // Only an invalid guard condition throws, and ours lives as long as we.
  }
}

std::vector<Thread> RosEndpoint::threads() {
  auto found = threads_of(options_.rmw, seat_.created, config_.domain);
  if (seat_.spinning)
    for (auto& thread : named(seat_.spinning->name(), "receive")) found.push_back(std::move(thread));
  for (auto& thread : named(Graph::thread_name, "discovery")) found.push_back(std::move(thread));
  return found;
}

std::string RosEndpoint::carrier() const {
  const std::size_t within = publishing_->publisher().get_intra_process_subscription_count();
  return within > 0 && within == publishing_->publisher().get_subscription_count() ? "intra-process"
                                                                                   : seat_.settings_carrier;
}

std::map<std::string, std::string> RosEndpoint::facts() {
  std::map<std::string, std::string> facts{{"rclcpp", RCLCPP_VERSION_STR},
                                           {"rmw", options_.rmw},
                                           {"executor", word_of(options_.executor)},
                                           {"allocator", word_of(options_.allocator)},
                                           {"statistics", statistics_ ? "on" : "off"},
                                           {"node", seat_.node->get_fully_qualified_name()},
                                           {"domain", std::to_string(config_.domain)},
                                           {"carrier", carrier()},
                                           {"configuration", seat_.settings_source}};
  if (const auto distro = environment("ROS_DISTRO"); !distro.empty()) facts.insert({"ros_distro", distro});
  if (const std::string middleware = loaded_middleware(); !middleware.empty())
    facts.insert({"middleware", middleware});
  if (!config_.interface.empty())
    facts.insert({{"interface", config_.interface}, {"address", config_.address}});
  return facts;
}

template <typename Open>
std::unique_ptr<Endpoint> opened(const Open& open) {
  try {
    return open();
  } catch (const Error&) {
    throw;
  } catch (const std::exception& error) {
    throw Error(std::string("ros2: ") + error.what());
  }
}

std::unique_ptr<Endpoint> RosEndpoint::beside(const Config& config, Sink& sink, Where where) {
  return opened([&] { return std::make_unique<RosEndpoint>(config, options_, sink, seat_, where); });
}

std::unique_ptr<Endpoint> open(const Config& config, const Options& options, Sink& sink) {
  return opened([&]() -> std::unique_ptr<Endpoint> {
    choose_resource(options.allocator);
    return std::make_unique<RosEndpoint>(config, options, sink);
  });
}

}  // namespace ontime::transport::ros2

extern "C" std::unique_ptr<ontime::transport::Endpoint> ontime_open_ros2(
    const ontime::transport::Config& config, const ontime::transport::ros2::Options& options,
    ontime::transport::Sink& sink) {
  return ontime::transport::ros2::open(config, options, sink);
}

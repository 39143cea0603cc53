// SPDX-License-Identifier: Apache-2.0
#include "publishing.hpp"

#include <type_traits>
#include <utility>

#include <ontime_msgs/msg/round_trip.hpp>

#include "allocator.hpp"
#include "qos.hpp"

namespace ontime::transport::ros2 {
namespace {

using ontime_msgs::msg::RoundTrip;

template <typename Alloc>
class PublishingWith final : public Publishing {
 public:
  PublishingWith(const Config& config, const Options& options, rclcpp::Node& node) : loaned_(options.loaned) {
    outgoing_.data.reserve(config.max_payload_bytes);
    rclcpp::PublisherOptionsWithAllocator<Alloc> publisher_options;
    publisher_options.allocator = std::make_shared<Alloc>();
    publisher_options.use_default_callbacks = false;  // which print
    publisher_options.use_intra_process_comm = vendor_intra_process(options);
    publisher_ =
        node.create_publisher<RoundTrip>(config.role == Role::client ? config.ping_topic : config.pong_topic,
                                         vendor_qos(config.qos), publisher_options);
    if (loaned_ && !publisher_->can_loan_messages())
      throw Error("ros2: " + options.rmw +
                  " cannot loan a message without an upper bound of its size, such as RoundTrip. Fix: option "
                  "loaned off");
  }

  void publish(std::uint64_t sequence, std::span<const std::byte> payload) override {
    const auto fill = [&](RoundTrip& message) {
      const auto* const bytes = reinterpret_cast<const std::uint8_t*>(payload.data());
      message.seq = sequence;
      message.data.assign(bytes, bytes + payload.size());
    };
    if constexpr (std::is_same_v<Alloc, std::allocator<void>>)  // the others do not compile in Humble's loans
      if (loaned_) {
        auto loan = publisher_->borrow_loaned_message();
        fill(loan.get());
        return publisher_->publish(std::move(loan));
      }
    fill(outgoing_);
    publisher_->publish(outgoing_);
  }
  const rclcpp::PublisherBase& publisher() const override { return *publisher_; }

 private:
  const bool loaned_;
  typename rclcpp::Publisher<RoundTrip, Alloc>::SharedPtr publisher_;
  RoundTrip outgoing_;
};

}  // namespace

std::unique_ptr<Publishing> new_publishing(const Config& config, const Options& options, rclcpp::Node& node) {
  if (options.allocator == Allocator::standard)
    return std::make_unique<PublishingWith<std::allocator<void>>>(config, options, node);
  return std::make_unique<PublishingWith<ResourceAllocator<void>>>(config, options, node);
}

}  // namespace ontime::transport::ros2

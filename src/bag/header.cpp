// SPDX-License-Identifier: Apache-2.0
#include "bag/header.hpp"

#include <algorithm>
#include <array>
#include <sstream>

namespace ontime::bag {
namespace {

// Types of ROS 2's common_interfaces, sorted. Bags before ROS 2 Iron have no definitions.
constexpr std::array<std::string_view, 50> with_header{
    "actionlib_msgs/GoalStatusArray",
    "diagnostic_msgs/DiagnosticArray",
    "geometry_msgs/AccelStamped",
    "geometry_msgs/AccelWithCovarianceStamped",
    "geometry_msgs/InertiaStamped",
    "geometry_msgs/PointStamped",
    "geometry_msgs/PolygonInstanceStamped",
    "geometry_msgs/PolygonStamped",
    "geometry_msgs/PoseArray",
    "geometry_msgs/PoseStamped",
    "geometry_msgs/PoseWithCovarianceStamped",
    "geometry_msgs/QuaternionStamped",
    "geometry_msgs/TransformStamped",
    "geometry_msgs/TwistStamped",
    "geometry_msgs/TwistWithCovarianceStamped",
    "geometry_msgs/Vector3Stamped",
    "geometry_msgs/VelocityStamped",
    "geometry_msgs/WrenchStamped",
    "nav_msgs/GridCells",
    "nav_msgs/OccupancyGrid",
    "nav_msgs/Odometry",
    "nav_msgs/Path",
    "sensor_msgs/BatteryState",
    "sensor_msgs/CameraInfo",
    "sensor_msgs/CompressedImage",
    "sensor_msgs/FluidPressure",
    "sensor_msgs/Illuminance",
    "sensor_msgs/Image",
    "sensor_msgs/Imu",
    "sensor_msgs/JointState",
    "sensor_msgs/Joy",
    "sensor_msgs/LaserScan",
    "sensor_msgs/MagneticField",
    "sensor_msgs/MultiDOFJointState",
    "sensor_msgs/MultiEchoLaserScan",
    "sensor_msgs/NavSatFix",
    "sensor_msgs/PointCloud",
    "sensor_msgs/PointCloud2",
    "sensor_msgs/Range",
    "sensor_msgs/RelativeHumidity",
    "sensor_msgs/Temperature",
    "sensor_msgs/TimeReference",
    "stereo_msgs/DisparityImage",
    "trajectory_msgs/JointTrajectory",
    "trajectory_msgs/MultiDOFJointTrajectory",
    "visualization_msgs/ImageMarker",
    "visualization_msgs/InteractiveMarker",
    "visualization_msgs/InteractiveMarkerFeedback",
    "visualization_msgs/InteractiveMarkerPose",
    "visualization_msgs/Marker",
};
static_assert(std::is_sorted(with_header.begin(), with_header.end()));

// The type of a line of a .msg file; empty: it declares no field.
std::string type_in(const std::string& line) {
  std::istringstream words(line.substr(0, line.find('#')));
  std::string type, name, next;
  words >> type >> name >> next;
  const bool is_constant = name.find('=') != name.npos || next.starts_with('=');
  return is_constant || name.empty() ? "" : type;
}

// Other types that it uses come after the first definition, each behind a line of "=".
bool is_header_first(const std::string& definition) {
  std::istringstream lines(definition);
  for (std::string line; std::getline(lines, line) && !line.starts_with("==");)
    if (const auto type = type_in(line); !type.empty())
      return type == "std_msgs/Header" || type == "std_msgs/msg/Header" || type == "Header";
  return false;
}

std::uint32_t number_at(std::span<const std::byte> bytes, std::size_t at, bool is_little) {
  std::uint32_t number = 0;
  for (std::size_t i = 0; i < 4; ++i)
    number = number << 8U | std::to_integer<std::uint32_t>(bytes[at + (is_little ? 3 - i : i)]);
  return number;
}

}  // namespace

bool begins_with_header(std::string_view type, std::string_view encoding, const std::string& definition) {
  if (encoding == "ros2msg" && !definition.empty()) return is_header_first(definition);
  std::string name(type);
  if (const auto middle = name.find("/msg/"); middle != name.npos) name.erase(middle, 4);
  return std::binary_search(with_header.begin(), with_header.end(), std::string_view(name));
}

// Two bytes say which CDR it is, two are options; then seconds and nanoseconds.
std::optional<std::int64_t> stamp_of(std::span<const std::byte> message) {
  if (message.size() < stamp_end || message[0] != std::byte{0} || message[1] > std::byte{1}) return {};
  const bool is_little = message[1] == std::byte{1};
  const auto seconds = static_cast<std::int32_t>(number_at(message, 4, is_little));
  const auto nanoseconds = number_at(message, 8, is_little);
  if (seconds < 0 || nanoseconds >= 1'000'000'000) return {};
  return std::int64_t{seconds} * 1'000'000'000 + nanoseconds;
}

}  // namespace ontime::bag

// Copyright 2026 The flexarm_ros maintainers
//
// Licensed under the Apache License, Version 2.0 (the "License");
// you may not use this file except in compliance with the License.
// You may obtain a copy of the License at
//
//     http://www.apache.org/licenses/LICENSE-2.0
//
// Unless required by applicable law or agreed to in writing, software
// distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
// See the License for the specific language governing permissions and
// limitations under the License.

// PD on the joints: answers each plant/state with one joint_command of the same stamp.
// The law, and in lock-step every recorded byte, is that of examples/minimal_controller.py.

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>

#include "rclcpp/rclcpp.hpp"
#include "sensor_msgs/msg/joint_state.hpp"

using sensor_msgs::msg::JointState;

class Controller : public rclcpp::Node
{
public:
  Controller()
  : Node("cpp_controller")
  {
    const auto qos = rclcpp::QoS(rclcpp::KeepLast(1000)).reliable();
    command_ = create_publisher<JointState>("joint_command", qos);
    state_ = create_subscription<JointState>(
      "plant/state", qos, [this](const JointState & state) {answer(state);});
  }

private:
  void answer(const JointState & state)
  {
    JointState command;
    command.header.stamp = state.header.stamp;  // the tick that this answers
    command.name = {"shoulder", "elbow"};
    command.effort = {
      torque(state, "shoulder", -3 * M_PI / 4 - 0.14, 2000.0, 400.0),
      torque(state, "elbow", 0.28, 600.0, 120.0)};
    command_->publish(command);
  }

  // N m; goal in rad, kp in N m/rad, kd in N m s/rad
  static double torque(
    const JointState & state, const std::string & joint, double goal, double kp, double kd)
  {
    const auto found = std::find(state.name.begin(), state.name.end(), joint);
    const auto i = std::distance(state.name.begin(), found);
    return kp * (goal - state.position.at(i)) - kd * state.velocity.at(i);
  }

  rclcpp::Publisher<JointState>::SharedPtr command_;
  rclcpp::Subscription<JointState>::SharedPtr state_;
};

int main(int argc, char ** argv)
{
  rclcpp::init(argc, argv);
  rclcpp::spin(std::make_shared<Controller>());
  rclcpp::shutdown();
}

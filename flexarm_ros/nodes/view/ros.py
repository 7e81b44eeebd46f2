# Copyright 2026 The flexarm_ros maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""A live view for RViz: markers, the URDF and, if tf2_msgs is installed, TF."""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module
import math
from typing import Any

from flexarm_ros.analysis.palette import LAW_HUES, rgb, SPARE_HUES
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.signals import BASE_FRAME
from flexarm_ros.nodes.view.scene import Frame, Point, Scene
from flexarm_ros.nodes.view.urdf import transforms, urdf
from geometry_msgs.msg import Point as PointMessage
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String
from visualization_msgs.msg import Marker, MarkerArray

MARKERS = '~/markers'
_LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)

SENSED, REFERENCE, JOINTS = map(rgb, ('amber', 'purple', 'slate'))


def law_color(law: str) -> tuple[float, float, float]:
    """Return the colour of the arm: the hue of the control law."""
    return rgb(LAW_HUES.get(law, SPARE_HUES[0]))


class RosView:
    """Publishes frames as ROS messages."""

    def __init__(self, node: Node) -> None:
        self._markers = node.create_publisher(MarkerArray, MARKERS, 1)
        self._description = node.create_publisher(String, 'robot_description', _LATCHED)
        self._tf: Any = None
        try:
            self._tf_kind = import_module('tf2_msgs.msg').TFMessage
            self._tf = node.create_publisher(self._tf_kind, '/tf', 10)
        except ImportError:
            node.get_logger().info('tf2_msgs is not installed: no TF, markers only')

    def describe(self, config: RunConfig) -> None:
        """Publish the URDF of a scenario."""
        self._description.publish(String(data=urdf(config)))

    def show(self, frame: Frame, scene: Scene) -> None:
        """Publish one frame."""
        self._markers.publish(MarkerArray(markers=list(markers(frame, scene))))
        if self._tf is not None:
            self._tf.publish(self._tf_kind(transforms=stamped(frame, scene.config)))


def markers(frame: Frame, scene: Scene) -> Iterable[Marker]:
    """Yield the markers of a frame: the links, the trails, tip, sensed point and reference."""
    first, second = frame.links
    arm = law_color(scene.config.controller.law)
    yield _marker(frame, 'link1', Marker.LINE_STRIP, arm, 0.08, first)
    yield _marker(frame, 'link2', Marker.LINE_STRIP, arm, 0.08, second)
    yield _marker(frame, 'joints', Marker.SPHERE_LIST, JOINTS, 0.2, (first[0], second[0]))
    yield _marker(frame, 'tip', Marker.SPHERE_LIST, arm, 0.2, (frame.tip,))
    for name, color, point in (
        ('sensed', SENSED, frame.sensed), ('reference', REFERENCE, frame.reference)
    ):  # fmt: skip
        if math.isfinite(point[0]):
            yield _marker(frame, name, Marker.SPHERE_LIST, color, 0.15, (point,))
    yield _marker(frame, 'path', Marker.LINE_STRIP, REFERENCE, 0.03, scene.path)
    yield _marker(frame, 'trail', Marker.LINE_STRIP, arm, 0.03, scene.trail)


def _marker(
    frame: Frame,
    name: str,
    kind: int,
    color: tuple[float, float, float],
    size: float,
    points: Iterable[Point],
) -> Marker:
    marker = Marker(ns=name, id=0, type=kind, action=Marker.ADD)
    marker.header.frame_id = BASE_FRAME
    marker.header.stamp.sec, marker.header.stamp.nanosec = divmod(frame.stamp_ns, 10**9)
    marker.pose.orientation.w = 1.0
    marker.scale.x = marker.scale.y = marker.scale.z = size
    marker.color.r, marker.color.g, marker.color.b = color
    marker.color.a = 1.0
    marker.points = [PointMessage(x=x, y=y, z=0.0) for x, y in points]
    return marker


def stamped(frame: Frame, config: RunConfig) -> list[TransformStamped]:
    """Return the frames of the rigid skeleton for TF."""
    found = []
    for parent, child, x, angle in transforms(config, *frame.angles):
        message = TransformStamped(child_frame_id=child)
        message.header.frame_id = parent
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(frame.stamp_ns, 10**9)
        message.transform.translation.x = x
        message.transform.rotation.z = math.sin(0.5 * angle)
        message.transform.rotation.w = math.cos(0.5 * angle)
        found.append(message)
    return found

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

"""
A live view for Foxglove and Lichtblick: the WebSocket server of foxglove-sdk.

The package is an optional extra (``pip install 'flexarm_ros[view]'``) and is
imported only here.  ``assets/flexarm.foxglove.json`` is the layout.
"""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module
from importlib.resources import files
import math
from pathlib import Path
from typing import Any

from flexarm_ros.core.signals import BASE_FRAME
from flexarm_ros.nodes.view.ros import JOINTS, law_color, REFERENCE, SENSED
from flexarm_ros.nodes.view.scene import Frame, Point, Scene
from flexarm_ros.nodes.view.urdf import transforms

SCENE, FRAMES, NUMBERS = '/arm/scene', '/arm/frames', '/arm'
_MISSING = "foxglove-sdk is not installed: pip install 'flexarm_ros[view]'"


class ViewError(Exception):
    """The view is not available; one line."""


def layout() -> Path:
    """Return the layout file to import in Foxglove or Lichtblick."""
    return Path(str(files('flexarm_ros.nodes.view') / 'assets' / 'flexarm.foxglove.json'))


class FoxgloveView:
    """
    Sends frames to the clients of ``ws://HOST:PORT``.

    ``port`` 0 takes a free one.  Raises ViewError if foxglove-sdk is not
    installed or the port is in use.
    """

    def __init__(self, host: str, port: int) -> None:
        try:
            self._sdk = import_module('foxglove')
            self._messages = import_module('foxglove.messages')
            channels = import_module('foxglove.channels')
        except ImportError:
            raise ViewError(_MISSING) from None
        self._sdk.set_log_level('ERROR')
        # Kept: the channels of a deleted context send nothing.
        context = self._context = self._sdk.Context()
        self._scene = channels.SceneUpdateChannel(SCENE, context=context)
        self._frames = channels.FrameTransformsChannel(FRAMES, context=context)
        self._numbers = self._sdk.Channel(NUMBERS, schema=_schema(), context=context)
        try:
            self._server = self._sdk.start_server(
                name='flexarm_ros', host=host, port=port, context=context,
                capabilities=[self._sdk.Capability.Time],
            )  # fmt: skip
        except Exception as error:
            raise ViewError(f'port {port} on {host}: {error}') from None
        self.port: int = self._server.port

    def show(self, frame: Frame, scene: Scene) -> None:
        """Send one frame, stamped with simulated time."""
        sdk, stamp = self._messages, frame.stamp_ns
        time = sdk.Timestamp(*divmod(stamp, 10**9))
        self._server.broadcast_time(stamp)
        self._frames.log(
            sdk.FrameTransforms(transforms=[
                sdk.FrameTransform(
                    timestamp=time, parent_frame_id=parent, child_frame_id=child,
                    translation=sdk.Vector3(x=x, y=0.0, z=0.0),
                    rotation=sdk.Quaternion(
                        x=0.0, y=0.0, z=math.sin(0.5 * angle), w=math.cos(0.5 * angle)
                    ),
                )
                for parent, child, x, angle in transforms(scene.config, *frame.angles)
            ]),
            log_time=stamp,
        )  # fmt: skip
        entity = sdk.SceneEntity(
            timestamp=time, frame_id=BASE_FRAME, id='arm',
            lines=list(self._lines(frame, scene)), spheres=list(self._spheres(frame, scene)),
        )  # fmt: skip
        self._scene.log(sdk.SceneUpdate(entities=[entity]), log_time=stamp)
        self._numbers.log(frame.numbers(), log_time=stamp)

    def _lines(self, frame: Frame, scene: Scene) -> Iterable[Any]:
        first, second = frame.links
        arm = law_color(scene.config.controller.law)
        for points, thickness, color in (
            (first, 0.08, arm), (second, 0.08, arm), (scene.path, 0.03, REFERENCE),
            (scene.trail, 0.03, arm),
        ):  # fmt: skip
            yield self._messages.LinePrimitive(
                thickness=thickness, color=self._color(color),
                points=[self._messages.Point3(x=x, y=y, z=0.0) for x, y in points],
            )  # fmt: skip

    def _spheres(self, frame: Frame, scene: Scene) -> Iterable[Any]:
        spots: tuple[tuple[Point, float, tuple[float, float, float]], ...] = (
            (frame.line[0], 0.2, JOINTS), (frame.line[frame.elbow], 0.2, JOINTS),
            (frame.tip, 0.2, law_color(scene.config.controller.law)),
            (frame.sensed, 0.15, SENSED), (frame.reference, 0.15, REFERENCE),
        )  # fmt: skip
        sdk = self._messages
        for (x, y), size, color in spots:
            if math.isfinite(x):
                yield sdk.SpherePrimitive(
                    pose=sdk.Pose(
                        position=sdk.Vector3(x=x, y=y, z=0.0),
                        orientation=sdk.Quaternion(x=0.0, y=0.0, z=0.0, w=1.0),
                    ),
                    size=sdk.Vector3(x=size, y=size, z=size), color=self._color(color),
                )  # fmt: skip

    def _color(self, rgb: tuple[float, float, float]) -> Any:
        return self._messages.Color(r=rgb[0], g=rgb[1], b=rgb[2], a=1.0)

    def close(self) -> None:
        """Stop the server."""
        self._server.stop()


def _schema() -> dict[str, Any]:
    """Return the JSON schema of the numbers."""
    empty = Frame(
        0, ((0.0, 0.0),), 0, (0.0, 0.0), (0.0, 0.0), (0.0, 0.0), (0.0, 0.0), (0.0, 0.0), 0.0
    )
    keys = {key: {'type': ['number', 'null']} for key in empty.numbers()}
    return {'title': 'flexarm_ros.Numbers', 'type': 'object', 'properties': keys}

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
The rigid skeleton: a URDF, and its frames for given joint angles.

The joints have the names of ``joint_states``, so that robot_state_publisher moves the skeleton
too.  Frames: ``base`` at the shoulder, ``link1`` rotated by theta1, ``link2`` at the rigid elbow,
``tool`` at the rigid tip.  Only the markers show the deflection.
"""

from __future__ import annotations

from typing import NamedTuple

from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.signals import BASE_FRAME, JOINTS, TOOL_FRAME

LINK1, LINK2 = 'link1', 'link2'
_WIDTH = 0.08


class Transform(NamedTuple):
    """A frame ``child`` in ``parent``: moved along x (m), then rotated about z (rad)."""

    parent: str
    child: str
    x: float
    angle: float


def transforms(config: RunConfig, theta1: float, theta2: float) -> tuple[Transform, ...]:
    """Return the frames of the rigid skeleton."""
    first, second = config.plant.spans
    return (
        Transform(BASE_FRAME, LINK1, 0.0, theta1),
        Transform(LINK1, LINK2, first, theta2),
        Transform(LINK2, TOOL_FRAME, second, 0.0),
    )


def urdf(config: RunConfig) -> str:
    """Return the skeleton as URDF."""
    first, second = config.plant.spans
    return '\n'.join(
        [
            '<?xml version="1.0"?>',
            '<robot name="flexarm">',
            f'  <link name="{BASE_FRAME}"/>',
            _link(LINK1, first, '0.55 0.65 0.75'),
            _link(LINK2, second, '0.75 0.65 0.55'),
            f'  <link name="{TOOL_FRAME}"/>',
            _joint(JOINTS[0], 'continuous', BASE_FRAME, LINK1, 0.0),
            _joint(JOINTS[1], 'continuous', LINK1, LINK2, first),
            _joint('tool_fixed', 'fixed', LINK2, TOOL_FRAME, second),
            '</robot>',
            '',
        ]
    )


def _link(name: str, length: float, color: str) -> str:
    return (
        f'  <link name="{name}"><visual><origin xyz="{length / 2.0!r} 0 0"/>'
        f'<geometry><box size="{length!r} {_WIDTH} {_WIDTH}"/></geometry>'
        f'<material name="{name}"><color rgba="{color} 0.5"/></material></visual></link>'
    )


def _joint(name: str, kind: str, parent: str, child: str, x: float) -> str:
    axis = '<axis xyz="0 0 1"/>' if kind == 'continuous' else ''
    return (
        f'  <joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{x!r} 0 0"/>{axis}</joint>'
    )

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
"""Data of the live page: the arm, its parameters, frames, a recorded run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
import math
import os
from typing import Any

from flexarm_ros.bag.reading.reader import BagReader
from flexarm_ros.core.parameters.sections import (
    keys,
    RunConfig,
    SECTIONS,
    values_of,
)
from flexarm_ros.core.parameters.spec import Spec
from flexarm_ros.core.run.parts import columns
from flexarm_ros.core.sensing.strain_gauge import STRAIN
from flexarm_ros.nodes.view.scene import Frame, Point, Scene
from flexarm_ros.wire.topics import TIP

FRAMES = 1500
"""Most frames of a recorded run on the page."""

_TYPICAL = {'s': 0.02, 'm': 0.05, 'rad': 0.01, 'N m': 1000.0, '1/s': 100.0}
"""Least upper end of a slider by unit."""


def described(config: RunConfig, live: bool = True) -> dict[str, Any]:
    """
    Return the event ``hello`` of a run.

    ``strain``: the unit of the strain gauges, empty without them.  ``live``: with the parameters
    that may change while running.
    """
    plant = config.plant
    return {
        'law': config.controller.law,
        'feedback': config.controller.feedback,
        'length': list(plant.length),
        'period': config.run.control_period,
        'strain': ' and '.join({c.unit: 0 for c in columns(config) if c.topic == STRAIN}),
        'parameters': list(live_parameters(config)) if live else [],
        'recorded': not live,
    }


def live_parameters(config: RunConfig) -> Iterable[dict[str, Any]]:
    """Yield name, value, text and slider's range of each key of the scenario that may change."""
    for node in SECTIONS:
        values = values_of(config, node)
        for key, (_, spec, _) in keys(node).items():
            if spec.live and key in values:
                yield {
                    'node': node, 'key': key, 'value': values[key], 'unit': spec.unit,
                    'doc': spec.doc, 'range': slider_range(spec, values[key]),
                }  # fmt: skip


def slider_range(spec: Spec, value: float) -> list[float]:
    """Return the ends of a slider: a range about the value that is useful, within the allowed."""
    typical = _TYPICAL.get(spec.unit, 0.0 if value else 1.0)
    top = max(4.0 * abs(value), typical)
    low = 0.0 if spec.low is None else max(spec.low, -top)
    return [low, top if spec.high is None else min(spec.high, top)]


def sent(frame: Frame, scene: Scene, state: str = '') -> dict[str, Any]:
    """
    Return the event ``frame``: s since the start, m, rad, N m.

    ``age``: s, of the tip sensor's newest measurement.  ``held``: share of the ticks since the
    last frame that brought no new one.
    """
    return {
        't': round(frame.stamp_ns * 1e-9 - 1.0, 6),
        'line': [_point(p) for p in frame.line],
        'elbow': frame.elbow,
        'sensed': _point(frame.sensed),
        'reference': _point(frame.reference),
        'age': scene.age_s,
        'held': scene.held_share(),
        'state': state,
        **frame.numbers(),
        **scene.strain(),
    }


def _point(point: Point) -> list[float] | None:
    if not (math.isfinite(point[0]) and math.isfinite(point[1])):
        return None
    return [round(point[0], 4), round(point[1], 4)]


def recording(run: str | os.PathLike[str], given: RunConfig | None = None) -> Mapping[str, Any]:
    """
    Return the description and at most `FRAMES` frames of a recorded run.

    Raises BagError if the path is no run, or has no scenario.
    """
    reader = BagReader(run, given)
    config = reader.config
    scene, frames = Scene(config), []
    every = max(1, -(-reader.timeline.ticks // FRAMES))
    for tick, messages in reader.ticks():
        if tick % every:
            if (data := messages[TIP]) is not None:
                scene.take(TIP, data)
            continue
        for topic in scene.topics:
            if (data := messages[topic]) is not None:
                scene.take(topic, data)
        if (frame := scene.frame()) is not None:
            frames.append(sent(frame, scene))
    if not frames:
        raise reader.nothing()
    return {'hello': described(config, live=False), 'frames': frames}

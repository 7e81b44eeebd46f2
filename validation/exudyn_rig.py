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
A two-link flexible arm in Exudyn that is moved and measured as a rig on a bench is.

Each link is a chain of planar ANCF cable elements; hubs, the second drive and the payload are
rigid bodies, to which links with rigid parts are clamped at a distance.  Joints have viscous and
Coulomb friction; a controller with 500 Hz, or another law, moves them.  Nothing of this package
takes part but the numbers of the scenario.  Coulomb friction is proportional to the rate below
`ZONE`, so that Exudyn's Newton iterations converge.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import math
from typing import Any, NamedTuple

import exudyn as exu
import exudyn.itemInterface as items
from flexarm_ros.core.arm.plant import material_damping
from flexarm_ros.core.parameters.sections import PlantParameters
import numpy as np
from validation.exudyn_arm import add_cables, solver_settings
from validation.motion import Array

PERIOD, STEP = 0.002, 1e-4
"""
Of the controller and of Exudyn's integrator, s.

With 5e-4 s the integrator's error, of first order where joints stick and slip, is that of a fit
with 0.3 % less viscous and 0.2 % more Coulomb friction in joint 1; with 1e-4 s below 0.07 %.
"""
ELEMENTS = 8
AXIAL = 1e6
"""EA, N; three times as much changes the curvatures by 1e-4 of their standard deviation."""

ZONE = 5e-5
"""Joint rate below which Coulomb friction is proportional to the rate, rad/s."""

PLACE = 0.5 * (1.0 + 1.0 / math.sqrt(3.0))
"""Place of the gauge in the first element: its second Gauss point, where curvature is accurate."""

GAINS = ((40.0, 12.0), (8.0, 1.6))
"""Of the controller: N m/rad and N m s/rad of each joint."""


class Mesh(NamedTuple):
    """Elements a link, and the step of the integrator, s."""

    elements: int = ELEMENTS
    step: float = STEP


COARSE = Mesh()


def goal(time: float) -> tuple[float, float]:
    """Return the reference of both joints, rad: small, as the model bends up to some 1 %."""
    swing = 0.015 * math.sin(2.0 * math.pi * 0.45 * time)
    first, second = (
        0.02 if time % 3.0 < 1.5 else -0.02,
        0.02 if (time + 0.7) % 2.4 < 1.2 else -0.02,
    )
    return first + swing, second - swing


def gauge_places(plant: PlantParameters, mesh: Mesh = COARSE) -> tuple[float, float]:
    """Return where the gauges sit, m from the root of each link."""
    first, second = (length / mesh.elements * PLACE for length in plant.length)
    return first, second


Pair = tuple[float, float]
Law = Callable[[float, Pair, Pair], Pair]
"""Torques, N m, from the time, s, the joint angles and their rates, rad and rad/s."""


def control(time: float, angles: Pair, rates: Pair) -> Pair:
    """Return the torques of the controller."""
    first, second = (
        kp * (wanted - angle) - kd * rate
        for (kp, kd), wanted, angle, rate in zip(GAINS, goal(time), angles, rates, strict=True)
    )
    return first, second


@dataclass(frozen=True)
class _Body:
    """A rigid body at a node of a link: numbers of its node and its marker."""

    node: Any
    marker: Any


def fly(
    plant: PlantParameters, seconds: float, law: Law = control, mesh: Mesh = COARSE
) -> dict[str, Array]:
    """Return ``theta``, ``curvature`` (1/m) and ``torque``, (n, 2) each, every `PERIOD`."""
    container = exu.SystemContainer()
    system = container.AddSystem()
    links = [_link(system, plant, link, mesh.elements) for link in (0, 1)]
    hubs, ends = plant.hub_radius, plant.end_offset
    bodies = [
        _body(system, links[0][0], hubs[0], 1e-6, plant.hub_inertia[0]),
        _body(system, links[0][-1], -ends[0], plant.link_end_mass, plant.link_end_inertia),
        _body(system, links[1][0], hubs[1], 1e-6, 0.0),
        _body(system, links[1][-1], -ends[1], plant.payload_mass, plant.payload_inertia),
    ]
    hub, end, root, _ = bodies
    ground = system.AddMarker(
        items.MarkerBodyRigid(bodyNumber=system.AddObject(items.ObjectGround()))
    )
    for first, second in ((ground, hub.marker), (end.marker, root.marker)):
        system.AddObject(
            items.GenericJoint(markerNumbers=[first, second], constrainedAxes=[1, 1, 0, 0, 0, 0])
        )
    _rotor(system, end, root, plant.hub_inertia[1])
    turns = [
        system.AddMarker(items.MarkerNodeCoordinate(nodeNumber=body.node, coordinate=2))
        for body in (hub, end, root)
    ]
    _friction(system, plant, turns)
    rows = _control(
        system,
        (hub, end, root),
        turns,
        lambda: [_curvature(system, plant, links, n) for n in (0, 1)],
        law,
        round(PERIOD / mesh.step),
    )
    system.Assemble()
    system.SolveDynamic(solver_settings(seconds, mesh.step, relative=1e-6, absolute=1e-10))
    table = np.array(rows)
    return {'theta': table[:, :2], 'curvature': table[:, 2:4], 'torque': table[:, 4:]}


def _link(system: Any, plant: PlantParameters, link: int, elements: int) -> list[Any]:
    """Add the flexible part of a link, straight along x; return its nodes."""
    piece = plant.length[link] / elements
    begin = link * plant.spans[0] + plant.hub_radius[link]
    nodes = [
        system.AddNode(
            items.NodePoint2DSlope1(referenceCoordinates=[begin + i * piece, 0.0, 1.0, 0.0])
        )
        for i in range(elements + 1)
    ]
    rigidity = plant.flexural_rigidity[link]
    damping = rigidity * material_damping(plant, link)
    add_cables(system, nodes, piece, plant.mass_density[link], rigidity, AXIAL, damping)
    return nodes


def _body(system: Any, node: Any, ahead: float, mass: float, inertia: float) -> _Body:
    """Clamp a rigid body to a node of a link, which is ``ahead`` of it, m along the link."""
    x, y = system.GetNode(node)['referenceCoordinates'][:2]
    own = system.AddNode(items.NodeRigidBody2D(referenceCoordinates=[x - ahead, y, 0.0]))
    body = system.AddObject(items.RigidBody2D(nodeNumber=own, mass=mass, inertia=inertia))
    marker = system.AddMarker(items.MarkerNodeRigid(nodeNumber=own))
    seat = system.AddMarker(items.MarkerBodyRigid(bodyNumber=body, localPosition=[ahead, 0, 0]))
    other = system.AddMarker(items.MarkerNodeRigid(nodeNumber=node))
    system.AddObject(
        items.GenericJoint(markerNumbers=[other, seat], constrainedAxes=[1, 1, 0, 0, 0, 1])
    )
    return _Body(own, marker)


def _rotor(system: Any, end: _Body, root: _Body, inertia: float) -> None:
    """Add an inertia that acts on the rate between two bodies, as a rotor behind a gear does."""
    mass = np.zeros((6, 6))
    mass[2, 2] = mass[5, 5] = inertia
    mass[2, 5] = mass[5, 2] = -inertia
    system.AddObject(items.ObjectGenericODE2(nodeNumbers=[end.node, root.node], massMatrix=mass))


def _friction(system: Any, plant: PlantParameters, turns: list[Any]) -> None:
    still = system.AddNode(items.NodePointGround())
    fixed = system.AddMarker(items.MarkerNodeCoordinate(nodeNumber=still, coordinate=0))
    for joint, pair in enumerate(([fixed, turns[0]], [turns[1], turns[2]])):
        system.AddObject(
            items.CoordinateSpringDamperExt(
                markerNumbers=pair, damping=plant.viscous_friction[joint],
                dynamicFrictionForce=plant.coulomb_friction[joint], frictionProportionalZone=ZONE,
            )
        )  # fmt: skip


def _control(
    system: Any, bodies: Any, turns: list[Any], curvatures: Any, law: Law, every: int
) -> list[list[float]]:
    """Let the law set the torques every ``every`` steps; return the rows, which it fills."""
    loads = [system.AddLoad(items.LoadCoordinate(markerNumber=turn, load=0.0)) for turn in turns]
    rows: list[list[float]] = []
    steps = [0]

    def turned(kind: Any) -> tuple[float, float]:
        first, end, root = (system.GetNodeOutput(body.node, kind)[2] for body in bodies)
        return first, root - end

    def before(_: Any, time: float) -> bool:
        if steps[0] % every == 0:
            angles = turned(exu.OutputVariableType.Coordinates)
            rates = turned(exu.OutputVariableType.Coordinates_t)
            torques = law(len(rows) * PERIOD, angles, rates)
            rows.append([*angles, *curvatures(), *torques])
            for load, torque in zip(loads, (torques[0], -torques[1], torques[1]), strict=True):
                system.SetLoadParameter(load, 'load', torque)
        steps[0] += 1
        return True

    system.SetPreStepUserFunction(before)
    return rows


def _curvature(system: Any, plant: PlantParameters, links: list[list[Any]], link: int) -> float:
    """Return the curvature at the gauge, 1/m, which is at `PLACE` of the first element."""
    piece, x = plant.length[link] / (len(links[link]) - 1), PLACE
    points = []
    for node in links[link][:2]:
        moved = np.asarray(system.GetNodeOutput(node, exu.OutputVariableType.Coordinates))
        place = moved + np.asarray(system.GetNode(node)['referenceCoordinates'])
        points += [place[:2], piece * place[2:]]
    slopes = np.array(
        [6 * x * x - 6 * x, 1 - 4 * x + 3 * x * x, 6 * x - 6 * x * x, 3 * x * x - 2 * x]
    )
    bends = np.array([12 * x - 6, 6 * x - 4, 6 - 12 * x, 6 * x - 2])
    along, bend = slopes @ np.array(points) / piece, bends @ np.array(points) / piece**2
    return float((along[0] * bend[1] - along[1] * bend[0]) / np.linalg.norm(along) ** 3)

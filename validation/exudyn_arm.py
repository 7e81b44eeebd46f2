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
The same arm in Exudyn: planar ANCF cable elements, geometrically exact bending.

Exudyn (PyPI ``exudyn``) is wanted here and in one test only.  Its cables can
stretch; the arm's links cannot.  For smooth motions the error of that is
proportional to 1 / EA: two runs are extrapolated to EA infinite.  Where a
motion starts with a jolt (straight links that already rotate), the cables ring
along their axis, which does not extrapolate; a single stiffer run is better.
The integrator's step matters there too: the trapezoidal rule delays a mode of
frequency w by (w h)^2 / 12 of its phase.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import exudyn as exu
import exudyn.itemInterface as items
import numpy as np
from validation.motion import Array, Case

LENGTH, DENSITY, RIGIDITY = 4.5, 0.335, 1676.0
EVERY = 0.02
"""Seconds between rows."""


@dataclass(frozen=True)
class Mesh:
    """Elements a link, step (s), and EA (N) of the run or of the two to be extrapolated."""

    elements: int = 16
    step: float = 5e-4
    axial: tuple[float, ...] = (1e6, 3e6)


COARSE = Mesh(8, 1e-3)
FINE = Mesh()
STIFF = Mesh(32, 2.5e-4, (1e8,))


def solve(case: Case, mesh: Mesh) -> Array:
    """Return the motion as rows ``(t, theta1, theta2, tip_x, tip_y, defl1, defl2)``."""
    runs = [_run(case, mesh, axial) for axial in mesh.axial]
    if len(runs) == 1:
        return runs[0]
    ratio = mesh.axial[1] / mesh.axial[0]
    return np.asarray((ratio * runs[1] - runs[0]) / (ratio - 1.0))


def solver_settings(seconds: float, step: float, relative: float, absolute: float) -> Any:
    """Return the settings of a run by the trapezoidal rule; Newton's tolerances are given."""
    settings = exu.SimulationSettings()
    integration = settings.timeIntegration
    integration.numberOfSteps = round(seconds / step)
    integration.endTime = seconds
    integration.verboseMode = 0
    integration.adaptiveStep = False
    integration.generalizedAlpha.spectralRadius = 1.0
    integration.generalizedAlpha.useIndex2Constraints = True
    integration.generalizedAlpha.useNewmark = True
    integration.newton.useModifiedNewton = False
    integration.newton.relativeTolerance = relative
    integration.newton.absoluteTolerance = absolute
    settings.solution.file.write = False
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    return settings


def _run(case: Case, mesh: Mesh, axial: float) -> Array:
    system = exu.SystemContainer().AddSystem()
    links = _links(system, case, mesh.elements, axial)
    _joints(system, links)
    if case.payload:
        _payload(system, links[1][-1], case.payload)
    _torques(system, links, case)
    rows: list[list[float]] = []

    def record(mbs: Any, time: float) -> bool:
        if time >= len(rows) * EVERY - 0.5 * mesh.step:
            rows.append([len(rows) * EVERY, *_measure(mbs, links)])
        return True

    system.SetPostStepUserFunction(record)
    system.Assemble()
    record(system, 0.0)
    settings = solver_settings(case.duration, mesh.step, relative=1e-5, absolute=1e-9)
    system.SolveDynamic(settings)
    motion = np.array(rows)
    motion[:, 1:3] = np.unwrap(motion[:, 1:3], axis=0)
    return motion


def _links(system: Any, case: Case, elements: int, axial: float) -> list[list[Any]]:
    """Add both links, straight; return their nodes."""
    links = []
    start, speed, angle, rate = np.zeros(2), np.zeros(2), 0.0, 0.0
    piece = LENGTH / elements
    for joint, change in zip(case.angles, case.rates, strict=True):
        angle += joint
        rate += change
        along = np.array([np.cos(angle), np.sin(angle)])
        across = np.array([-along[1], along[0]])
        nodes = []
        for i in range(elements + 1):
            place = start + i * piece * along
            velocity = speed + rate * i * piece * across
            nodes.append(
                system.AddNode(
                    items.NodePoint2DSlope1(
                        referenceCoordinates=[*place, *along],
                        initialVelocities=[*velocity, *(rate * across)],
                    )
                )
            )
        add_cables(system, nodes, piece, DENSITY, RIGIDITY, axial)
        links.append(nodes)
        start, speed = start + LENGTH * along, speed + rate * LENGTH * across
    return links


def add_cables(
    system: Any, nodes: list[Any], piece: float, density: float, rigidity: float, axial: float,
    damping: float = 0.0,
) -> None:  # fmt: skip
    """
    Add a cable element of length ``piece``, m, between each two nodes.

    ``density``, kg/m; ``rigidity`` EI, N m^2; ``axial`` EA, N; ``damping`` of bending, N m^2 s.
    """
    for pair in pairwise(nodes):
        system.AddObject(
            items.Cable2D(
                length=piece, massPerLength=density, bendingStiffness=rigidity,
                axialStiffness=axial, bendingDamping=damping, nodeNumbers=list(pair),
                useReducedOrderIntegration=0,
            )
        )  # fmt: skip


def _joints(system: Any, links: list[list[Any]]) -> None:
    ground = system.AddNode(items.NodePointGround())
    fixed = system.AddMarker(items.MarkerNodeCoordinate(nodeNumber=ground, coordinate=0))
    for axis in (0, 1):
        shoulder = _coordinate(system, links[0][0], axis)
        system.AddObject(items.CoordinateConstraint(markerNumbers=[fixed, shoulder]))
        _glue(system, links[0][-1], links[1][0], axis)


def _coordinate(system: Any, node: Any, axis: int) -> Any:
    return system.AddMarker(items.MarkerNodeCoordinate(nodeNumber=node, coordinate=axis))


def _glue(system: Any, first: Any, second: Any, axis: int) -> None:
    markers = [_coordinate(system, first, axis), _coordinate(system, second, axis)]
    system.AddObject(items.CoordinateConstraint(markerNumbers=markers))


def _payload(system: Any, tip: Any, mass: float) -> None:
    reference = system.GetNode(tip)
    node = system.AddNode(
        items.NodePoint2D(
            referenceCoordinates=list(reference['referenceCoordinates'][:2]),
            initialVelocities=list(reference['initialVelocities'][:2]),
        )
    )
    system.AddObject(items.MassPoint2D(mass=mass, nodeNumber=node))
    for axis in (0, 1):
        _glue(system, tip, node, axis)


def _torques(system: Any, links: list[list[Any]], case: Case) -> None:
    places = ((links[0][0], 0, 1.0), (links[0][-1], 1, -1.0), (links[1][0], 1, 1.0))
    for node, joint, sign in places:
        marker = system.AddMarker(items.MarkerNodeRigid(nodeNumber=node))

        def torque(
            mbs: Any, time: float, load: Any, joint: int = joint, sign: float = sign
        ) -> Any:
            return [0.0, 0.0, sign * case.torque(time)[joint]]

        system.AddLoad(
            items.LoadTorqueVector(
                markerNumber=marker, loadVector=[0.0, 0.0, 1.0], loadVectorUserFunction=torque
            )
        )


def _measure(system: Any, links: list[list[Any]]) -> list[float]:
    def place(node: Any) -> Array:
        moved = system.GetNodeOutput(node, exu.OutputVariableType.Coordinates)
        return np.asarray(moved) + np.asarray(system.GetNode(node)['referenceCoordinates'])

    (shoulder, end), (elbow, tip) = ((place(nodes[0]), place(nodes[-1])) for nodes in links)
    angles = [float(np.arctan2(p[3], p[2])) for p in (shoulder, end, elbow)]
    bends = []
    for first, last, angle in ((shoulder, end, angles[0]), (elbow, tip, angles[2])):
        across = np.array([-np.sin(angle), np.cos(angle)])
        bends.append(float(across @ (last[:2] - first[:2])))
    return [angles[0], angles[2] - angles[1], float(tip[0]), float(tip[1]), *bends]

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
The arm linearised about rest: matrices, natural frequencies, data for transfer functions.

At rest with straight links all Coriolis and centrifugal terms are of second order, so that both
models reduce to M x'' + D x' + K x = B tau in the coordinates of the plant: theta1, theta2, then
the modal ones.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from flexarm_ros.core.arm.full.model import make_constants
from flexarm_ros.core.arm.full.plant import elastic_diagonals, mass_matrix
from flexarm_ros.core.arm.kinematics import make_point
from flexarm_ros.core.arm.plant_eq14 import Eq14Matrices
from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.core.parameters.sections import PlantParameters, RunConfig
import numpy as np

JOINTS = {
    'locked': (True, True),
    'free': (False, False),
    'shoulder-locked': (True, False),
    'elbow-locked': (False, True),
}
"""Joint condition -> whether shoulder and elbow are locked."""


@dataclass(frozen=True)
class LinearArm:
    """
    M x'' + D x' + K x = B tau about a rest pose; n = 2 + 2 modes.

    ``mass``, ``damping`` and ``stiffness`` ``(n, n)`` (SI units of the
    coordinates: rad for the joints), ``torque`` ``(n, 2)`` = B, ``deflection``
    ``(2, n)``: delta1 and delta2 = deflection x.  ``theta1`` and ``theta2``,
    rad, are the pose.  ``kept``: the plant's coordinates in x, all but those of locked joints.
    """

    plant: PlantParameters
    theta1: float
    theta2: float
    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray
    torque: FloatArray
    deflection: FloatArray
    kept: tuple[int, ...]

    def point(self, location: float, elastic: bool = True) -> FloatArray:
        """
        Return C, shape ``(2, n)``: (dx, dy) of a point is C x, its velocity C x'.

        ``location``: m from the shoulder along the arm; ``elastic`` false:
        the point of the rigid arm with these joint angles.  Frame ``base``.
        """
        point = make_point(self.plant, location, elastic)
        pose = np.zeros(2 + 2 * self.plant.modes)
        pose[:2] = self.theta1, self.theta2
        columns = [point(pose, unit)[2:] for unit in np.eye(len(pose))[list(self.kept)]]
        return np.asarray(np.array(columns).T.copy())

    def lock(self, shoulder: bool, elbow: bool) -> LinearArm:
        """Return the arm without the locked joints' coordinates (and torques)."""
        gone = {joint for joint, locked in enumerate((shoulder, elbow)) if locked}
        keep = [row for row, coordinate in enumerate(self.kept) if coordinate not in gone]
        inputs = [joint for joint in (0, 1) if joint in self.kept and joint not in gone]
        square = np.ix_(keep, keep)
        return replace(
            self,
            mass=self.mass[square],
            damping=self.damping[square],
            stiffness=self.stiffness[square],
            torque=np.eye(2 + 2 * self.plant.modes)[np.ix_([self.kept[i] for i in keep], inputs)],
            deflection=self.deflection[:, keep],
            kept=tuple(self.kept[i] for i in keep),
        )

    def state_space(self) -> tuple[FloatArray, FloatArray]:
        """Return A ``(2n, 2n)`` and B ``(2n, inputs)`` for the state (x, x')."""
        size = len(self.mass)
        state, force = np.zeros((2 * size, 2 * size)), np.zeros((2 * size, self.torque.shape[1]))
        state[:size, size:] = np.eye(size)
        state[size:, :size] = -np.linalg.solve(self.mass, self.stiffness)
        state[size:, size:] = -np.linalg.solve(self.mass, self.damping)
        force[size:] = np.linalg.solve(self.mass, self.torque)
        return state, force


def linearise(config: RunConfig, theta2: float, theta1: float = 0.0) -> LinearArm:
    """
    Return the arm of ``config.plant`` linearised about rest at these angles, rad.

    Links straight, no torques.  Model ``eq14`` gives the matrices of (14).
    """
    plant = config.plant
    size = 2 + 2 * plant.modes
    pose, torque = np.zeros(size), np.zeros((size, 2))
    mass: FloatArray
    stiffness: FloatArray
    damping: FloatArray
    shape: FloatArray
    pose[1] = theta2
    torque[0, 0] = torque[1, 1] = 1.0
    ends = np.zeros((2, size))
    if plant.model == 'eq14':
        matrices = Eq14Matrices(plant)
        mass, stiffness, damping = matrices.mass_at(theta2), matrices.stiffness, matrices.damping
        shape = matrices.end_shape[2:].reshape(2, plant.modes)
    else:
        mass = mass_matrix(plant, pose)
        stiffness, damping = elastic_diagonals(plant)
        shape = make_constants(plant)[0].links['flexible_end']
    half = 2 + plant.modes
    ends[0, 2:half], ends[1, half:] = shape
    return LinearArm(
        plant=plant,
        theta1=theta1,
        theta2=theta2,
        mass=mass,
        damping=np.diag(damping),
        stiffness=np.diag(stiffness),
        torque=torque,
        deflection=ends,
        kept=tuple(range(size)),
    )


def natural_frequencies(config: RunConfig, theta2: float, joints: str) -> FloatArray:
    """
    Return the undamped natural frequencies, rad/s, ascending, without rigid-body modes.

    ``joints``: a key of :data:`JOINTS`.  A free joint has a rigid-body mode
    and its hub inertia counts; that of a locked joint does not.
    """
    arm = linearise(config, theta2)
    mass = arm.mass
    for joint, locked in enumerate(JOINTS[joints]):
        if not locked:
            # No stiffness acts on a free joint: it is eliminated exactly, so that no
            # eigenvalue 0 degrades the accuracy of the others.
            column = mass[:, joint]
            mass = mass - np.outer(column, column) / mass[joint, joint]
    root = np.sqrt(np.diag(arm.stiffness)[2:])
    squares = np.linalg.eigvalsh(mass[2:, 2:] / np.outer(root, root))[::-1]
    return np.asarray(1.0 / np.sqrt(squares))

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
The columns of ``trajectory.csv``: the one declaration of those that every run has.

Header, units and descriptions of `flexarm_ros.api`, labels of figures and pages, and the table in
docs/reference/outputs.md derive from it; optional parts add columns of their own
(`flexarm_ros.core.run.part.Column`).
"""

from __future__ import annotations

from typing import NamedTuple

from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.parts import columns


class RowColumn(NamedTuple):
    """
    A column of every run.

    ``meaning``: frame ``base``, angles counter-clockwise.  ``label`` is for figures, its last word
    the symbol; empty: the name.
    """

    name: str
    unit: str
    meaning: str
    label: str = ''


ROW_COLUMNS = (
    RowColumn('t', 's', 'simulated time', 'time t'),
    RowColumn('theta1', 'rad', 'tangent of link 1 at the shoulder, from x', 'joint angle θ₁'),
    RowColumn(
        'theta2', 'rad',
        'tangent of link 2 at the elbow, from the tangent at the end of link 1', 'joint angle θ₂',
    ),
    RowColumn('dtheta1', 'rad/s', 'rate of theta1'),
    RowColumn('dtheta2', 'rad/s', 'rate of theta2'),
    RowColumn('delta1', 'm', 'end deflection of link 1, positive to the left', 'deflection δ₁'),
    RowColumn('delta2', 'm', 'end deflection of link 2, positive to the left', 'deflection δ₂'),
    RowColumn('elbow_x', 'm', 'elbow, with deflection'),
    RowColumn('elbow_y', 'm', 'elbow, with deflection'),
    RowColumn('tip_x', 'm', 'tip, with deflection'),
    RowColumn('tip_y', 'm', 'tip, with deflection'),
    RowColumn(
        'rigid_x', 'm', 'end effector from the rigid kinematics of the joint angles',
        'end effector x',
    ),
    RowColumn(
        'rigid_y', 'm', 'end effector from the rigid kinematics of the joint angles',
        'end effector y',
    ),
    RowColumn('meas_x', 'm', 'measurement of the tip sensor as delivered', 'measured x'),
    RowColumn('meas_y', 'm', 'measurement of the tip sensor as delivered', 'measured y'),
    RowColumn('ref_x', 'm', 'reference, not delayed'),
    RowColumn('ref_y', 'm', 'reference, not delayed'),
    RowColumn('tau1', 'N m', 'torque at the shoulder, held for a tick', 'torque τ₁'),
    RowColumn('tau2', 'N m', 'torque at the elbow, held for a tick', 'torque τ₂'),
    RowColumn('lambda', '', 'gain of the fuzzy law', 'gain λ'),
)  # fmt: skip
"""In the order of the file, in which `trajectory_rows.fill_rows` computes them."""

COLUMNS = tuple(column.name for column in ROW_COLUMNS)


def header(config: RunConfig) -> tuple[str, ...]:
    """Return the header of ``trajectory.csv``: `COLUMNS`, then those of optional parts."""
    return tuple(units(config))


def units(config: RunConfig | None) -> dict[str, str]:
    """
    Return the unit of each column of a run, empty for a number, in the order of the file.

    None: a scenario that is unknown here; optional parts then have none.
    """
    optional = columns(config) if config is not None else ()
    return {
        **{column.name: column.unit for column in ROW_COLUMNS},
        **{column.name: column.unit for column in optional},
    }


def axis_label(name: str, symbol: bool = False) -> str:
    """Return the label of a column of every run with its unit, or its ``symbol`` alone."""
    column = ROW_COLUMNS[COLUMNS.index(name)]
    text = column.label or name
    text = text.rpartition(' ')[2] if symbol else text
    return f'{text}, {column.unit}' if column.unit else text

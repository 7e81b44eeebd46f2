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
The paper's own figures, one file each, if the given runs can show them.

Figures 2 and 3 (membership functions) need a fuzzy run.  Figures 5 and 7 (paths) and 6 and 8
(zoomed transients) need, for the sensor at the tip and at 2.25 m along link 2, at least two of
the three cases of both laws, without external nodes.  Figures 1 and 4 are drawings of the arm
and of the control loop; ``docs/model.md`` has both.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from flexarm_ros.analysis.figures.corners import corner_figure
from flexarm_ros.analysis.figures.fls import gain_kn, sets_figure
from flexarm_ros.analysis.figures.paths import path_figure
from flexarm_ros.analysis.figures.style import group_switches, Panel

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PLACES = {9.0: ('figure_5', 'figure_6', (1, 0)), 6.75: ('figure_7', 'figure_8', (1, 2))}
"""Sensor location, m -> stems of paths and of transients, the switches zoomed for PD, FLS."""

LAWS = ('pd', 'fls')
LEAST_CASES = 2


def paper_figures(groups: Sequence[Panel]) -> Iterator[tuple[str, Figure]]:
    """Yield the stem and the figure of each figure of the paper that the groups can show."""
    fuzzy = [run for group in groups for run in group.runs if run.law == 'fls']
    if fuzzy:
        kn = gain_kn(fuzzy)
        yield 'figure_2', sets_figure('inputs', kn)
        yield 'figure_3', sets_figure('output', kn)
    for place, (paths, transients, switches) in PLACES.items():
        pair = [group for law in LAWS for group in groups if _shows(group, law, place)]
        if len(pair) < len(LAWS):
            continue
        zoomed = all(len(group_switches(group)) > max(switches) for group in pair)
        yield paths, path_figure(pair, switches if zoomed else ())
        if zoomed:
            yield transients, corner_figure(pair, switches)


def _shows(group: Panel, law: str, place: float) -> bool:
    return (
        group.law == law
        and not any(run.external for run in group.runs)
        and group.location is not None
        and abs(group.location - place) < 1e-9
        and len({run.role for run in group.runs if run.role}) >= LEAST_CASES
    )

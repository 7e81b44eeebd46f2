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

"""``fa.plot`` and ``fa.report``: figures and the HTML page of one or several runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import io
import os
from pathlib import Path
from typing import Any, Protocol, TYPE_CHECKING

from flexarm_ros.analysis.figures import style as figures_style
from flexarm_ros.analysis.report import runs as read
from flexarm_ros.core.numerics.compiled import FloatArray
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

KINDS = ('paths', 'corners', 'signals', 'parts', 'fls')


class RunData(Protocol):
    """The part of a run that figures need; implemented by `flexarm_ros.Run`."""

    @property
    def name(self) -> str:
        """Name of the scenario."""

    @property
    def directory(self) -> Path | None:
        """Directory of the run's files, or None."""

    @property
    def summary(self) -> Mapping[str, Any]:
        """Content of ``summary.json``."""

    @property
    def scenario(self) -> Mapping[str, Mapping[str, Any]]:
        """Parameters by section."""

    @property
    def trajectory(self) -> NDArray[np.void]:
        """Rows of ``trajectory.csv`` as a structured array."""


def plot(runs: RunData | Sequence[RunData], kind: str = 'paths') -> Figure:
    """
    Draw one run, or several overlaid, and return the matplotlib figure.

    Parameters
    ----------
    runs
        One run or several; a figure shows runs of one law and one sensor location.
    kind
        ``paths``: the end effector's path and its reference.  ``corners``: the transients where
        the reference changes direction.  ``signals``: error, deflections, torques and lambda
        over time, for the first law and sensor location of the runs.  ``parts``: the same for
        the columns of optional parts, as strain gauges.  ``fls``: membership functions, surface,
        and the part of it used by the runs.

    Raises
    ------
    ValueError
        For an unknown kind, or one that the runs have no data for.

    """
    if kind not in KINDS:
        raise ValueError(f'kind: {kind!r}, allowed: {", ".join(KINDS)}')
    groups = figures_style.panels(_as_read(runs))
    with figures_style.drawing():
        return _shown(_draw(groups, kind))


def _draw(groups: list[figures_style.Panel], kind: str) -> Figure:
    from flexarm_ros.analysis.figures.corners import corner_figure
    from flexarm_ros.analysis.figures.paths import path_figure
    from flexarm_ros.analysis.figures.runs import part_figure, signal_figure

    if kind == 'paths':
        return path_figure(groups)
    if kind == 'signals':
        return signal_figure(groups[0])
    if kind == 'parts':
        if not any(run.optional() for run in groups[0].runs):
            raise ValueError("kind: 'parts', but no optional part of the runs has a column")
        return part_figure(groups[0])
    if kind == 'corners':
        if not any(figures_style.group_switches(group) for group in groups):
            raise ValueError("kind: 'corners', but the reference never switches its direction")
        return corner_figure(groups)
    from flexarm_ros.analysis.figures.fls import fls_figure

    fuzzy = [run for group in groups for run in group.runs if run.law == 'fls']
    if not fuzzy:
        raise ValueError("kind: 'fls', but no run has controller.law: fls")
    return fls_figure(fuzzy)


def report(runs: RunData | Sequence[RunData], path: str | os.PathLike[str]) -> Path:
    """
    Write the self-contained HTML page of some runs to ``path`` and return it.

    The page is that of ``flexarm report``: interactive, and it works offline.

    Parameters
    ----------
    runs
        One run or several.
    path
        The file to write; an existing one is replaced.

    """
    from flexarm_ros.analysis.report.page import render
    from flexarm_ros.bag.mcap.files import write_atomically

    target = Path(path)
    write_atomically(target, render(_as_read(runs)))
    return target


def _as_read(runs: RunData | Sequence[RunData]) -> list[read.ReportedRun]:
    """Convert the runs to those of the report."""
    some = list(runs) if isinstance(runs, Sequence) else [runs]
    if not some:
        raise ValueError('runs: none given')
    return [
        read.ReportedRun(
            run.directory or Path(run.name),
            {
                name: read.without_extremes(run.trajectory[name])
                for name in run.trajectory.dtype.names or ()
            },
            run.summary,
            run.scenario,
        )
        for run in some
    ]


def _shown(figure: Figure) -> Figure:
    """Make a figure without pyplot displayable in notebooks."""

    def png() -> bytes:
        buffer = io.BytesIO()
        figure.savefig(buffer, format='png', dpi=110)
        return buffer.getvalue()

    held: Any = figure
    held._repr_png_ = png
    return figure


def frame(
    arm: FloatArray, elbow: int, target: FloatArray, reach: float, title: str
) -> NDArray[np.uint8]:
    """
    Draw the arm at one instant and return the image, shape ``(480, 480, 3)``.

    ``arm`` has the points along the arm, shape ``(n, 2)``, with the elbow at index ``elbow``;
    ``target`` is the reference x and y; ``reach`` the length of the arm; m, frame ``base``.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.8, 4.8), dpi=100)
    canvas: Any = FigureCanvasAgg(figure)
    axis = figure.add_subplot()
    axis.plot(arm[:, 0], arm[:, 1], color=figures_style.BLUE, linewidth=2.2)
    axis.plot(*arm[[0, elbow]].T, 'o', color=figures_style.BLACK)
    axis.plot(*target, '+', color=figures_style.ORANGE, markersize=12)
    axis.set(xlim=(-1.1 * reach, 1.1 * reach), ylim=(-1.1 * reach, 1.1 * reach), aspect='equal')
    axis.set(xlabel='x, m', ylabel='y, m', title=title)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[:, :, :3].copy()

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
Figures of runs for publication, PNG and SVG, in the style of the paper's Figures 5 to 8.

Matplotlib is imported when a figure is drawn, and without pyplot: no display and no global
state.  Equal runs and equal versions give equal files.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TYPE_CHECKING

from flexarm_ros.analysis.figures.corners import corner_figure
from flexarm_ros.analysis.figures.paths import path_figure
from flexarm_ros.analysis.figures.style import (
    drawing,
    GREY,
    group_switches,
    legend_below,
    line,
    new_figure,
    Panel,
    panel_title,
    panels,
    save,
    styled,
)
from flexarm_ros.analysis.report.data import ERRORS
from flexarm_ros.analysis.report.runs import load_runs, ReportedRun
from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.core.run.results.columns import axis_label
import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write_figures(run_dirs: Sequence[Path | ReportedRun], out: Path) -> list[Path]:
    """
    Draw one run, or several overlaid, into ``out`` and return the files.

    ``paths``, ``corners`` (changes of the reference's direction), ``signals``
    (``signals_LAW_PLACE`` for each group of several), ``parts`` (``parts_LAW_PLACE``) if runs have
    columns of optional parts, for the fuzzy law ``fls``, and with runs of both laws ``figure_N``
    for each figure of the paper that they show; each as PNG and SVG.
    Raises ``RunError`` if a directory is not a run.
    """
    runs = load_runs(run_dirs)
    out.mkdir(parents=True, exist_ok=True)
    groups = panels(runs)
    with drawing():
        written = save(path_figure(groups), out, 'paths')
        if any(run.switches() for run in runs):
            written += save(corner_figure(groups), out, 'corners')
        for group in groups:
            suffix = '' if len(groups) == 1 else f'_{group.slug}'
            written += save(signal_figure(group), out, f'signals{suffix}')
            if any(run.optional() for run in group.runs):
                written += save(part_figure(group), out, f'parts{suffix}')
        if any(run.law == 'fls' for run in runs):
            from flexarm_ros.analysis.figures.fls import fls_figure

            fuzzy = next(group for group in groups if group.law == 'fls')
            written += save(fls_figure(fuzzy.runs), out, 'fls')
        if len(groups) > 1:
            from flexarm_ros.analysis.figures.paper import paper_figures

            for stem, figure in paper_figures(groups):
                written += save(figure, out, stem)
    return written


def signal_figure(group: Panel) -> Figure:
    """Return error, deflections, torques and lambda over time, the runs of a group overlaid."""
    names = ['delta1', 'delta2', 'tau1', 'tau2']
    if any(np.isfinite(run.columns['lambda']).any() for run in group.runs):
        names.append('lambda')

    def signals(run: ReportedRun) -> dict[str, FloatArray]:
        columns = {axis_label(name): run.columns[name] for name in names}
        return {ERRORS['error'][0]: run.error(), **columns}

    return _over_time(group, signals)


def part_figure(group: Panel) -> Figure:
    """Return the columns of optional parts over time, the runs of a group overlaid."""
    return _over_time(group, ReportedRun.optional, parse_math=False)


def _over_time(
    group: Panel,
    signals: Callable[[ReportedRun], Mapping[str, FloatArray]],
    **label_options: Any,
) -> Figure:
    """Return a panel for each label that ``signals`` of a run has values for."""
    drawn = [(run, style, label, signals(run)) for run, style, label in styled(group)]
    names = list(dict.fromkeys(name for *_, held in drawn for name in held))
    figure = new_figure(7.4, 1.35 * len(names) + 0.9)
    axes = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
    for axis, name in zip(axes, names, strict=True):
        for time in group_switches(group):
            axis.axvline(time, color=GREY, linewidth=0.7, linestyle=':')
        for run, style, label, held in drawn:
            if name in held:
                line(axis, run.columns['t'], held[name], style, label)
        axis.set_ylabel(name, **label_options)
    axes[-1].set_xlabel('time, s  (dotted: the reference switches its direction)')
    axes[0].set_title(panel_title(group))
    figure.align_ylabels(axes)
    if len(drawn) > 1:
        columns = 3 if max(len(label) for _, _, label, _ in drawn) < 24 else 1
        handles = {
            text: item
            for axis in axes
            for item, text in zip(*axis.get_legend_handles_labels(), strict=True)
        }
        legend_below(axes[-1], handles.values(), handles.keys(), ncols=columns, inches=0.42)
    return figure

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
Shared by all figures: line styles, panels, and writing of files.

The colours are those of ``analysis.palette``.  Curves of one law that lie on one another stay
distinct, also in greyscale prints: a thin strong one is drawn over a wider, softer one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import contextlib
from dataclasses import dataclass
from itertools import chain, count
import os
from pathlib import Path
import re
import sys
import textwrap
from types import ModuleType
from typing import Any, TYPE_CHECKING

from flexarm_ros.analysis.palette import color, LAW_HUES, SPARE_HUES
from flexarm_ros.analysis.report.runs import (
    COLLOCATED,
    CORRECTED,
    external_parts,
    labels,
    law_name,
    NONCOLLOCATED,
    ReportedRun,
)
from flexarm_ros.bag.mcap.files import naming
from flexarm_ros.core.numerics.compiled import FloatArray
import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BLUE, ORANGE, SKY = color('pd'), color('fls'), color('pd', 'soft', 'paper')
GREEN, PURPLE, AMBER, GREY = map(color, SPARE_HUES)
BLACK = '#000000'


@dataclass(frozen=True)
class Style:
    """Line style of a curve: hue and shade of the palette, dashes in widths, width in points."""

    hue: str
    shade: str = 'base'
    dashes: tuple[float, ...] = ()
    width: float = 1.3

    @property
    def color(self) -> str:
        """Return the colour on paper."""
        return color(self.hue, self.shade, 'paper')

    @property
    def drawn(self) -> dict[str, Any]:
        """Return the style as arguments of matplotlib's ``plot``."""
        dashes = (0, self.dashes) if self.dashes else '-'
        return {'color': self.color, 'linestyle': dashes, 'linewidth': self.width}


SOLID, DASHED, DOTTED, DASH_DOTTED = (), (4.5, 2.0), (1.0, 1.6), (6.0, 1.6, 1.0, 1.6)
REFERENCE: Any = {'color': BLACK, 'linewidth': 0.8, 'linestyle': (0, (6, 3))}
"""Arguments of ``plot`` for a reference."""

# Shade, width, and dashes at the first sensor location and at further ones.
_ROLES = {
    COLLOCATED: ('soft', 3.4, (SOLID, SOLID)),
    NONCOLLOCATED: ('base', 1.8, (SOLID, DASHED)),
    CORRECTED: ('strong', 0.9, ((4.0, 3.0), DOTTED)),
}
"""The paper's three cases, the widest first: drawn in this order, equal curves stay visible."""

SETTINGS: Any = {
    'font.family': 'DejaVu Sans',
    'font.size': 9.0,
    'axes.titlesize': 10.0,
    'axes.grid': True,
    'axes.axisbelow': True,
    'axes.spines.top': False,
    'axes.spines.right': False,
    'grid.color': '#d9d9d9',
    'grid.linewidth': 0.6,
    'lines.linewidth': 1.3,
    'legend.fontsize': 8.0,
    'legend.framealpha': 0.9,
    'savefig.dpi': 160,
    'svg.fonttype': 'path',
    'svg.hashsalt': 'flexarm_ros',
    'path.simplify': True,
    'agg.path.chunksize': 20000,
}
"""Matplotlib settings; the salt and ``METADATA`` make equal data give equal files."""

TITLE_CHARACTERS = 48
"""Longest line of a title that fits the narrowest panel with a title, 5 inches."""

METADATA: dict[str, dict[str, Any]] = {
    'png': {'Software': None},
    'svg': {'Date': None, 'Creator': 'flexarm_ros'},
}


@dataclass(frozen=True)
class Panel:
    """Runs that share a figure: one control law, one sensor location."""

    law: str
    location: float | None
    runs: tuple[ReportedRun, ...]

    @property
    def title(self) -> str:
        """Return the law and the sensor location of the runs."""
        place = '' if self.location is None else f', sensor at {self.location:g} m'
        return law_name(self.law) + place

    @property
    def slug(self) -> str:
        """Return a text for file names."""
        place = '' if self.location is None else f'_{self.location:g}m'
        law = ''.join(c if c.isalnum() and c.isascii() else '_' for c in self.law) or 'unknown'
        return law + place.replace('.', 'p')


def panels(runs: Sequence[ReportedRun]) -> list[Panel]:
    """
    Return the runs grouped as in the paper's Figures 5 and 7.

    A collocated run appears in every panel of its law, for comparison.
    """
    result = []
    for law in dict.fromkeys(run.law for run in runs):
        of_law = [run for run in runs if run.law == law]
        places: list[float | None] = []
        places += sorted(
            {run.location for run in of_law if run.location is not None}, reverse=True
        )
        for place in places or [None]:
            members = tuple(run for run in of_law if run.location in (None, place))
            result.append(Panel(law, place, members))
    return result


def styles(runs: Sequence[ReportedRun]) -> list[Style]:
    """
    Return a style for each run, no two alike.

    A law has its hue, and each of the paper's cases its shade, width and dashes in it.  A run
    that would look like an earlier one gets a hue that belongs to no law.
    """
    if len(runs) == 1:
        return [Style(_hues(runs)[runs[0].law])]
    hues = _hues(runs)
    places = sorted({run.location for run in runs if run.location is not None}, reverse=True)
    found: list[Style] = []
    for run in runs:
        looks = chain([_look(run, hues[run.law], places)], _spares())
        found.append(next(look for look in looks if look not in found))
    return found


def _hues(runs: Sequence[ReportedRun]) -> dict[str, str]:
    """Return the hue of each law: its own, or the next of those that belong to no law."""
    others = iter(SPARE_HUES * len(runs))
    return {
        law: LAW_HUES.get(law) or next(others) for law in dict.fromkeys(run.law for run in runs)
    }


def _look(run: ReportedRun, hue: str, places: Sequence[float]) -> Style:
    if run.role not in _ROLES:
        return Style(hue)
    shade, width, dashes = _ROLES[run.role]
    place = 0 if run.location is None else places.index(run.location)
    return Style(hue, shade, dashes[min(place, 1)], width)


def _spares() -> Iterator[Style]:
    """Yield looks for runs of one case, without end: hues, dashes, shades, ever thinner ones."""
    for turn in count():
        for shade in ('base', 'strong', 'soft'):
            for dashes in (SOLID, DASHED, DASH_DOTTED, DOTTED):
                for hue in SPARE_HUES:
                    yield Style(hue, shade, dashes, 1.3 * 0.8**turn)


def wrap(text: str, width: int = 30) -> str:
    """
    Return a text in lines of at most ``width`` characters.

    Lines end at spaces; a longer word, such as the name of a law of a plug-in, at its punctuation.
    """
    lines: list[str] = []
    for line in textwrap.wrap(text, width, break_on_hyphens=False, break_long_words=False):
        if len(line) > width:
            parts = textwrap.wrap(re.sub(r'(?<=[._:/-])', ' ', line), width)
            lines += [part.replace(' ', '') for part in parts]
        else:
            lines.append(line)
    return '\n'.join(lines)


@contextlib.contextmanager
def drawing() -> Iterator[None]:
    """Draw with ``SETTINGS`` in the block, whatever MPLBACKEND is."""
    with _matplotlib().rc_context(SETTINGS):
        yield


def _matplotlib() -> ModuleType:
    """
    Import matplotlib, which refuses an MPLBACKEND that is not installed even if unused.

    The variable is removed during the import, since a failed import cannot always be repeated.
    """
    if 'matplotlib' in sys.modules:
        return sys.modules['matplotlib']
    backend = os.environ.pop('MPLBACKEND', None)
    try:
        import matplotlib
    finally:
        if backend is not None:
            os.environ['MPLBACKEND'] = backend
    if backend:
        with contextlib.suppress(ValueError):  # otherwise it applies to the user's figures
            matplotlib.rcParams['backend'] = backend
    return matplotlib


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure, sizes in inches, without display or global state."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout='constrained')


def save(figure: Figure, out: Path, stem: str) -> list[Path]:
    """
    Write a figure as PNG and SVG and return both paths.

    The layout, which takes most of the time, is computed once, for the first file.
    """
    paths = []
    for kind, metadata in METADATA.items():
        path = out / f'{stem}.{kind}'
        with naming(path):
            figure.savefig(path, metadata=metadata)
        figure.set_layout_engine('none')
        paths.append(path)
    return paths


def styled(group: Panel) -> list[tuple[ReportedRun, Style, str]]:
    """Return each run of a group with its style and its label, the widest curve first."""
    names = labels(group.runs, short=True)
    found = zip(group.runs, styles(group.runs), names, strict=True)
    return sorted(found, key=lambda item: -item[1].width)


def panel_title(group: Panel) -> str:
    """Return the group's title; for a single run also its case and a failure."""
    if len(group.runs) > 1:
        return wrap(group.title, TITLE_CHARACTERS)
    run = group.runs[0]
    title = ', '.join(filter(None, (group.title, run.role, external_parts(run))))
    title = wrap(title, TITLE_CHARACTERS)
    if run.stable is False and run.rows:
        title += f'\nunstable, stopped at t = {run.columns["t"][-1]:.3g} s'
    return title


def between(run: ReportedRun, start: float, end: float) -> slice:
    """Return the rows of a time span."""
    first, last = np.searchsorted(run.columns['t'], (start, end))
    return slice(int(first), int(last))


def line(axis: Axes, x: FloatArray, y: FloatArray, style: Style, label: str) -> None:
    """Draw a curve; one with very few rows also gets dots, to be visible."""
    options: dict[str, Any] = {'marker': '.'} if len(x) < 3 else {}
    axis.plot(x, y, label=label, **style.drawn, **options)


def legend_below(axis: Axes, *entries: Any, inches: float, **options: Any) -> None:
    """Put a legend under an axis, ``inches`` below it, where it covers no curve."""
    from matplotlib.transforms import ScaledTranslation

    down = ScaledTranslation(0.0, -inches, axis.figure.dpi_scale_trans)
    axis.legend(
        *entries, loc='upper center', bbox_to_anchor=(0.5, 0.0),
        bbox_transform=axis.transAxes + down, frameon=False, **options,
    )  # fmt: skip


def group_switches(group: Panel) -> list[float]:
    """Return the direction switches, s, of the run with the latest end."""
    return max((run.switches() for run in group.runs), key=len)

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

"""How the pictures of docs/validation.md are drawn and written: as all others are."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from flexarm_ros.analysis.figures.style import (
    AMBER,
    BLUE,
    GREEN,
    GREY,
    METADATA,
    ORANGE,
    PURPLE,
    SETTINGS,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ['AMBER', 'BLUE', 'GREEN', 'GREY', 'ORANGE', 'PURPLE', 'new_figure', 'save']


def new_figure(title: str, inches: tuple[float, float] = (6.5, 3.6)) -> tuple[Figure, Axes]:
    """Return a figure with one pair of axes."""
    import matplotlib
    from matplotlib.figure import Figure

    matplotlib.rcParams.update(SETTINGS)
    figure = Figure(figsize=inches, layout='constrained')
    axis = figure.add_subplot()
    axis.set_title(title)
    return figure, axis


def save(figure: Figure, path: Path) -> None:
    """Write a PNG; equal data give equal files."""
    figure.savefig(path, metadata=METADATA['png'])

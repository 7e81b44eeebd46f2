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

"""The page of a fit: parameters, fits, warnings and pictures in one HTML file."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from html import escape
import math
from pathlib import Path

from flexarm_ros.identification.estimate.fitting import Fit
from flexarm_ros.identification.prediction.predict import Channel
from flexarm_ros.identification.setting import spec_of

STYLE = (
    'body{font:15px/1.5 sans-serif;max-width:70em;margin:2em auto;padding:0 1em;color:#222}'
    'table{border-collapse:collapse;margin:1em 0}td,th{padding:.25em .8em;border-bottom:1px '
    'solid #ddd;text-align:right}td:first-child,th:first-child,td:last-child{text-align:left}'
    'img{max-width:100%}.warning{color:#a33}'
)


def page(fit: Fit, pictures: Sequence[Path]) -> str:
    """Return the page as text, with the PNG files of the pictures embedded."""
    names = ', '.join(Path(task.recording.name).name for task in fit.problem.tasks)
    parts = [
        f'<h1>Fit of {escape(names)}</h1>',
        f'<p>Mode {fit.problem.mode}, {_length(fit.problem.window)}.</p>',
        *(f'<p class="warning">{escape(text)}</p>' for text in fit.warnings),
        _parameters(fit),
        _channels('Fitted', fit.channels),
        _channels('Hold-out, not fitted', fit.held_out) if fit.held_out else '',
        *map(_picture, pictures),
    ]
    return (
        '<!DOCTYPE html><html lang="en"><head><meta charset="utf-8">'
        f'<title>flexarm fit: {escape(names)}</title><style>{STYLE}</style></head><body>'
        f'{"".join(parts)}</body></html>\n'
    )


def _length(window: float | None) -> str:
    return 'whole recordings' if window is None else f'windows of {window:g} s'


def _parameters(fit: Fit) -> str:
    rows = []
    for key, row in fit.parameters.items():
        std = '' if row['std'] is None else f'{row["std"]:.2g}'
        rows.append(
            f'<tr><td>{key}</td><td>{row["value"]:.5g}</td><td>{std}</td>'
            f'<td>{row["start"]:.5g}</td><td>{escape(spec_of(key).unit)}</td>'
            f'<td>{row["status"]}</td></tr>'
        )
    head = ''.join(f'<th>{t}</th>' for t in ('key', 'value', 'std', 'start', 'unit', 'status'))
    return f'<table><tr>{head}</tr>{"".join(rows)}</table>'


def _channels(title: str, channels: Mapping[str, Channel]) -> str:
    rows = []
    for name, channel in channels.items():
        cells = (
            '' if value is None or not math.isfinite(value) else f'{value:.4g}'
            for value in channel.numbers().values()
        )
        rows.append(f'<tr><td>{name}</td>{"".join(f"<td>{cell}</td>" for cell in cells)}</tr>')
    head = ''.join(f'<th>{t}</th>' for t in ('channel', 'fit, %', 'vaf, %', 'rms, SI'))
    return f'<h2>{title}</h2><table><tr>{head}</tr>{"".join(rows)}</table>'


def _picture(path: Path) -> str:
    data = base64.b64encode(path.read_bytes()).decode('ascii')
    return f'<p><img alt="{escape(path.stem)}" src="data:image/png;base64,{data}"></p>'

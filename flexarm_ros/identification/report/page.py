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

"""The pages of a fit and of a prediction: numbers, warnings and pictures in one HTML file."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from html import escape
import math
from pathlib import Path

from flexarm_ros.identification.estimate.fitting import Fit
from flexarm_ros.identification.prediction.predict import Channel, Prediction
from flexarm_ros.identification.prediction.ringing import Mode
from flexarm_ros.identification.setting import spec_of

STYLE = (
    'body{font:15px/1.5 sans-serif;max-width:70em;margin:2em auto;padding:0 1em;color:#222}'
    'table{border-collapse:collapse;margin:1em 0}td,th{padding:.25em .8em;border-bottom:1px '
    'solid #ddd;text-align:right}td:first-child,th:first-child,td:last-child{text-align:left}'
    '.wide{overflow-x:auto}img{max-width:100%}.warning{color:#a33}'
)


def fit_page(fit: Fit, pictures: Sequence[Path]) -> str:
    """Return the page of a fit as text, with the PNG files of the pictures embedded."""
    names = ', '.join(Path(task.recording.name).name for task in fit.problem.tasks)
    parts = [
        f'<p>Mode {fit.problem.mode}, {_length(fit.problem.window)}.</p>',
        *_warnings(fit.warnings),
        _parameters(fit),
        _channels('Fitted', fit.channels),
        _channels('Hold-out, not fitted', fit.held_out) if fit.held_out else '',
    ]
    return _page('fit', f'Fit of {names}', parts, pictures)


def prediction_page(
    prediction: Prediction, rings: tuple[Sequence[Mode], Sequence[Mode]], pictures: Sequence[Path]
) -> str:
    """
    Return the page of a prediction as text, with the PNG files of the pictures embedded.

    ``rings``: the modes that ring at rest, measured and predicted.
    """
    name = Path(prediction.recording.name).name
    offsets = ', '.join(f'{key} {value:.4g}' for key, value in prediction.offsets.items())
    parts = [
        f'<p>Mode {prediction.mode}, {_length(prediction.window)}.</p>',
        *_warnings((*prediction.recording.notes, *prediction.notes)),
        f'<p>Offsets taken from the recording: {escape(offsets)}.</p>' if offsets else '',
        _channels('Measured and predicted', prediction.channels),
        _ringing(*rings),
    ]
    return _page('predict', f'Prediction of {name}', parts, pictures)


def _page(command: str, title: str, parts: Sequence[str], pictures: Sequence[Path]) -> str:
    return (
        '<!DOCTYPE html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<title>flexarm {command}: {escape(title)}</title><style>{STYLE}</style></head><body>'
        f'<h1>{escape(title)}</h1>{"".join(parts)}{"".join(map(_picture, pictures))}'
        '</body></html>\n'
    )


def _ringing(measured: Sequence[Mode], predicted: Sequence[Mode]) -> str:
    rows = [
        f'<tr><td>{number}</td><td>{one.frequency:.3f}</td><td>{other.frequency:.3f}</td>'
        f'<td>{one.damping:.4f}</td><td>{other.damping:.4f}</td></tr>'
        for number, (one, other) in enumerate(zip(measured, predicted, strict=False), start=1)
    ]
    if not rows:
        return ''
    titles = (
        'mode', 'measured, Hz', 'predicted, Hz', 'measured damping ratio',
        'predicted damping ratio',
    )  # fmt: skip
    return _table('Ringing while the joints rest', titles, rows)


def _table(title: str, titles: Sequence[str], rows: Sequence[str]) -> str:
    head = ''.join(f'<th>{text}</th>' for text in titles)
    return f'<h2>{title}</h2><div class="wide"><table><tr>{head}</tr>{"".join(rows)}</table></div>'


def _warnings(texts: Sequence[str]) -> list[str]:
    return [f'<p class="warning">{escape(text)}</p>' for text in texts]


def _length(window: float | None) -> str:
    return 'complete recordings' if window is None else f'windows of {window:g} s'


def _parameters(fit: Fit) -> str:
    rows = []
    for key, row in fit.parameters.items():
        std = '' if row['std'] is None else f'{row["std"]:.2g}'
        rows.append(
            f'<tr><td>{key}</td><td>{row["value"]:.5g}</td><td>{std}</td>'
            f'<td>{row["start"]:.5g}</td><td>{escape(spec_of(key).unit)}</td>'
            f'<td>{row["status"]}</td></tr>'
        )
    return _table('Parameters', ('key', 'value', 'std', 'start', 'unit', 'status'), rows)


def _channels(title: str, channels: Mapping[str, Channel]) -> str:
    rows = []
    for name, channel in channels.items():
        cells = (
            '' if value is None or not math.isfinite(value) else f'{value:.4g}'
            for value in channel.numbers().values()
        )
        rows.append(f'<tr><td>{name}</td>{"".join(f"<td>{cell}</td>" for cell in cells)}</tr>')
    return _table(title, ('channel', 'fit, %', 'vaf, %', 'rms, SI'), rows)


def _picture(path: Path) -> str:
    data = base64.b64encode(path.read_bytes()).decode('ascii')
    return f'<p><img alt="{escape(path.stem)}" src="data:image/png;base64,{data}"></p>'

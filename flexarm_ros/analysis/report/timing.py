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

"""Timing of free-running runs: a table of counts, and histograms of jitter and latency."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from flexarm_ros.analysis.report.runs import labels, ReportedRun, RunError
from flexarm_ros.bag.errors import BagError
from flexarm_ros.bag.timing import read_timing
from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.core.run.results.real_time import bin_edges, RunTiming, spread
import numpy as np

_WIDTH, _HEIGHT, _FOOT, _LEFT = 480, 150, 34, 44
_LEAST_DECADES = 2


def timing_section(runs: Sequence[ReportedRun]) -> str:
    """
    Return the section on the timing of those runs that ran freely, empty without one.

    Raises ``RunError`` where a run's timing cannot be read.
    """
    try:
        found = [(label, read_timing(r.directory)) for r, label in
                 zip(runs, labels(runs), strict=True)]  # fmt: skip
    except BagError as error:
        raise RunError(str(error)) from None
    timed = [(label, timing) for label, timing in found if timing is not None]
    if not timed:
        return ''
    return (
        '<section aria-labelledby="h-timing"><h2 id="h-timing">Timing</h2>'
        f'{_table(timed)}{"".join(_pictures(label, timing) for label, timing in timed)}'
        '<p class="note">Late tick: it began a period or more after its deadline. Missed command: '
        'the answer to a tick had not arrived when the tick ended. Held command: no new one '
        'arrived for the tick. Command latency: from the begin of a tick to the arrival of the '
        'first command that answers it or a later one. Both axes of the histograms are '
        'logarithmic.</p></section>'
    )


def _table(timed: Sequence[tuple[str, RunTiming]]) -> str:
    rows = ''
    heads = ''.join(f'<th scope="col">{escape(label)}</th>' for label, _ in timed)
    summaries = [timing.summary() for _, timing in timed]
    for key in summaries[0]:
        name = key.removesuffix('_ms').replace('_', ' ').capitalize()
        if isinstance(summaries[0][key], dict):
            cells = [' / '.join(_number(s[key][q]) for q in ('p50', 'p99', 'max'))
                     for s in summaries]  # fmt: skip
            name += ', median / p99 / max <span class="unit">ms</span>'
        else:
            cells = [_number(s[key]) for s in summaries]
        held = ''.join(f'<td>{cell}</td>' for cell in cells)
        rows += f'<tr><th scope="row">{name}</th>{held}</tr>'
    head = f'<thead><tr><th scope="col">Timing</th>{heads}</tr></thead>'
    return (
        '<div class="scroll" tabindex="0" role="region" aria-label="Timing">'
        f'<table class="numbers">{head}<tbody>{rows}</tbody></table></div>'
    )


def _number(value: float | None) -> str:
    if value is None:
        return '–'
    return str(value) if isinstance(value, int) else f'{value:.4g}'


def _pictures(label: str, timing: RunTiming) -> str:
    return ''.join(
        f'<h3>{escape(f"{what}, {label}")}</h3>{histogram(what, values)}'
        for what, values in (('Tick jitter', timing.jitter), ('Command latency', timing.latency))
        if len(values)
    )


def histogram(what: str, seconds: FloatArray) -> str:
    """Return an SVG picture of the number of ticks by time; both axes are logarithmic."""
    edges = bin_edges()
    counts, _ = np.histogram(np.clip(seconds, edges[0], edges[-1]), edges)
    decade = len(edges) // 8
    first = int(np.flatnonzero(counts)[0]) // decade * decade
    last = max(
        -(-(int(np.flatnonzero(counts)[-1]) + 1) // decade), first // decade + _LEAST_DECADES
    )
    last = min(last * decade, len(counts))
    heights = np.log10(1.0 + counts[first:last]) / np.log10(1.0 + counts.max())
    plot = _HEIGHT - _FOOT - 8
    step = (_WIDTH - _LEFT) / (last - first)
    bars = ''.join(
        f'<rect x="{_LEFT + i * step:.1f}" y="{8 + plot * (1 - h):.1f}" '
        f'width="{step - 0.5:.1f}" height="{plot * h:.1f}"/>'
        for i, h in enumerate(heights)
        if h
    )
    marks = ''.join(
        _text(_LEFT + (i - first) * step, _HEIGHT - 18, f'{1e3 * edges[i]:g}')
        for i in range(first, last + 1, decade)
    )
    text = {key: _number(value) for key, value in spread(seconds).items()}
    said = (
        f'{what}: {len(seconds)} ticks, median {text["p50"]} ms, 99 % below {text["p99"]} ms, '
        f'largest {text["max"]} ms'
    )
    return (
        f'<svg viewBox="0 0 {_WIDTH + 20} {_HEIGHT}" width="{_WIDTH + 20}" height="{_HEIGHT}" '
        f'role="img" aria-label="{escape(said)}" fill="currentColor" font-size="11">'
        f'{bars}{marks}{_text(_LEFT - 6, 16, str(int(counts.max())), "end")}'
        f'{_text(_LEFT - 6, 8 + plot, "0", "end")}'
        f'{_text(_LEFT + (_WIDTH - _LEFT) / 2, _HEIGHT - 3, "ms")}'
        f'<text transform="translate(12 {8 + plot / 2:.0f}) rotate(-90)" '
        'text-anchor="middle">ticks</text></svg>'
        f'<p class="note">{escape(said)}.</p>'
    )


def _text(x: float, y: float, words: str, anchor: str = 'middle') -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{words}</text>'

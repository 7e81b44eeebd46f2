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
One self-contained HTML page of runs: ``flexarm report``.

The page holds its style, its script and the runs' rows; it makes no network request, and its
content security policy allows none.  The page's own script (``assets/``, 0.04 MB) draws the
pictures.  With plotly, 4.8 MB in every page and 64 MB on disk, three runs of 16 000 ticks took
0.55 s to open instead of 0.25 s (1.5 and 0.4 s the first time; six pictures against eleven, one
machine, one browser).
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
import hashlib
from html import escape
from importlib import resources
import json
import os
from pathlib import Path
import re
from string import Template
from typing import Any

from flexarm_ros.analysis.palette import style_sheet
from flexarm_ros.analysis.report import tables
from flexarm_ros.analysis.report.claims import evaluate
from flexarm_ros.analysis.report.data import page_data
from flexarm_ros.analysis.report.runs import load_runs, ReportedRun
from flexarm_ros.analysis.report.timing import timing_section
from flexarm_ros.bag.mcap.files import naming
import numpy as np

SCRIPTS = ('report_base.js', 'report_chart.js', 'report_arm.js', 'report_fls.js', 'report_main.js')
PAGE = 'report.html'
CONTENTS = '<!--contents-->'


def write_report(runs: Sequence[Path | ReportedRun], out: Path) -> Path:
    """
    Write the page of the given runs into ``out`` and return its path.

    The file is written atomically.  Raises ``RunError`` if a directory is not a run,
    ``OSError`` if the page cannot be written.
    """
    page = render(load_runs(runs))
    out.mkdir(parents=True, exist_ok=True)
    path = out / PAGE
    partial = out / f'{PAGE}.tmp'
    with naming(path):
        partial.write_text(page, 'utf-8', 'backslashreplace')  # a path need not be UTF-8
        os.replace(partial, path)
    return path


def render(runs: Sequence[ReportedRun]) -> str:
    """Return the page of some runs as text."""
    style = style_sheet() + _asset('report.css')
    script = f'"use strict";\n(() => {{\n{"".join(map(_asset, SCRIPTS))}}})();\n'
    data = page_data(runs)
    fuzzy = any(run.law == 'fls' for run in runs)
    if fuzzy:
        data['fls'] = _fls_data(runs)
    count = '1 run' if len(runs) == 1 else f'{len(runs)} runs'
    names = ', '.join(run.name for run in runs)
    page = Template(_asset('report.html')).substitute(
        title=escape(f'flexarm report: {names if len(names) <= 80 else count}'),
        subtitle=escape(f'{count} of a two-link flexible arm: {names}'),
        style=style,
        style_hash=_hash(style),
        script=script,
        script_hash=_hash(script),
        metrics=tables.metrics_table(runs),
        timing=timing_section(runs),
        claims=tables.claims_section(evaluate(runs)),
        sampling=escape(_sampling(data)),
        fls=_fls_section() if fuzzy else '',
        scenario=tables.scenario_table(runs),
        provenance=tables.provenance_table(runs),
        data=script_json(data),
    )
    return page.replace(CONTENTS, _contents(page), 1)


def _contents(page: str) -> str:
    """Return links to the sections of a page as items of a list."""
    found = re.findall(
        r'<section [^>]*?(class="needs-script")?>\s*<h2 id="([\w-]+)">(.*?)</h2>', page
    )
    return ''.join(
        f'<li{" " + css if css else ""}><a href="#{anchor}">{title}</a></li>'
        for css, anchor, title in found
    )


def script_json(data: Any) -> str:
    """Return JSON that may stand in a script element: no text of it can end the element."""
    text = json.dumps(data, ensure_ascii=True, allow_nan=False, separators=(',', ':'))
    return text.replace('<', '\\u003c').replace('>', '\\u003e').replace('&', '\\u0026')


def _asset(name: str) -> str:
    return (resources.files('flexarm_ros.analysis.report') / 'assets' / name).read_text('utf-8')


def _hash(text: str) -> str:
    digest = hashlib.sha256(text.encode('utf-8')).digest()
    return f'sha256-{base64.b64encode(digest).decode("ascii")}'


def _sampling(data: dict[str, Any]) -> str:
    entries = data['runs']
    if all(entry['rows'] == entry['total'] for entry in entries):
        return 'Every recorded tick is in this page.'
    few = min(entries, key=lambda entry: entry['rows'] / max(1, entry['total']))
    return (
        f'The charts contain a part of the recorded ticks (of each run at least {few["rows"]} of '
        f'{few["total"]}), among them the smallest and largest value of every quantity in each '
        'short interval, so that no peak is lost. trajectory.csv has every tick.'
    )


def _fls_data(runs: Sequence[ReportedRun]) -> dict[str, Any]:
    """Return the fuzzy logic system's sets, and lambda over the universe and near zero."""
    from flexarm_ros.analysis.figures.fls import gain_kn, lambda_grid
    from flexarm_ros.core.control.fls_definition import INPUT_SETS, OUTPUT_SETS

    kn = gain_kn(runs)
    grids = []
    for reach in (1.0, 0.2):
        values = lambda_grid(np.linspace(-reach, reach, 33))
        rounded = [[round(value, 5) for value in row] for row in values.tolist()]
        grids.append({'reach': round(reach * kn, 6), 'values': rounded})
    return {
        'kn': kn,
        'inputs': [{'name': name, 'feet': feet} for name, feet in INPUT_SETS.items()],
        'outputs': [{'name': name, 'feet': feet} for name, feet in OUTPUT_SETS.items()],
        'grids': grids,
    }


def _fls_section() -> str:
    from flexarm_ros.core.control.fls_definition import INPUT_SETS, RULES

    head = ''.join(f'<th scope="col">δ₂ is {name}</th>' for name in INPUT_SETS)
    rows = ''.join(
        f'<tr><th scope="row">δ₁ is {first}</th>'
        + ''.join(f'<td>{RULES[first, second]}</td>' for second in INPUT_SETS)
        + '</tr>'
        for first in INPUT_SETS
    )
    return Template(_asset('report_fls.html')).substitute(head=head, rows=rows)

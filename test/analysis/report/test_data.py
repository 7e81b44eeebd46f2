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

"""What the page's script gets: values to half a step, peaks kept, nothing that breaks out."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any

from flexarm_ros.analysis.report.data import (
    ERRORS,
    pack,
    PACKED,
    page_data,
    ROW_BUDGET,
    select_rows,
    STEPS,
)
from flexarm_ros.analysis.report.page import script_json
from flexarm_ros.analysis.report.runs import ReportedRun
from flexarm_ros.core.run.results.columns import COLUMNS
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
import numpy as np
import pytest

FLOATS = st.floats(-1e60, 1e60, allow_subnormal=False)


def unpack(low: float, span: float, data: str) -> np.ndarray:
    """Return packed values as the page's script decodes them."""
    octets = np.frombuffer(base64.b64decode(data), np.uint8).reshape(-1, 3).astype(np.int64)
    codes = octets @ np.array([1, 1 << 8, 1 << 16])
    return np.where(codes > STEPS, np.nan, low + codes / STEPS * span)


def run_of(rows: int, seed: int = 0, name: str = 'x', **columns: np.ndarray) -> ReportedRun:
    """Return a run of noise; some columns may be given."""
    random = np.random.default_rng(seed)
    held = {column: random.standard_normal(rows) for column in COLUMNS}
    held['t'] = np.arange(rows) * 1e-3
    return ReportedRun(Path('/runs') / name, {**held, **columns}, {}, {})


@given(hnp.arrays(np.float64, st.integers(0, 50), elements=st.one_of(FLOATS, st.just(np.nan))))
def test_values_come_back_to_within_half_a_step(values: np.ndarray) -> None:
    low, span, data = pack(values)
    assert len(data) == 4 * len(values)
    back = unpack(low, span, data)
    assert np.array_equal(np.isnan(back), np.isnan(values))
    known = ~np.isnan(values)
    assert (np.abs(back - values)[known] <= 0.5001 * span / STEPS + 1e-12 * abs(low)).all()


def test_least_and_largest_value_come_back_exactly() -> None:
    values = np.array([-3.25, 0.1, 7.5, np.nan])
    back = unpack(*pack(values))
    assert back[0] == -3.25 and back[2] == 7.5


def test_a_run_that_fits_is_whole() -> None:
    assert np.array_equal(select_rows(run_of(1000), 1000), np.arange(1000))


@pytest.mark.parametrize(('rows', 'budget'), [(1001, 1000), (16000, 4800), (16000, 600), (70, 30)])
def test_a_long_run_keeps_its_ends_and_the_peaks_of_everything(rows: int, budget: int) -> None:
    spike = np.zeros(rows)
    spike[rows // 3] = 1.0
    other = np.roll(spike, 7)
    run = run_of(rows, **{'lambda': np.full(rows, np.nan), 'delta1': spike, 'force_x': other})
    kept = select_rows(run, budget)
    assert len(kept) <= budget and (np.diff(kept) > 0).all()
    assert kept[0] == 0 and kept[-1] == rows - 1
    assert rows // 3 in kept
    for name in (*PACKED[1:], 'force_x'):
        values = run.columns[name]
        if np.isnan(values).all():
            continue
        assert np.nanmax(values[kept]) == np.nanmax(values)
        assert np.nanmin(values[kept]) == np.nanmin(values)


def test_short_peaks_anywhere_in_a_smooth_run_are_kept() -> None:
    rows, random = 16000, np.random.default_rng(3)
    t = np.arange(rows) * 1e-3
    smooth = {name: np.sin(t * (i + 1)) for i, name in enumerate(COLUMNS)}
    smooth['t'] = t
    places = np.sort(random.choice(np.arange(100, rows, 100), 40, replace=False))
    smooth['tau2'] = smooth['tau2'].copy()
    smooth['tau2'][places] += 10.0
    run = run_of(rows, **smooth)
    kept = select_rows(run, 4800)
    assert set(places) <= set(kept.tolist())
    assert len(kept) > 2400, 'the budget is used'


def test_equal_columns_are_held_once() -> None:
    data = page_data([run_of(100, name='a'), run_of(100, name='b')])
    first, second = (entry['columns'] for entry in data['runs'])
    assert first == second
    assert len(data['pool']) == len(PACKED) + len(ERRORS)


def test_errors_are_not_those_of_the_packing() -> None:
    """Told from packed points, a run that starts on its reference was 2.67e-7 m off there."""
    t = np.arange(16000) * 1e-3
    path = {'ref_x': 6.3 * np.sin(t), 'ref_y': 6.3 * np.cos(t)}
    rigid = {'rigid_x': 6.3 * np.sin(t) + 0.1 * t, 'rigid_y': path['ref_y'] - 0.01 * t}
    tip = {'tip_x': path['ref_x'] + 1e-3 * t, 'tip_y': path['ref_y'] + 1e-15}
    run = run_of(len(t), **path, **rigid, **tip)
    data = page_data([run])
    for name, true in zip(ERRORS, (run.error(), run.tip_error()), strict=True):
        entry = data['pool'][data['runs'][0]['columns'][name]]
        shown = unpack(entry['low'], entry['span'], entry['data'])
        assert shown[0] == true[0] == 0.0
        assert np.abs(shown - true).max() <= 0.5001 * true.max() / STEPS


@pytest.mark.parametrize('count', [1, 3, 10, 60])
def test_a_page_stays_below_6_mb(count: int) -> None:
    runs = [run_of(16000, seed=i, name=str(i)) for i in range(count)]
    data = page_data(runs)
    assert len(script_json(data)) < 5_500_000
    if 16000 * count <= ROW_BUDGET:
        assert all(entry['rows'] == 16000 for entry in data['runs'])


HOSTILE = ['</script><script>alert(1)</script>', '<!--<script>', ']]>', '&lt;', '\u2028', '\'"\\']


@pytest.mark.parametrize('text', HOSTILE)
def test_json_cannot_leave_its_element(text: str) -> None:
    shown = script_json({text: [text]})
    assert json.loads(shown) == {text: [text]}
    assert shown.isascii() and not set('<>&') & set(shown)


@given(st.recursive(st.text(), lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner)))
def test_json_of_any_text_is_plain(value: Any) -> None:
    shown = script_json(value)
    assert json.loads(shown) == value
    assert '<' not in shown

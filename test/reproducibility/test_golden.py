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

"""Runs of today against those that were frozen when the physics had been checked."""

from __future__ import annotations

import math

import pytest
from validation import golden


@pytest.mark.parametrize('name', list(golden.CASES))
def test_a_run_is_as_it_was_frozen(name: str) -> None:
    """Where a change is meant: `python -m validation.golden --write`."""
    assert golden.differences(name) == []


@pytest.mark.parametrize(
    'name', [*golden.QUICK, *(pytest.param(name, marks=pytest.mark.slow) for name in golden.SLOW)]
)
def test_a_run_has_the_bytes_that_were_frozen(name: str) -> None:
    """On every machine, with every version: no refactoring may change one."""
    assert golden.digest((golden.QUICK | golden.SLOW)[name]) == golden.frozen_digests()[name]


def test_each_digest_is_of_a_case() -> None:
    assert golden.frozen_digests().keys() == golden.QUICK.keys() | golden.SLOW.keys()


def test_each_case_has_a_file_and_no_file_is_left_over() -> None:
    assert {path.stem for path in golden.DIRECTORY.glob('*.csv')} == set(golden.CASES)


def test_a_changed_run_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    """A billionth and a half of one number is enough; a rounding error is not."""
    frozen = golden.read('de_luca_siciliano')
    for factor, seen in ((1.0 + 1.5e-9, 1), (1.0 + 1e-12, 0)):
        table = [row.copy() for row in frozen]
        table[-1][2] *= factor
        assert abs(table[-1][2]) > 1.0
        monkeypatch.setattr(golden, 'fly', lambda name, table=table: table)
        assert len(golden.differences('de_luca_siciliano')) == seen
    monkeypatch.setattr(golden, 'fly', lambda name: frozen[:-1])
    assert 'rows' in golden.differences('de_luca_siciliano')[0]


def test_text_reads_back_exactly(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    table = [[0.1 + 0.2, math.nan, -1e-17, *[1.0 / 3.0] * (len(golden.COLUMNS) - 3)]]
    monkeypatch.setattr(golden, 'DIRECTORY', tmp_path)
    (tmp_path / 'one.csv').write_text(golden.text(table))
    assert repr(golden.read('one')) == repr(table)


def test_nothing_is_frozen_while_a_goal_is_missed(tmp_path, monkeypatch) -> None:
    assert golden.refuse() is None
    goal = '{"what": "truth", "measured": "0", "limit": "1", "met": false, "out_of_reach": false}'
    (tmp_path / 'goals.json').write_text('{"a": [' + goal + ']}')
    monkeypatch.setattr(golden, 'GOALS', tmp_path / 'goals.json')
    assert golden.refuse() == 'not met: truth'

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

"""The text of numbers in ``trajectory.csv``: that of ``repr``, whoever writes it."""

from __future__ import annotations

import math
from pathlib import Path

from bagtools import small_config
from flexarm_ros.bag import number_text, simulation
import numpy as np
import pytest

WRITERS = ['repr', pytest.param('orjson', marks=pytest.mark.skipif(
    number_text.orjson is None, reason='orjson is not installed'
))]  # fmt: skip


@pytest.fixture(params=WRITERS)
def writer(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    if request.param == 'repr':
        monkeypatch.setattr(number_text, 'orjson', None)
    return request.param


def as_repr(table: np.ndarray) -> bytes:
    return ''.join(','.join(map(repr, row)) + '\n' for row in table.tolist()).encode()


def test_numbers_of_every_size(writer: str) -> None:
    bits = np.random.PCG64(7).random_raw(40_000)
    wild = bits.view(float).reshape(-1, 8)
    tame = np.ldexp(wild.view(np.int64) % 2**53 / 2**53, wild.view(np.int64) % 64 - 20)
    for table in (wild, tame):
        assert number_text.csv_lines(table) == as_repr(table)


def test_numbers_at_the_edges(writer: str) -> None:
    edges = [0.0, 1e-4, 1e-5, 1e15, 1e16, 1e17, 5e-324, 1e22, 123456.0, 0.1, 1e-4 - 1e-20]
    around = [f(x, y) for x in edges for f, y in ((np.nextafter, math.inf), (np.nextafter, -1.0))]
    values = [*edges, *around, math.nan, math.inf]
    table = np.array([[value, -value, 1.0] for value in values], float)
    assert number_text.csv_lines(table) == as_repr(table)


def test_a_table_with_nan_in_plain_rows(writer: str) -> None:
    table = np.array([[1.5, math.nan], [math.nan, 2.0]])
    assert number_text.csv_lines(table) == b'1.5,nan\nnan,2.0\n'


def test_rows_from_blocks_are_those_of_the_bag(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a run that is longer than what is kept, the bag is read back."""
    kept = simulation.simulate(small_config(), tmp_path / 'kept', 'small')
    monkeypatch.setattr(simulation, 'MOST_KEPT', 100)
    read = simulation.simulate(small_config(), tmp_path / 'read', 'small')
    rows = [(tmp_path / name / 'trajectory.csv').read_bytes() for name in ('kept', 'read')]
    assert rows[0] == rows[1]
    assert rows[0].count(b'\n') == 1 + kept['ticks']
    assert {**kept, 'wall_s': 0, 'rtf': 0} == {**read, 'wall_s': 0, 'rtf': 0}

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

"""The notebook in ``examples/``: its cells run in order, and its stored outputs are theirs."""

from __future__ import annotations

import contextlib
import io
import json
from typing import Any

import matplotlib
import pytest
from repository import ROOT

PATH = ROOT / 'examples' / 'flexible_arm.ipynb'
CELLS: list[dict[str, Any]] = [
    cell for cell in json.loads(PATH.read_text('utf-8'))['cells'] if cell['cell_type'] == 'code'
]


def printed(cell: dict[str, Any]) -> str:
    return ''.join(''.join(out['text']) for out in cell['outputs'] if 'text' in out)


def test_the_cells_run_in_order_and_print_what_is_stored(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pytest.importorskip('control')
    monkeypatch.setattr(matplotlib, 'get_backend', lambda: 'agg')
    matplotlib.use('agg', force=True)
    names: dict[str, Any] = {'__name__': 'notebook'}
    for number, cell in enumerate(CELLS):
        said = io.StringIO()
        with contextlib.redirect_stdout(said):
            exec(compile(''.join(cell['source']), f'cell {number}', 'exec'), names)
        assert said.getvalue() == printed(cell), f'cell {number}: run the notebook again'
    assert names['margin'] == pytest.approx(8.674e-3, abs=1e-5)  # of `flexarm stability`
    rigidities = [one['value'] for one in names['found'].parameters.values()]
    assert rigidities == pytest.approx([1500.0, 1300.0], rel=0.01)


def test_the_notebook_was_run_and_its_pictures_are_in_it() -> None:
    kinds = {kind for cell in CELLS for out in cell['outputs'] for kind in out.get('data', ())}
    assert 'image/png' in kinds
    assert all(cell['execution_count'] == i for i, cell in enumerate(CELLS, 1))


def test_jupyter_runs_it() -> None:
    nbformat = pytest.importorskip('nbformat', reason="not installed: 'flexarm_ros[notebook]'")
    client = pytest.importorskip('nbclient', reason="not installed: 'flexarm_ros[notebook]'")
    notebook = nbformat.read(PATH, 4)
    client.NotebookClient(notebook, timeout=120, kernel_name='python3').execute()
    texts = [''.join(out.get('text', '') for out in cell.outputs)
             for cell in notebook.cells if cell.cell_type == 'code']  # fmt: skip
    assert texts == [printed(cell) for cell in CELLS]

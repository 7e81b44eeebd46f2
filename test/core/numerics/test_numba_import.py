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

"""numba is imported without what has no use here, and works as always afterwards."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

_UNUSED = ('coverage', 'scipy.linalg')
_PROGRAM = """
import gc, json, sys
from flexarm_ros import numba_import
loaded = [name for name in sys.modules if sys.modules[name] is None or name in {unused}]
import numba, numpy as np
from numba.core.registry import cpu_target
from numba.extending import overload

def twice(x):
    raise NotImplementedError

@overload(twice)
def _twice(x):
    return lambda x: 2 * x

@numba.njit
def use(values):
    return twice(np.sort(values)[-1])

print(json.dumps({{
    'loaded': loaded, 'collects': gc.isenabled(), 'patched': [*vars(cpu_target.target_context)],
    'answer': use(np.array([1.0, 3.0, 2.0])),
}}))
"""


def _told(prepare: str = '') -> dict[str, object]:
    done = subprocess.run(
        [sys.executable, '-c', prepare + _PROGRAM.format(unused=_UNUSED)], check=True,
        capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    told: dict[str, object] = json.loads(done.stdout)
    return told


def test_numba_is_loaded_without_the_unused_and_works() -> None:
    """No module stays hidden, and another package's overloaded function is still found."""
    told = _told()
    assert told['loaded'] == []
    assert 'refresh' not in str(told['patched'])
    assert told['collects'] is True
    assert told['answer'] == 6.0


def test_what_was_so_before_the_import_stays() -> None:
    """A collector that was off stays off; a module that was there stays there."""
    pytest.importorskip('coverage')
    told = _told('import gc, coverage; gc.disable()')
    assert told['collects'] is False
    assert told['loaded'] == ['coverage']

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

"""No number of a run depends on the C library, the processor or a library's version."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import flexarm_ros
from flexarm_ros.core.arm import plant_eq14
from llvmlite import binding
import numba
import numpy as np
import pytest

FEATURES = {name for name, there in binding.get_host_cpu_features().items() if there}
PACKAGE = Path(flexarm_ros.__file__).parent
# Analyses; no run takes a number from them. The timing of a run in real time is no number of it.
APART = {'fls_definition', 'real_time'}
# Exact by IEEE 754 or by definition; all else of the module `math` is the C library's.
EXACT = {
    *('sqrt', 'floor', 'ceil', 'isfinite', 'isinf', 'isnan', 'copysign', 'frexp', 'ldexp', 'fsum'),
    'remainder',
    *('pi', 'inf', 'nan'),
}
# Of NumPy: making, shaping and choosing arrays, and operations on each entry that are exact.
PLAIN = {
    *('array', 'asarray', 'ascontiguousarray', 'atleast_1d', 'concatenate', 'stack', 'repeat'),
    *('tile', 'zeros', 'zeros_like', 'ones', 'empty', 'empty_like', 'full', 'eye', 'arange'),
    *('outer', 'multiply', 'sqrt', 'rint', 'maximum', 'minimum', 'max', 'abs', 'where', 'argsort'),
    *('cumsum', 'count_nonzero', 'unique', 'tril', 'transpose', 'ndarray', 'random'),
    *('float64', 'int64', 'uint64', 'uint8'),
    *('inf', 'nan', 'dtype', 'record', 'void'),
}  # fmt: skip


def modules() -> list[Path]:
    found = (PACKAGE / 'core').rglob('*.py')
    return [p for p in found if p.stem not in APART]


def undefined(source: str) -> Iterator[str]:
    """Yield what a module uses of which the last bit is not defined."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            name = f'{node.value.id}.{node.attr}'
            if node.value.id == 'math' and node.attr not in EXACT:
                yield name
            if node.value.id == 'np' and node.attr not in PLAIN:
                yield name
        elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.MatMult):
            yield 'the operator @'
        elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
            if not all(isinstance(side, ast.Constant) for side in (node.left, right(node))):
                yield 'the operator **'
        elif isinstance(node, ast.Call):
            yield from undefined_calls(node)
        elif isinstance(node, ast.ImportFrom | ast.Import):
            names = [node.module or ''] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names]
            yield from (n for n in names if n.split('.')[0] in {'scipy', 'cmath', 'statistics'})
            yield from (n for n in names if n.startswith('numpy.') and n != 'numpy.typing')


def right(node: ast.BinOp) -> ast.expr:
    return node.right.operand if isinstance(node.right, ast.UnaryOp) else node.right


def undefined_calls(node: ast.Call) -> Iterator[str]:
    """Yield sums whose order or compensation is the library's own affair."""
    called = node.func
    if isinstance(called, ast.Name) and called.id in {'pow', 'sum'}:
        yield f'{called.id}()'
    if isinstance(called, ast.Attribute) and called.attr in {'dot', 'mean', 'standard_normal'}:
        yield f'.{called.attr}()'


@pytest.mark.parametrize('path', modules(), ids=lambda p: p.relative_to(PACKAGE).as_posix())
def test_only_operations_with_defined_bits(path: Path) -> None:
    """Use flexarm_ros.core.numerics.elementary and linalg instead of what is named here."""
    assert sorted(set(undefined(path.read_text('utf-8')))) == []


@pytest.mark.parametrize(
    'line',
    [
        'math.sin(x)', 'np.cos(x)', 'np.linalg.inv(a)', 'a @ b', 'x**2', 'x ** 0.5', 'np.sum(x)',
        'sum(x)', 'a.dot(b)', 'np.einsum("i,i", a, b)', 'from scipy import linalg',
        'math.hypot(x, y)', 'g.standard_normal(3)', 'from numpy.polynomial import legendre',
    ],
)  # fmt: skip
def test_what_has_no_defined_bits_is_seen(line: str) -> None:
    assert len(list(undefined(line))) == 1


@pytest.mark.parametrize(
    'line', ['math.sqrt(x)', 'np.zeros(3)', 'x * x', '2.0**-52', 'np.sqrt(x)']
)
def test_what_has_defined_bits_passes(line: str) -> None:
    assert list(undefined(line)) == []


FUSED = ('vfmadd', 'vfmsub', 'vfnmadd', 'vfnmsub', 'fmadd', 'fmsub', 'fnmadd', 'fmla', 'fmls')


def fused(function: Any, *arguments: Any, **options: Any) -> list[str]:
    """Return the fused operations in the machine code of a function, compiled now."""
    made = numba.njit(error_model='numpy', **options)(function)
    made(*arguments)
    (code,) = made.inspect_asm().values()
    return [word for word in code.split() if word.startswith(FUSED)]


def test_the_compiler_fuses_nothing() -> None:
    """A fused multiply-add rounds once where a product and a sum round twice."""
    state, work, matrix = np.zeros((2, 4)), np.zeros((5, 4)), np.zeros((4, 4))
    mass = np.stack([np.eye(4), np.zeros((4, 4))])
    arguments = (state, 0.0, 0.0, 1e-3, 1, mass, np.ones((3, 4)), 0.0, matrix, work)
    step: Any = plant_eq14.step_eq14
    assert fused(step.py_func, *arguments) == []
    assert fused(lambda a, b, c: a * b + c, 1.0, 2.0, 3.0) == []


@pytest.mark.skipif('fma' not in FEATURES, reason='this processor fuses nothing')
def test_a_fused_operation_is_seen() -> None:
    assert fused(lambda a, b, c: a * b + c, 1.0, 2.0, 3.0, fastmath={'contract'})

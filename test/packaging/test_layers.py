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

"""The layers of the package: each imports only from those to its left."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
import subprocess
import sys

from flexarm_ros.core.run.parts import PARTS
from layertools import API, dotted, imports, LAYERS, modules, PACKAGE, ROOT, ROS
import pytest
from repository import SUPPORT

# The outermost layer beside the command line, of those who have no ROS: nobody imports it.
API_USES = {'core', 'stability', 'wire', 'scenario', 'bag', 'analysis', 'identification', API}
# What the core cannot do itself, having no files: say where its compiled code is kept.
HELPER = 'code_cache'
WITHOUT_ROS = API_USES
HELPERS = [*(ROOT.parent / 'bench').glob('*.py'), *SUPPORT.rglob('*tools.py')]
NODES = {'plant', 'trajectory', 'answering', 'recorder', 'player'}
# What a pure function of numbers has no use for: files, clocks, the system, randomness of its own.
IMPURE = {
    *('os', 'io', 'pathlib', 'shutil', 'tempfile', 'sys', 'subprocess', 'socket', 'threading'),
    *('time', 'datetime', 'random', 'secrets', 'uuid', 'logging', 'multiprocessing', 'asyncio'),
}
GENERATORS = {'Generator', 'Philox', 'PCG64', 'SeedSequence', 'BitGenerator'}


def layer_of(name: str) -> str | None:
    """Return the layer of a dotted name in the package, None for the package itself."""
    parts = name.split('.')
    return parts[1] if len(parts) > 1 and parts[0] == PACKAGE else None


def complaints(source: str, module: str, is_package: bool = False) -> list[str]:
    """Return what a module does that its layer may not."""
    tree = ast.parse(source)
    names = list(imports(tree, module, is_package))
    layer = layer_of(module)
    own = [name for name in names if name.split('.')[0] == PACKAGE]
    found = []
    if layer in LAYERS or layer == API:
        allowed = API_USES if layer == API else set(LAYERS[: LAYERS.index(layer) + 1])
        for name in own:
            # The bare package is where things are, and what version it is; it imports nothing.
            if name not in {PACKAGE, f'{PACKAGE}.{HELPER}'} and layer_of(name) not in allowed:
                found.append(f'{layer} imports {name}')
    elif layer == 'ros2_standin':
        found += [f'the stand-in imports {name}' for name in own if layer_of(name) != layer]
    if layer in WITHOUT_ROS:
        found += [f'{layer} imports {name}' for name in names if name.split('.')[0] in ROS]
    if layer == 'core':
        found += [f'core imports {name}' for name in names if name.split('.')[0] in IMPURE]
        found += impure_calls(tree)
    parts = module.split('.')
    if layer == 'nodes' and parts[-1] in NODES:
        for name in own:
            other = name.split('.')[2] if layer_of(name) == 'nodes' else ''
            if other in NODES - {parts[-1]}:
                found.append(f'node {parts[-1]} imports node {other}')
    return found


def impure_calls(tree: ast.Module) -> Iterator[str]:
    """Yield the calls that open files, print, or draw from NumPy's global generator."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            if node.func.id in {'open', 'print', 'input', 'exec', 'eval'}:
                yield f'core calls {node.func.id}()'
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Attribute):
            used = node.attr if node.value.attr == 'random' else None
            if used is not None and used not in GENERATORS:
                yield f'core uses numpy.random.{used}'


@pytest.mark.parametrize('path', modules(), ids=dotted)
def test_module_keeps_to_its_layer(path: Path) -> None:
    found = complaints(path.read_text('utf-8'), dotted(path), path.name == '__init__.py')
    assert not found, '\n'.join(found)


def test_every_subpackage_has_a_layer() -> None:
    found = {path.parent.relative_to(ROOT).parts[0] for path in ROOT.glob('*/**/*.py')}
    assert found - {*LAYERS, API, 'ros2_standin'} == set()


@pytest.mark.parametrize('layer', sorted(WITHOUT_ROS))
def test_layer_loads_without_ros(layer: str) -> None:
    code = (
        'import importlib, pkgutil, sys\n'
        f"package = importlib.import_module('{PACKAGE}.{layer}')\n"
        "for found in pkgutil.walk_packages(package.__path__, package.__name__ + '.'):\n"
        '    try:\n'
        '        importlib.import_module(found.name)\n'
        '    except ImportError as error:\n'
        "        assert 'flexarm_ros[' in str(error), error\n"  # an extra that is not installed
        f'print(*sorted(sys.modules.keys() & set({sorted(ROS)})))\n'
    )
    loaded = subprocess.run(
        [sys.executable, '-c', code], capture_output=True, text=True, check=True, timeout=60
    )
    assert loaded.stdout.split() == []


def test_nobody_uses_the_standin() -> None:
    users = [
        dotted(path)
        for path in modules()
        if layer_of(dotted(path)) != 'ros2_standin' and 'ros2_standin' in path.read_text('utf-8')
    ]
    assert users == []


@pytest.mark.parametrize(
    ('module', 'source', 'complaint'),
    [
        ('core.plant', 'from flexarm_ros.bag import x', 'core imports flexarm_ros.bag.x'),
        ('core.plant', 'from ..bag import x', 'core imports flexarm_ros.bag.x'),
        ('core.plant', 'from .. import bag', 'core imports flexarm_ros.bag'),
        ('core.plant', 'def f():\n    import time', 'core imports time'),
        ('core.plant', 'from os import path', 'core imports os.path'),
        ('core.plant', "open('x')", 'core calls open()'),
        ('core.plant', 'np.random.normal()', 'core uses numpy.random.normal'),
        ('core.plant', 'np.random.default_rng()', 'core uses numpy.random.default_rng'),
        ('bag.cdr', 'import rclpy', 'bag imports rclpy'),
        ('scenario.check', 'import rclpy.node', 'scenario imports rclpy.node'),
        ('analysis.x', 'from flexarm_ros.nodes import main', 'analysis imports'),
        ('nodes.x', 'import flexarm_ros.launcher', 'nodes imports flexarm_ros.launcher'),
        (
            'nodes.plant',
            'from flexarm_ros.nodes import answering',
            'node plant imports node answering',
        ),
        ('nodes.plant', 'from flexarm_ros.nodes.recorder import R', 'node plant imports node rec'),
        ('ros2_standin.x', 'from flexarm_ros.core import plant', 'the stand-in imports'),
        ('api.run', 'from flexarm_ros.launcher import run', 'api imports flexarm_ros.launcher'),
        ('api.run', 'import rclpy', 'api imports rclpy'),
        ('cli.run', 'from flexarm_ros.api import run', 'cli imports flexarm_ros.api'),
    ],
)
def test_breaches_are_seen(module: str, source: str, complaint: str) -> None:
    found = complaints(source, f'{PACKAGE}.{module}')
    assert any(line.startswith(complaint) for line in found), found


@pytest.mark.parametrize(
    ('module', 'source'),
    [
        ('core.plant', 'from flexarm_ros.core import beam\nimport math'),
        ('core.sensors', 'import numpy as np\nnp.random.Generator(np.random.Philox(1))'),
        (
            'nodes.plant',
            'from flexarm_ros.nodes.runtime.joining.status import StatusBoard\nimport rclpy',
        ),
        ('cli.run', 'from flexarm_ros.core import plant\nimport time'),
    ],
)
def test_what_is_allowed_passes(module: str, source: str) -> None:
    assert complaints(source, f'{PACKAGE}.{module}') == []


def test_roles_are_listed_in_one_place() -> None:
    """Three names of roles side by side, in code or launch file, are a list written again."""
    roles = [part.NAME for part in PARTS]
    found = []
    for path in [*modules(), *(ROOT.parent / 'launch').glob('*.py'), *HELPERS]:
        for node in ast.walk(ast.parse(path.read_text('utf-8'))):
            if isinstance(node, (ast.Tuple, ast.List, ast.Set)):
                words = [e.value for e in node.elts if isinstance(e, ast.Constant)]
                if sum(word in roles for word in words) >= 3:
                    found.append(f'{path.name}:{node.lineno}: {words}')
    assert not found, '\n'.join(found)


def imported(path: Path) -> set[str]:
    """Return the modules of the package that a module imports, wherever in it, for types too."""
    names = {dotted(p) for p in modules()}
    tree = ast.parse(path.read_text('utf-8'))
    found = set()
    for name in imports(tree, dotted(path), path.name == '__init__.py'):
        while name and name not in names:
            name = name.rpartition('.')[0]
        found.add(name)
    # The bare package is where things are, and what version it is.
    return found - {PACKAGE, '', dotted(path)}


def test_no_module_imports_one_that_imports_it() -> None:
    """Neither at once nor by way of others: each can be understood without what uses it."""
    graph = {dotted(path): imported(path) for path in modules()}
    try:
        tuple(TopologicalSorter(graph).static_order())
    except CycleError as error:
        pytest.fail(' imports '.join(reversed(error.args[1])))

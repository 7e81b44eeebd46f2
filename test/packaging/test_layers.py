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
import re
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


def test_layers_load_without_ros() -> None:
    """One process for all, from left to right: a layer is named by what it adds."""
    order = sorted(WITHOUT_ROS, key=[*LAYERS, API].index)
    code = (
        'import importlib, pkgutil, sys\n'
        'loaded = set()\n'
        f'for layer in {order}:\n'
        f"    package = importlib.import_module(f'{PACKAGE}.{{layer}}')\n"
        "    for found in pkgutil.walk_packages(package.__path__, package.__name__ + '.'):\n"
        '        try:\n'
        '            importlib.import_module(found.name)\n'
        '        except ImportError as error:\n'
        "            assert 'flexarm_ros[' in str(error), error\n"  # an extra is not installed
        f'    ros = sys.modules.keys() & set({sorted(ROS)}) - loaded\n'
        '    loaded |= ros\n'
        '    for name in sorted(ros):\n'
        "        print(f'{layer}: {name}')\n"
    )
    loaded = subprocess.run(
        [sys.executable, '-c', code], capture_output=True, text=True, check=True, timeout=60
    )
    assert loaded.stdout.splitlines() == []


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
        ('bag.cdr', 'def f():\n    from rclpy import node', 'bag imports rclpy.node'),
        ('bag.cdr', "importlib.import_module('rclpy.node')", 'bag imports rclpy.node'),
        ('bag.cdr', "__import__('rclpy')", 'bag imports rclpy'),
        ('core.x', "import_module('flexarm_ros.bag.cdr')", 'core imports flexarm_ros.bag.cdr'),
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


def imported(source: str, module: str, is_package: bool, names: set[str]) -> set[str]:
    """Return those of ``names`` that a module imports, wherever in it, for types too."""
    found = set()
    for name in imports(ast.parse(source), module, is_package):
        while name and name not in names:
            name = name.rpartition('.')[0]
        found.add(name)
    # The bare package is where things are, and what version it is.
    return found - {PACKAGE, '', module}


def circle(sources: dict[str, tuple[str, bool]]) -> str:
    """
    Return the modules that import one another in a circle as text, empty if there are none.

    ``sources``: dotted name -> source, and whether it is a package.
    """
    names = set(sources)
    graph = {
        name: imported(text, name, package, names) for name, (text, package) in sources.items()
    }
    try:
        tuple(TopologicalSorter(graph).static_order())
    except CycleError as error:
        return ' imports '.join(reversed(error.args[1]))
    return ''


def test_no_module_imports_one_that_imports_it() -> None:
    """Neither at once nor by way of others: each can be understood without what uses it."""
    sources = {
        dotted(path): (path.read_text('utf-8'), path.name == '__init__.py') for path in modules()
    }
    found = circle(sources)
    assert not found, found


@pytest.mark.parametrize(
    'back',
    [
        'from flexarm_ros.core import a',
        'from . import a',
        'if TYPE_CHECKING:\n    from flexarm_ros.core.a import A',
        'def f():\n    from flexarm_ros.core.a import A',
        "def f():\n    import_module('flexarm_ros.core.a')",
        'from flexarm_ros.core import c',
    ],
)
def test_circles_are_seen(back: str) -> None:
    """For types, in a function, by a call, by way of another module."""
    there = {
        'flexarm_ros.core.a': ('from flexarm_ros.core.b import B', False),
        'flexarm_ros.core.b': ('', False),
        'flexarm_ros.core.c': ('def g():\n    from flexarm_ros.core.a import A', False),
    }
    assert circle(there) == ''
    there['flexarm_ros.core.b'] = (back, False)
    assert 'flexarm_ros.core.b imports' in circle(there)


def told_imports(folder: Path) -> str:
    """Return what a folder's ``__init__`` says of its imports, empty if it says nothing."""
    text = ast.get_docstring(ast.parse((folder / '__init__.py').read_text('utf-8'))) or ''
    return ' '.join(text[text.index('Imports ') :].split()) if 'Imports ' in text else ''


def untold(told: str, folder: str, targets: set[str]) -> list[str]:
    """
    Return those modules of ``targets`` that ``told`` does not name.

    A module is named by its own name or that of a folder that has it, as far as ``folder`` is
    not in it, or as "the rest of FOLDER"; its sub-folders need no word.
    """
    rest = tuple(f'{PACKAGE}.{name}.' for name in re.findall(r'the rest of `([\w.]+)`', told))
    words = {word.rstrip('s') for word in re.findall(r'\w+', told)}
    if words & {'every', 'everything', 'all'}:
        return []
    found = []
    for target in sorted(targets):
        own, parts = folder.split('.'), target.split('.')
        while own and parts and own[0] == parts[0]:
            del own[0], parts[0]
        if (
            own
            and not target.startswith(rest)
            and not words & {part.rstrip('s') for part in parts}
        ):
            found.append(target)
    return found


FOLDERS = [path.parent for path in modules() if path.name == '__init__.py' and path.parent != ROOT]


@pytest.mark.parametrize('folder', FOLDERS, ids=lambda path: dotted(path / '__init__.py'))
def test_a_folder_says_what_it_imports(folder: Path) -> None:
    name, known = dotted(folder / '__init__.py'), {dotted(path) for path in modules()}
    targets = set()
    for path in folder.glob('*.py'):
        source = path.read_text('utf-8')
        targets |= imported(source, dotted(path), path.name == '__init__.py', known)
    outside = {t for t in targets if not t.startswith(f'{name}.') and t != name}
    if outside:
        assert untold(told_imports(folder), name, outside) == []


@pytest.mark.parametrize(
    ('told', 'target', 'named'),
    [
        ('Imports the arm and the timeline.', 'flexarm_ros.core.arm.full.model', True),
        ('Imports the arm and the timeline.', 'flexarm_ros.core.timeline', True),
        ('Imports the arm and the timeline.', 'flexarm_ros.core.run.part', False),
        ('Imports core.', 'flexarm_ros.core.run.part', False),
        ('Imports the rest of `core.run`.', 'flexarm_ros.core.run.part', True),
        ('Imports the rest of `core.arm`.', 'flexarm_ros.core.run.part', False),
        ('Imports core.', 'flexarm_ros.wire.cdr', False),
        ('Imports wire.', 'flexarm_ros.wire.cdr', True),
        ('', 'flexarm_ros.core.sensing.own.x', True),
    ],
)
def test_an_import_that_is_not_told_is_seen(told: str, target: str, named: bool) -> None:
    assert (untold(told, f'{PACKAGE}.core.sensing', {target}) == []) is named


def test_folders_are_of_a_size_to_be_read() -> None:
    """At most twelve files beside ``__init__``."""
    sizes = {str(path.relative_to(ROOT)): len(list(path.glob('*.py'))) - 1 for path in FOLDERS}
    assert {name: size for name, size in sizes.items() if size > 12} == {}

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

"""Fixtures with a package of somebody else's: a law and a sensor, found by entry points."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
import shutil
import subprocess
import sys

from flexarm_ros.core.control import LAWS
from flexarm_ros.core.parameters.sections import OWN_LAWS, SECTIONS
from flexarm_ros.core.run.parts import PLUGINS
from flexarm_ros.scenario.plugins import registry as plugins
from nodetools import flexarm
import pytest
from repository import ROOT, TESTS

STRANGER = TESTS / 'stranger'
REGISTERED: tuple[dict[str, object], ...] = (LAWS, OWN_LAWS, PLUGINS, SECTIONS)  # type: ignore[assignment]


@pytest.fixture
def registry(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Forget what a test registers, trusts and finds installed."""
    kept, trusted = [dict(held) for held in REGISTERED], set(plugins._trusted)
    forget_installed()
    yield
    monkeypatch.undo()
    forget_installed()
    for now, before in zip(REGISTERED, kept, strict=True):
        now.clear()
        now.update(before)
    plugins._trusted.clear()
    plugins._trusted.update(trusted)


def forget_installed() -> None:
    plugins.installed_laws.cache_clear()
    plugins.installed_parts.cache_clear()


@pytest.fixture(scope='session')
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Install the stranger's package, without a network, in a directory of its own."""
    place = tmp_path_factory.mktemp('stranger')
    shutil.copytree(STRANGER, place / 'source')
    subprocess.run(
        [sys.executable, '-m', 'pip', 'install', '--quiet', '--no-index', '--no-deps',
         '--no-build-isolation', '--target', place / 'site', place / 'source'],
        check=True, timeout=120,
    )  # fmt: skip
    return place / 'site'


def fly_suite(base: Path, out: Path) -> None:
    """Simulate the scenario ``base`` as the case ``own`` of a suite, which passes."""
    suite = out.with_suffix('.yaml')
    suite.write_text(
        f'cases:\n  - name: own\n    scenario: {base}\n    mode: simulate\n'
        '    expect: {stable: true}\n'
    )
    done = flexarm('suite', suite, '--out', out)
    assert done.returncode == 0, done.stderr + done.stdout


def fly_sweep(base: Path, grid: str, out: Path) -> None:
    """Sweep the scenario ``base`` over ``grid``, lines of YAML, to the end."""
    sweep = out.with_suffix('.yaml')
    sweep.write_text(f'scenario: {base}\ngrid:\n{grid}')
    done = flexarm('sweep', sweep, '--out', out)
    assert done.returncode == 0, done.stderr + done.stdout


@pytest.fixture
def stranger(site: Path, registry: None, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Put the stranger's package on the path of this process and of those that it starts."""
    monkeypatch.syspath_prepend(site)
    monkeypatch.setenv('PYTHONPATH', f'{site}:{ROOT}')
    return site

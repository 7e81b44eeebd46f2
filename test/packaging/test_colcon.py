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

"""Installed by colcon, with and without ``--symlink-install``, as into a full ROS 2."""

from __future__ import annotations

import os
from pathlib import Path
import subprocess
import sys
from xml.etree import ElementTree

from nodetools import EXECUTABLES
from packagetools import copy_sources
import pytest
from repository import ROOT

COLCON = Path(sys.executable).with_name('colcon')
pytestmark = pytest.mark.skipif(
    not COLCON.exists(), reason="colcon is an optional extra: pip install 'flexarm_ros[colcon]'"
)


@pytest.fixture(scope='module', params=['copied', 'symlinked'])
def workspace(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build a workspace that holds a copy of the sources."""
    root = tmp_path_factory.mktemp(request.param)
    copy_sources(root / 'src' / 'flexarm_ros')
    (root / 'log').mkdir()
    options = ['--symlink-install'] if request.param == 'symlinked' else []
    built = subprocess.run(
        [COLCON, '--log-base', root / 'log', 'build', *options],
        cwd=root, env=environment(), capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert built.returncode == 0, built.stderr
    assert not list((root / 'src' / 'flexarm_ros').glob('*.egg-info'))
    return root


def environment() -> dict[str, str]:
    """Return what a shell has before the workspace is sourced: the environment's Python first."""
    path = os.pathsep.join([str(COLCON.parent), os.environ['PATH']])
    kept = {k: v for k, v in os.environ.items() if k not in ('PYTHONPATH', 'AMENT_PREFIX_PATH')}
    return {**kept, 'PATH': path, 'PYTHONDONTWRITEBYTECODE': ''}


def sourced(workspace: Path, line: str) -> subprocess.CompletedProcess[str]:
    """Run a line of bash with the workspace sourced, in a directory of its own."""
    where = workspace / 'elsewhere'
    where.mkdir(exist_ok=True)
    return subprocess.run(
        ['bash', '-c', f'set -e; . {workspace}/install/setup.bash; {line}'],
        cwd=where, env=environment(), capture_output=True, text=True, timeout=120,
    )  # fmt: skip


def test_package_is_ament_python_and_sourced(workspace: Path) -> None:
    listed = subprocess.run(
        [COLCON, '--log-base', workspace / 'log', 'list'],
        cwd=workspace, env=environment(), capture_output=True, text=True, timeout=60, check=True,
    )  # fmt: skip
    assert '(ros.ament_python)' in listed.stdout
    prefix = workspace / 'install' / 'flexarm_ros'
    code = 'import flexarm_ros, os; print(os.path.abspath(flexarm_ros.__file__))'
    done = sourced(workspace, f'echo $AMENT_PREFIX_PATH; which flexarm; python3 -c "{code}"')
    assert done.returncode == 0, done.stderr
    prefixes, command, module = done.stdout.split()
    assert prefixes.split(os.pathsep)[0] == str(prefix)
    assert command == str(prefix / 'bin' / 'flexarm')
    assert str(workspace) in module


def test_colcon_test_runs_pytest(workspace: Path) -> None:
    folder = workspace / 'src' / 'flexarm_ros' / 'test'
    folder.mkdir()
    (folder / 'test_it.py').write_text('def test_it():\n    import flexarm_ros\n')
    tested = subprocess.run(
        [COLCON, '--log-base', workspace / 'log', 'test'],
        cwd=workspace, env=environment(), capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    assert tested.returncode == 0, tested.stderr
    results = ElementTree.parse(workspace / 'build' / 'flexarm_ros' / 'pytest.xml')
    (suite,) = results.getroot().iter('testsuite')
    assert (suite.get('tests'), suite.get('failures'), suite.get('errors')) == ('1', '0', '0')


def test_commands_and_executables_work(workspace: Path) -> None:
    done = sourced(workspace, 'flexarm --version; flexarm list')
    assert done.returncode == 0, done.stderr
    assert 'fls_tip' in done.stdout
    library = workspace / 'install' / 'flexarm_ros' / 'lib' / 'flexarm_ros'
    assert {path.name for path in library.iterdir()} == EXECUTABLES
    done = sourced(workspace, f'{library}/encoder --ros-args -p latency:=-1.0 || echo $?')
    assert done.stdout.strip() == '2', done.stderr
    assert 'encoder.latency' in done.stderr


def test_launch_files_and_scenarios_are_where_ros_looks(workspace: Path) -> None:
    share = workspace / 'install' / 'flexarm_ros' / 'share' / 'flexarm_ros'
    assert {path.name for path in (share / 'launch').glob('*.launch.py')} == {
        'run.launch.py', 'view.launch.py',
    }  # fmt: skip
    assert (share / 'config' / 'fls_tip.yaml').is_file()
    standin = 'python3 -m flexarm_ros.ros2_standin pkg executables flexarm_ros'
    listed = sourced(workspace, standin)
    assert {line.split()[1] for line in listed.stdout.splitlines()} == EXECUTABLES
    assert (ROOT / 'package.xml').read_text() == (share / 'package.xml').read_text()

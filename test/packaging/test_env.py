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

"""`make env`: what it says where it cannot go on, and how fast it does nothing."""

from __future__ import annotations

import importlib.metadata
from importlib.util import cache_from_source
import os
from pathlib import Path
import resource
import shutil
import subprocess

from nodetools import EXECUTABLES
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
import pytest
from repository import ROOT

PROGRAMS = [
    'cat',
    'cut',
    'dirname',
    'flock',
    'grep',
    'id',
    'ls',
    'mktemp',
    'rm',
    'sha256sum',
    'sh',
]


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """Copy what `make env` reads into a directory without .venv, with only coreutils on PATH."""
    root = tmp_path / 'a b'
    shutil.copytree(ROOT / 'scripts', root / 'scripts')
    shutil.copytree(ROOT / 'lib', root / 'lib')
    shutil.copytree(ROOT / 'constraints', root / 'constraints')
    for name in ('setup.py', 'setup.cfg', 'package.xml'):
        shutil.copy(ROOT / name, root)
    (root / 'bin').mkdir()
    for name in PROGRAMS:
        found = shutil.which(name)
        assert found is not None
        (root / 'bin' / name).symlink_to(found)
    fake(
        root,
        'uname',
        'case "$1" in -s) echo Linux;; -m) echo x86_64;; *) echo Linux x86_64;; esac',
    )
    fake(root, 'ldd', 'echo ldd glibc')
    fake(root, 'id', 'echo 1000')
    return root


def fake(root: Path, name: str, script: str) -> None:
    """Put a program of that name on the tree's PATH."""
    path = root / 'bin' / name
    path.unlink(missing_ok=True)
    path.write_text(f'#!/bin/sh\n{script}\n')
    path.chmod(0o755)


def fake_python(root: Path, name: str, version: str, imports: bool = False) -> None:
    """Put an interpreter there that answers as one of that version, and imports all or nothing."""
    major, minor = version.split('.')[:2]
    right = (3, 10) <= (int(major), int(minor)) <= (3, 13)
    fake(
        root,
        name,
        f'case "$*" in -V) echo Python {version};;'
        f' *version_info*sys.exit* | *sys.exit*version_info*) exit {0 if right else 1};;'
        f' *print*version_info*) echo python{major}.{minor}-venv;;'
        f' *import*) exit {0 if imports else 1};; esac',
    )


def make_env(root: Path, *words: str, **variables: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [root / 'scripts' / 'env.sh', *words],
        env={'PATH': str(root / 'bin'), **variables},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=30,
    )


def refusal(root: Path, **variables: str) -> list[str]:
    done = make_env(root, **variables)
    assert done.returncode == 1
    assert not (root / variables.get('VENV', '.venv')).exists()
    return done.stderr.splitlines()


def test_wrong_python_is_named_with_the_way_out(tree: Path) -> None:
    fake_python(tree, 'python3', '3.14.0')
    (tree / 'bin' / 'python3.10').unlink(missing_ok=True)
    first, second = refusal(tree, PYTHON='python3')
    assert 'Python 3.14.0, not Python 3.10 to 3.13' in first
    assert 'make env PYTHON=/path/to/python3.12' in second


def test_missing_python_names_what_was_asked_for(tree: Path) -> None:
    lines = refusal(tree, PYTHON='/nowhere/python3')
    assert '/nowhere/python3' in lines[0]
    assert '3.10 to 3.13' in lines[0]


def test_missing_venv_names_the_line_that_installs_it(tree: Path) -> None:
    fake_python(tree, 'python3', '3.11.2')
    lines = refusal(tree, PYTHON='python3')
    assert 'venv' in lines[0]
    assert 'apt-get install -y python3.11-venv' in ''.join(lines)


def test_other_machines_are_sent_to_a_ros_2_install(tree: Path) -> None:
    fake(
        tree,
        'uname',
        'case "$1" in -s) echo Linux;; -m) echo aarch64;; *) echo Linux aarch64;; esac',
    )
    lines = refusal(tree)
    assert 'Linux aarch64' in lines[0]
    assert 'Install ROS 2' in lines[1]
    assert 'setup.bash' in lines[1]


def test_musl_is_seen(tree: Path) -> None:
    fake(tree, 'ldd', "echo 'musl libc (x86_64)' >&2; exit 1")
    assert 'glibc' in refusal(tree)[0]


def test_old_ros_2_is_refused(tree: Path) -> None:
    assert 'humble' in refusal(tree, ROS_DISTRO='humble')[0]


def test_wheels_of_another_distribution_are_refused(tree: Path) -> None:
    (line,) = refusal(tree, WHEELS='rolling', VENV='elsewhere')
    assert 'WHEELS=rolling' in line
    assert 'jazzy' in line
    assert 'kilted' in line


def test_sourced_ros_2_that_no_python_imports(tree: Path) -> None:
    fake_python(tree, 'python3', '3.11.7')
    lines = refusal(tree, ROS_DISTRO='jazzy', PYTHON='python3')
    assert 'ROS 2 jazzy is sourced' in lines[0]


def test_nothing_to_do_is_quick_and_quiet() -> None:
    """But for the byte code of a source that has changed, whatever the environment says."""
    check = subprocess.run([ROOT / 'scripts' / 'env.sh', '--check'], capture_output=True)
    if check.returncode != 0:
        pytest.skip('these tests do not run in the environment of make env')
    compiled = Path(cache_from_source(str(ROOT / 'flexarm_ros' / '__init__.py')))
    compiled.unlink(missing_ok=True)
    before = cpu_of_children()
    done = subprocess.run(
        ['make', '-s', 'env'], cwd=ROOT, capture_output=True, text=True,
        env=os.environ | {'PYTHONDONTWRITEBYTECODE': '1'},
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (0, '', '')
    assert cpu_of_children() - before < 1.5  # its wall time is as much more as others take
    assert compiled.exists()


def cpu_of_children() -> float:
    """Return the CPU time of the processes that were started and have ended, s."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def test_check_sees_that_there_is_no_environment(tree: Path) -> None:
    done = make_env(tree, '--check')
    assert (done.returncode, done.stderr) == (1, 'make env: .venv is not up to date\n')


def test_executables_are_all_the_same_file() -> None:
    files = sorted((ROOT / 'lib' / 'flexarm_ros').iterdir())
    assert [file.name for file in files] == sorted(EXECUTABLES)
    assert len({file.read_bytes() for file in files}) == 1
    assert all(os.access(file, os.X_OK) for file in files)


def test_no_registry_host_is_named() -> None:
    listed = subprocess.run(['git', 'ls-files', '-z'], cwd=ROOT, capture_output=True, check=False)
    if listed.returncode != 0:
        pytest.skip('not a git work tree')
    hosts = [part + '.org' for part in ('pypi', 'pythonhosted', 'test.pypi')]
    found = [
        name
        for name in listed.stdout.decode().split('\0')
        if name and (ROOT / name).is_file()
        for host in hosts
        if host.encode() in (ROOT / name).read_bytes()
    ]
    assert found == []


def pins(distribution: str, python: str) -> dict[str, Requirement]:
    """Return what is pinned for the wheels of a distribution on a Python, by name."""
    lines = [
        line
        for name in ('python', distribution)
        for line in (ROOT / 'constraints' / f'{name}.txt').read_text().splitlines()
        if not line.startswith('#')
    ]
    found = [pin for pin in map(Requirement, lines) if applies(pin, python)]
    names = [canonicalize_name(pin.name) for pin in found]
    assert len(names) == len(set(names))
    return dict(zip(names, found, strict=True))


def applies(requirement: Requirement, python: str, extra: str = '') -> bool:
    environment = {'python_version': python, 'python_full_version': f'{python}.9', 'extra': extra}
    return requirement.marker is None or requirement.marker.evaluate(environment)


@pytest.mark.parametrize('distribution', ['kilted', 'jazzy'])
@pytest.mark.parametrize('python', ['3.10', '3.11', '3.12', '3.13'])
def test_every_requirement_has_one_version_that_fits(distribution: str, python: str) -> None:
    pinned = pins(distribution, python)
    for pin in pinned.values():
        assert [spec.operator for spec in pin.specifier] == ['=='], pin
    metadata = importlib.metadata.metadata('flexarm_ros')
    required = [Requirement(text) for text in metadata.get_all('Requires-Dist') or []]
    for extra in ['', *(metadata.get_all('Provides-Extra') or [])]:
        for requirement in required:
            if applies(requirement, python, extra):
                (version,) = pinned[canonicalize_name(requirement.name)].specifier
                assert version.version in requirement.specifier, (requirement, version)

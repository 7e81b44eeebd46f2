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

"""The linters of ROS 2 on the whole package, where they are installed: `colcon test` runs them."""

from __future__ import annotations

import subprocess

import pytest
from repository import ROOT

ASIDE = ('build', 'install', 'log')
LINTERS = ('ament_copyright', 'ament_flake8', 'ament_pep257')
LICENSED = ('.c', '.cc', '.cpp', '.cxx', '.h', '.hh', '.hpp', '.hxx', '.cmake', '.py')
"""Endings of the files that ament_copyright reads."""


def sources() -> list[str]:
    """Return the package's files and folders with Python code; not .venv, not what is built."""
    found = [path for path in ROOT.iterdir() if path.name not in ASIDE and path.name[0] != '.']
    return sorted(str(path) for path in found if path.is_dir() or path.suffix == '.py')


@pytest.mark.parametrize('linter', LINTERS)
def test_linter_finds_nothing(linter: str, capfd: pytest.CaptureFixture[str]) -> None:
    reason = f'{linter} is not installed (ros-DISTRO-{linter.replace("_", "-")})'
    main = pytest.importorskip(f'{linter}.main', reason=reason).main
    status = main(argv=sources())
    assert status == 0, ''.join(capfd.readouterr())


def test_they_are_told_to_rosdep() -> None:
    manifest = (ROOT / 'package.xml').read_text()
    for linter in LINTERS:
        assert f'<test_depend>{linter}</test_depend>' in manifest


def test_the_licence_stands_where_ament_copyright_reads_it_and_nowhere_else() -> None:
    """LICENSE covers all other files; ament_copyright itself is not on every machine."""
    if not (ROOT / '.git').exists():
        pytest.skip('not a git checkout')
    listed = subprocess.run(['git', 'ls-files', '-z'], cwd=ROOT, capture_output=True, check=True)
    paths = [ROOT / name for name in listed.stdout.decode().split('\0') if name]
    assert any(path.suffix in LICENSED for path in paths)
    for path in paths:
        if path != ROOT / 'LICENSE' and path.is_file() and (head := path.read_bytes()[:900]):
            stated = b'Copyright 2026' in head or b'SPDX-License-Identifier' in head
            assert stated == (path.suffix in LICENSED), path

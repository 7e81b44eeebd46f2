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

"""`.ci/run` on a machine without Chromium: it tries to install it, and goes on whatever comes."""

from __future__ import annotations

import os
from pathlib import Path
import shutil
import subprocess

import pytest

ROOT = Path(__file__).resolve().parent.parent


def script(directory: Path, name: str, body: str) -> None:
    path = directory / name
    path.write_text(f'#!/bin/sh\n{body}\n')
    path.chmod(0o755)


@pytest.fixture
def tools(tmp_path: Path) -> Path:
    """Return a directory that is all of PATH: no browser, and programs that note their use."""
    found = shutil.which('dirname')
    assert found is not None
    (tmp_path / 'dirname').symlink_to(found)
    script(tmp_path, 'id', 'echo 0')
    script(tmp_path, 'make', f'echo "make $*" >>{tmp_path}/log')
    return tmp_path


def run_ci(tools: Path) -> tuple[subprocess.CompletedProcess[str], list[str]]:
    done = subprocess.run(
        ['/bin/bash', str(ROOT / '.ci' / 'run')], env={**os.environ, 'PATH': str(tools)},
        capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    return done, (tools / 'log').read_text().splitlines()


@pytest.mark.parametrize('status', [0, 1])
def test_what_tests_need_is_installed_where_that_goes(tools: Path, status: int) -> None:
    script(tools, 'apt-get', f'echo "apt-get $*" >>{tools}/log; exit {status}')
    done, log = run_ci(tools)
    assert done.returncode == 0
    for package in ('chromium', 'iproute2'):
        assert (f'no {package}: ' in done.stdout) == (status != 0)
    asked = [line for line in log if line.startswith('apt-get')]
    assert asked[0] == 'apt-get -qq update'
    assert [line.split()[-1] for line in asked[1:]] == ['chromium', 'iproute2']
    assert log[-1] == 'make --no-print-directory test'


def test_nothing_is_installed_where_all_is_there(tools: Path) -> None:
    script(tools, 'chromium', 'exit 0')
    script(tools, 'ip', 'exit 0')
    script(tools, 'apt-get', f'echo "apt-get $*" >>{tools}/log')
    done, log = run_ci(tools)
    assert done.returncode == 0
    assert log == ['make --no-print-directory test']


def test_nobody_but_root_is_asked_to_install(tools: Path) -> None:
    script(tools, 'id', 'echo 1000')
    script(tools, 'apt-get', f'echo "apt-get $*" >>{tools}/log')
    assert run_ci(tools)[1] == ['make --no-print-directory test']

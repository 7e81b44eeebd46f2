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

"""What a user of a release meets: archives, the citation, containers and workflows."""

from __future__ import annotations

import hashlib
import importlib.util
import json
import os
from pathlib import Path
import re
import shlex
import shutil
import subprocess
import sys

from flexarm_ros.cli import build_parser
import pytest
from repository import ROOT
import yaml

LEFT_OUT = shutil.ignore_patterns(
    '.git', '.venv*', '__pycache__', '.*_cache', '.hypothesis', 'runs', '_build', 'build', 'dist',
    '*.egg-info', 'docs', 'test', 'validation',
)  # fmt: skip


def tool(*words: str, **options: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, '-m', *words]
    done = subprocess.run(command, capture_output=True, text=True, **options)  # type: ignore[call-overload]
    assert done.returncode == 0, done.stdout + done.stderr
    return done


def archives(root: Path, when: int) -> dict[str, str]:
    """Build the sdist and the wheel of a copy whose files have that time; return their digests."""
    shutil.copytree(ROOT, root, ignore=LEFT_OUT)
    for path in root.rglob('*'):
        os.utime(path, (when, when))
    environment = {k: v for k, v in os.environ.items() if k != 'SOURCE_DATE_EPOCH'}
    tool('build', '--no-isolation', '--outdir', str(root / 'dist'), cwd=root, env=environment)
    found = sorted((root / 'dist').iterdir())
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in found}


@pytest.mark.skipif(importlib.util.find_spec('build') is None, reason="needs the extra 'dev'")
def test_archives_are_reproducible_and_pass_twine(tmp_path: Path) -> None:
    first = archives(tmp_path / 'first', 1_700_000_000)
    assert [Path(name).suffix for name in first] == ['.whl', '.gz']
    assert archives(tmp_path / 'second', 1_750_000_000) == first
    tool('twine', 'check', '--strict', *map(str, (tmp_path / 'first' / 'dist').iterdir()))


def test_the_citation_has_what_the_format_asks_for_and_the_version_of_the_package() -> None:
    cited = yaml.safe_load((ROOT / 'CITATION.cff').read_text())
    assert {'cff-version', 'message', 'title', 'authors'} <= set(cited)
    (version,) = re.findall('<version>(.*)</version>', (ROOT / 'package.xml').read_text())
    assert cited['version'] == version
    changes = (ROOT / 'CHANGELOG.rst').read_text()
    assert f'{version} ({cited["date-released"]})' in changes


def container_commands() -> list[str]:
    """Return the commands that the Dockerfile runs in the sources."""
    text = (ROOT / 'Dockerfile').read_text().replace('\\\n', '')
    after = text.partition('COPY . .')[2]
    commands = re.findall('^RUN (.*)$', after, re.MULTILINE)
    return [*commands, ' '.join(json.loads(re.findall(r'^CMD (\[.*\])$', after, re.MULTILINE)[0]))]


def test_the_containers_are_built_on_the_two_commands() -> None:
    assert container_commands() == ['make env', 'make run']
    known = {'FROM', 'RUN', 'WORKDIR', 'COPY', 'ENV', 'CMD', '#', ''}
    lines = (ROOT / 'Dockerfile').read_text().replace('\\\n', '').splitlines()
    assert {line.partition(' ')[0] for line in lines} <= known
    container = json.loads((ROOT / '.devcontainer' / 'devcontainer.json').read_text())
    assert (ROOT / '.devcontainer' / container['build']['dockerfile']).resolve() == (
        ROOT / 'Dockerfile'
    )
    assert container['postCreateCommand'] == 'make env'


@pytest.mark.slow
def test_the_commands_of_the_container_work_in_a_clean_directory(tmp_path: Path) -> None:
    shutil.copytree(ROOT, tmp_path / 'clean', ignore=LEFT_OUT)
    for command in container_commands():
        done = subprocess.run(
            command, shell=True, cwd=tmp_path / 'clean', capture_output=True, text=True
        )
        assert done.returncode == 0, done.stdout + done.stderr
    assert (tmp_path / 'clean' / 'runs' / 'fls_tip' / 'summary.json').is_file()


@pytest.mark.parametrize('name', ['.github/workflows/ci.yml', 'examples/workflows/controller.yml'])
def test_workflows_call_what_exists(name: str) -> None:
    workflow = yaml.safe_load((ROOT / name).read_text())
    assert True in workflow, '`on:`, which YAML 1.1 reads as true'
    steps = [step for job in workflow['jobs'].values() for step in job['steps']]
    commands = [step['run'] for step in steps if 'run' in step]
    assert commands
    for command in commands:
        program, *given = shlex.split(command.replace('$CONTROLLER', 'python3 my_controller.py'))
        if program == 'flexarm':
            build_parser(given).parse_args(given)
        elif program != 'pip':
            assert os.access(ROOT / program, os.X_OK)

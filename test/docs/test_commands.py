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

"""
Every command and every Python snippet of README and docs is run as it stands there.

A page's ``sh`` blocks run in one shell, in order, in a directory that looks like the source tree;
its ``python`` blocks then run as one script.  ``<!-- page: quick -->`` puts a page into the
default tests, every other one is slow.  A mark on the line before a block: ``<!-- test: slow -->``
leaves it out of a quick page's default run, ``<!-- test: skip (why) -->`` out of both.
``<!-- page: needs LIBRARY ... -->`` skips a page's Python where a library is missing.
"""

from __future__ import annotations

from dataclasses import dataclass
import os
from pathlib import Path
import re
import signal
import subprocess
import sys

import pytest
from repository import ROOT

PAGES = [ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', *sorted((ROOT / 'docs').rglob('*.md'))]
PAGES = [page for page in PAGES if '_build' not in page.parts]

FENCE = re.compile(
    r'^(?:<!-- test: (?P<mark>slow|skip \((?P<why>.+)\)) -->\n)?'
    r'^```(?P<kind>[^\n]*)\n(?P<text>.*?)^```$',
    re.MULTILINE | re.DOTALL,
)
RUN = {'sh', 'python'}
SHOWN = {'', 'text', 'yaml', 'json', 'toml', 'xml', 'math', 'cpp', 'csv', 'bibtex'}
COMMAND = re.compile(r'^(?: {4}|\t)(flexarm|make|ros2|python3?|pip|mcap|colcon) ', re.MULTILINE)
LINK = re.compile(r'\]\((?!https?:|mailto:|#)([^)#\s]+)(?:#[^)\s]*)?\)')
NEEDS = re.compile(r'^<!-- page: needs ([a-z ]+) -->$', re.MULTILINE)
NOTEBOOK = "an extra is missing; pip install 'flexarm_ros[notebook]'"
LIMIT_S = {'quick': 600.0, 'slow': 3600.0}

# What stands around a page's commands.  The tests run in what `make env` makes, and are what
# `make test` runs: neither is done again.
PRELUDE = """
set -euo pipefail
trap 'kill $(jobs -p) 2>/dev/null || true' EXIT
make() { case "$1" in env | test | test-all) ;; *) command make -o env "$@" ;; esac; }
"""


@dataclass(frozen=True)
class Block:
    kind: str
    text: str
    mark: str


def blocks(page: Path) -> list[Block]:
    found = []
    for match in FENCE.finditer(page.read_text('utf-8')):
        mark = (match['mark'] or '').partition(' ')[0]
        found.append(Block(match['kind'], match['text'], mark))
    return found


def is_quick(page: Path) -> bool:
    return '<!-- page: quick -->' in page.read_text('utf-8')


def name(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


WITH_COMMANDS = [page for page in PAGES if any(block.kind in RUN for block in blocks(page))]


@pytest.mark.nodes
@pytest.mark.parametrize('page', [p for p in WITH_COMMANDS if is_quick(p)], ids=name)
def test_commands_of_a_quick_page(page: Path, tmp_path: Path, ros_domain: int) -> None:
    run_page(page, tmp_path, ros_domain, {'skip', 'slow'}, LIMIT_S['quick'])


@pytest.mark.slow
@pytest.mark.nodes
@pytest.mark.parametrize('page', WITH_COMMANDS, ids=name)
def test_commands_of_a_page(page: Path, tmp_path: Path, ros_domain: int) -> None:
    run_page(page, tmp_path, ros_domain, {'skip'}, LIMIT_S['slow'])


def run_page(page: Path, directory: Path, domain: int, left_out: set[str], limit: float) -> None:
    """Run a page's blocks in ``directory``; fail with what they said."""
    for path in ROOT.iterdir():
        if path.name not in {'runs', '.git'}:
            (directory / path.name).symlink_to(path)
    taken = [block for block in blocks(page) if block.mark not in left_out]
    shell = ''.join(block.text for block in taken if block.kind == 'sh')
    shell = re.sub(r'ROS_DOMAIN_ID=\d+', f'ROS_DOMAIN_ID={domain}', shell)
    if shell:
        run(['/bin/bash', '-c', PRELUDE + shell], directory, limit, name(page))
    python = ''.join(block.text for block in taken if block.kind == 'python')
    needs = NEEDS.search(page.read_text('utf-8'))
    for library in needs[1].split() if python and needs else ():
        pytest.importorskip(library, reason=NOTEBOOK)
    if python:
        script = directory / 'snippets.py'
        script.write_text(python, 'utf-8')
        run([sys.executable, str(script)], directory, limit, name(page))


def run(command: list[str], directory: Path, limit: float, page: str) -> None:
    environment = {
        **os.environ,
        'PATH': f'{Path(sys.executable).parent}:{os.environ["PATH"]}',
        'PYTHONPATH': str(ROOT),
        'BROWSER': 'true',
    }
    process = subprocess.Popen(
        command, cwd=directory, env=environment, stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True,
    )  # fmt: skip
    try:
        said, _ = process.communicate(timeout=limit)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        said, _ = process.communicate()
        pytest.fail(f'{page}: not over after {limit:g} s:\n{said[-4000:]}')
    assert process.returncode == 0, f'{page}: exit status {process.returncode}:\n{said[-4000:]}'
    assert 'Traceback' not in said, f'{page}:\n{said[-4000:]}'


@pytest.mark.parametrize('page', PAGES, ids=name)
def test_no_command_escapes(page: Path) -> None:
    """Commands stand in blocks that are run, and blocks are of kinds that are known."""
    kinds = {block.kind for block in blocks(page) if not block.kind.startswith('{')}
    assert kinds <= RUN | SHOWN
    rest = FENCE.sub('', page.read_text('utf-8'))
    assert '```' not in rest.replace('`````', '')
    assert COMMAND.findall(rest) == []


@pytest.mark.parametrize('page', PAGES, ids=name)
def test_links_lead_somewhere(page: Path) -> None:
    text = FENCE.sub('', page.read_text('utf-8'))
    targets = {target for target in LINK.findall(text) if not target.startswith('<')}
    missing = [target for target in targets if not (page.parent / target).exists()]
    assert missing == []


def test_the_quick_pages_are_some_and_not_all() -> None:
    quick = [page for page in WITH_COMMANDS if is_quick(page)]
    assert len(quick) >= 2 and len(quick) < len(WITH_COMMANDS)

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

"""docs/validation.md is what `make validate` writes, as far as quick sections show."""

from __future__ import annotations

import json
import re
import subprocess
import sys

import pytest
from repository import ROOT
from validation import __main__ as command
from validation import bending, delays, frequencies, rotation
from validation.report import Goal, goals_table, Section

PAGE = (ROOT / 'docs' / 'validation.md').read_text('utf-8')


def table(name: str) -> str:
    return PAGE.split(f'<!-- table {name} -->\n')[1].split(f'\n<!-- end {name} -->')[0]


def test_the_page_has_a_place_for_each_section_and_the_summary_is_of_its_goals() -> None:
    marks = re.findall(r'<!-- table (\w+) -->', PAGE)
    assert sorted(marks) == sorted([*command.SECTIONS, 'goals'])
    stored = json.loads(command.GOALS.read_text('utf-8'))
    assert list(stored) == list(command.SECTIONS)
    goals = [Goal(**goal) for group in stored.values() for goal in group]
    assert table('goals').splitlines() == goals_table(goals)
    # What is not met is said, and is shown to be impossible.
    assert all(goal.met or goal.out_of_reach for goal in goals)


@pytest.mark.parametrize('module', [bending, rotation, delays])
def test_quick_sections_are_as_written(module) -> None:
    section: Section = module.run()
    assert all(goal.met for goal in section.goals)
    if module is not delays:  # prints rounding errors too, which are the machine's own
        assert table(module.__name__.split('.')[-1]) == section.text()


def test_pictures_are_there() -> None:
    for name in re.findall(r'\(images/(\w+\.png)\)', PAGE):
        assert (ROOT / 'docs' / 'images' / name).read_bytes().startswith(b'\x89PNG')


def test_four_functions_cannot_serve_one_link_and_five_can() -> None:
    assert 0.5 * frequencies.least_misfit(4) > frequencies.LIMIT
    assert 0.5 * frequencies.least_misfit(5) < 0.01 * frequencies.LIMIT


def test_static_deflection_against_the_elastica() -> None:
    # Bisshopp and Drucker (1945): P L^2 / EI = 1 gives 0.3017 and 0.0564 of the length.
    assert bending.elastica(1.0) == pytest.approx((0.30172, 0.05643), abs=2e-5)
    assert bending.ours(0.01) == pytest.approx((0.01 / 3.0, 0.01**2 / 15.0), rel=1e-9)


def test_an_unknown_section_is_refused() -> None:
    words = [sys.executable, '-m', 'validation', 'everything']
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert 'everything' in done.stderr

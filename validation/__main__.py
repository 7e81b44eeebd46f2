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
Write the tables and pictures of docs/validation.md.

    make validate                                   # everything: some ten minutes
    .venv/bin/python -m validation                  # the same
    .venv/bin/python -m validation frequencies ...  # some of the sections

Exit status 1 where a goal is not met that was not known to be out of reach.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import json
from pathlib import Path
import sys
import time

from validation.pictures import save
from validation.report import Goal, goals_table, Section
from validation.tables import put

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / 'docs' / 'validation.md'
IMAGES = ROOT / 'docs' / 'images'
GOALS = ROOT / 'docs' / 'data' / 'validation_goals.json'
SECTIONS = (
    'frequencies', 'bending', 'rotation', 'conservation', 'references', 'another_code', 'joints',
    'nonminimum_phase', 'delays', 'integrator',
)  # fmt: skip
WITH_EXUDYN = ('another_code', 'joints')


def write(name: str, section: Section) -> None:
    """Put a section's tables, pictures and goals where they belong."""
    for picture, figure in section.pictures.items():
        save(figure, IMAGES / f'validation_{picture}.png')
    known = json.loads(GOALS.read_text('utf-8')) if GOALS.exists() else {}
    known[name] = [goal._asdict() for goal in section.goals]
    ordered = {key: known[key] for key in SECTIONS if key in known}
    GOALS.write_text(json.dumps(ordered, indent=1) + '\n', 'utf-8')
    goals = [Goal(**goal) for group in ordered.values() for goal in group]
    put(PAGE, {name: [section.text()], 'goals': goals_table(goals)})


def main() -> int:
    """Compute the sections asked for and write them."""
    parser = argparse.ArgumentParser(prog='python -m validation', description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument('section', nargs='*', help=', '.join(SECTIONS))
    chosen = parser.parse_args().section
    if unknown := set(chosen) - set(SECTIONS):
        parser.error(f'{unknown.pop()}: sections are {", ".join(SECTIONS)}')
    failed = False
    for name in chosen or SECTIONS:
        if name in WITH_EXUDYN and importlib.util.find_spec('exudyn') is None:
            print(f'{name}: exudyn is not installed (it has wheels for x86_64); left as it is')
            continue
        begin = time.monotonic()
        section: Section = importlib.import_module(f'validation.{name}').run()
        write(name, section)
        print(f'{section.title}, {time.monotonic() - begin:.0f} s')
        for goal in section.goals:
            verdict = 'met' if goal.met else 'NOT MET'
            print(f'  {verdict}: {goal.what}: {goal.measured} (limit {goal.limit})', flush=True)
            failed = failed or not (goal.met or goal.out_of_reach)
    print(f'written: {PAGE.relative_to(ROOT)}, {IMAGES.relative_to(ROOT)}/validation_*.png')
    return 1 if failed else 0


if __name__ == '__main__':
    sys.exit(main())

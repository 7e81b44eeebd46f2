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

"""``flexarm list``: list the shipped scenarios, suites and sweeps, one per line."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from flexarm_ros.scenario import locate


def add_parser(make: Any) -> None:
    """Add the command to the main parser; ``make`` returns its parser."""
    parser = make(
        description='List the shipped scenarios, suites and sweeps, one per line. '
        'The other commands accept these names.',
    )
    parser.add_argument('--paths', action='store_true', help='show the path of each file instead')
    parser.add_argument(
        '--list-laws', action='store_true',
        help='list the control laws instead, each with the package that it comes from',
    )  # fmt: skip
    parser.add_argument(
        '--parts', action='store_true', help='list the parts of a run instead, with their topics'
    )


def run(args: argparse.Namespace) -> int:
    """Print the list; returns 0, or 1 if nothing is shipped here."""
    if args.list_laws or args.parts:
        _print_table([*(_laws() if args.list_laws else ()), *(_parts() if args.parts else ())])
        return 0
    groups = {
        'scenario': locate.shipped(),
        'suite': locate.shipped_suites(),
        'sweep': locate.shipped_sweeps(),
    }
    width = max((len(name) for group in groups.values() for name in group), default=0)
    for kind, group in groups.items():
        for name, path in group.items():
            print(f'{name:<{width}}  {kind:<8}  {_text(path, args.paths)}'.rstrip())
    return 0 if any(groups.values()) else 1


def _laws() -> Iterable[tuple[str, str]]:
    """Return the laws that a scenario can name, and where each comes from."""
    from flexarm_ros.core.control import BUILT_IN
    from flexarm_ros.scenario.plugins.registry import installed_laws, LAW_GROUP, package_of

    yield from ((name, 'flexarm_ros') for name in BUILT_IN)
    for name, point in sorted(installed_laws().items()):
        yield name, f'{package_of(point)} ({point.value})'
    yield from _ignored(LAW_GROUP)


def _ignored(group: str) -> Iterable[tuple[str, str]]:
    """Return the entry points that cannot be used because their name is taken."""
    from flexarm_ros.scenario.plugins.registry import ignored, package_of

    for point in ignored(group):
        yield (
            point.name,
            (f'ignored, the name is one of flexarm_ros: {package_of(point)} ({point.value})'),
        )


def _parts() -> Iterable[tuple[str, str]]:
    """Return the parts that a scenario can have, what each publishes and where it comes from."""
    from flexarm_ros import scenario
    from flexarm_ros.core.run.parts import part_of, PARTS
    from flexarm_ros.scenario.errors import ScenarioError
    from flexarm_ros.scenario.plugins.registry import installed_parts, package_of, PART_GROUP

    for part in PARTS:
        optional = part.Parameters is not None
        config = scenario.from_dict({part.NAME: {}} if optional else {})
        topics = ', '.join(signal.name for signal in part.signals(config))
        yield part.NAME, f'{topics} (optional)' if optional else topics
    for name, point in sorted(installed_parts().items()):
        try:
            config = scenario.from_dict({name: {}})
            topics = ', '.join(signal.name for signal in part_of(name).signals(config))
        except ScenarioError as error:
            topics = f'cannot be used: {error}'
        yield name, f'{topics} (optional, {package_of(point)})'
    yield from _ignored(PART_GROUP)


def _print_table(rows: list[tuple[str, str]]) -> None:
    width = max(len(name) for name, _ in rows)
    for name, text in rows:
        print(f'{name:<{width}}  {text}'.rstrip())


def _text(path: Path, show_path: bool) -> str:
    return str(path) if show_path else locate.first_comment(path)

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
from pathlib import Path
from typing import Any

from flexarm_ros.scenario import locate


def add_parser(subparsers: Any) -> None:
    """Add the command to the main parser."""
    parser = subparsers.add_parser(
        'list',
        help='list the shipped scenarios and suites',
        description='List the shipped scenarios, suites and sweeps, one per line. '
        'The other commands accept these names.',
    )
    parser.add_argument('--paths', action='store_true', help='print the path of each file instead')


def run(args: argparse.Namespace) -> int:
    """Print the list; return 0, or 1 if nothing is installed."""
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


def _text(path: Path, show_path: bool) -> str:
    return str(path) if show_path else locate.first_comment(path)

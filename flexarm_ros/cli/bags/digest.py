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

"""``flexarm digest``: one SHA-256 of all messages of a run."""

from __future__ import annotations

import argparse
from typing import Any


def add_parser(make: Any) -> None:
    """Add the command to the main parser; ``make`` returns its parser."""
    parser = make(
        description='Print one SHA-256 of topic, log time and bytes of every message in RUN (a '
        "run's directory, the bag in it or the .mcap file). Runs with equal digests hold the same "
        'messages; scenario, versions and compression do not count.',
        epilog='Exit status: 0 printed; 1 the bag cannot be read or is damaged.',
    )
    parser.add_argument('run', metavar='RUN', help='output directory of a run, or its bag')


def run(args: argparse.Namespace) -> int:
    """Print the digest; return 0."""
    from flexarm_ros.bag.checks.digest import digest_of

    print(digest_of(args.run))
    return 0

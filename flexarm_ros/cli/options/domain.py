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

"""The option ``--domain``, and the ROS environment variables that it overrides."""

from __future__ import annotations

import argparse
import sys

from flexarm_ros.cli import UsageError
from flexarm_ros.nodes.runtime.process import environment


def add_option(parser: argparse.ArgumentParser, otherwise: str) -> None:
    """Add ``--domain``; ``otherwise`` describes the default if the environment sets none."""
    parser.add_argument(
        '--domain', type=_domain, metavar='N',
        help=f'ROS_DOMAIN_ID (default: that of the environment, else {otherwise})',
    )  # fmt: skip


def chosen_domain(given: int | None) -> int | None:
    """
    Return the given domain, else that of the environment, else None.

    Raises UsageError if the environment's is invalid or asks for unavailable security.
    """
    try:
        domain = environment.environment_domain() if given is None else given
        environment.enforce_security()
    except environment.EnvironmentRefused as error:
        raise UsageError(str(error)) from None
    for note in environment.environment_notes():
        print(note, file=sys.stderr)
    return domain


def _domain(text: str) -> int:
    try:
        return environment.read_domain(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None

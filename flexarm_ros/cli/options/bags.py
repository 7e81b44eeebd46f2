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

"""Options of the commands that read bags written by other recorders."""

from __future__ import annotations

import argparse
from typing import Any, TYPE_CHECKING

from flexarm_ros.cli import UsageError

if TYPE_CHECKING:
    from flexarm_ros.core.parameters.sections import RunConfig


def add_bag_options(parser: argparse.ArgumentParser, namespace: str = '--namespace') -> None:
    """Add the options to a command's parser; ``namespace`` is the name of one of them."""
    add_trust_option(parser)
    group = parser.add_argument_group('for a bag of `ros2 bag record` or `ros2 bag convert`')
    group.add_argument(
        '--scenario', metavar='SCENARIO',
        help='scenario of the run (a file or a shipped name), which such a bag does not contain',
    )  # fmt: skip
    group.add_argument(
        '--set', action='append', default=[], dest='overrides', metavar='NODE.KEY=VALUE',
        help='override a parameter of SCENARIO, as the run did; may repeat',
    )  # fmt: skip
    group.add_argument(
        namespace, metavar='NS', help='namespace of the run to read if the bag contains several'
    )


def add_trust_option(parser: argparse.ArgumentParser) -> None:
    """Add the option that lets a bag name a law that is no installed entry point."""
    parser.add_argument(
        '--trust', action=_Trust, default=[], metavar='PACKAGE.MODULE',
        help='import a control law from this module or package if the bag names it; without '
        'it only installed laws are used; repeats',
    )  # fmt: skip


class _Trust(argparse.Action):
    """Trusts a module in this process."""

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: Any,
        option_string: str | None = None,
    ) -> None:  # fmt: skip
        from flexarm_ros.scenario.plugins.registry import trust

        if not all(part.isidentifier() for part in values.split('.')):
            parser.error(f'argument --trust: {values!r} is not a PACKAGE.MODULE')
        trust([values])


def given_scenario(args: argparse.Namespace) -> RunConfig | None:
    """Return the given scenario, None without one; UsageError for --set alone."""
    from flexarm_ros import scenario

    if args.scenario is not None:
        return scenario.load(args.scenario, args.overrides)
    if args.overrides:
        raise UsageError('--set: needs --scenario')
    return None

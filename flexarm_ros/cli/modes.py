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

"""``flexarm modes``: natural frequencies of the arm at an elbow angle."""

from __future__ import annotations

import argparse
import json
import math
from typing import Any

JOINTS = ('locked', 'free', 'shoulder-locked', 'elbow-locked')


def add_parser(make: Any) -> None:
    """Add the command to the main parser; ``make`` returns its parser."""
    parser = make(
        description='Print the natural frequencies (undamped, links straight, at rest) of a '
        "scenario's arm at an elbow angle, in rad/s, without the rigid-body modes. They include "
        "the scenario's hub inertias and end masses; plant.model eq14 gives those of (14).",
    )
    parser.add_argument('scenario', metavar='SCENARIO', help="a file or a shipped scenario's name")
    parser.add_argument(
        '--elbow', type=_angle, default=0.0, metavar='RAD', help='theta2 in rad (default 0)'
    )
    parser.add_argument(
        '--joints', choices=JOINTS, default='locked', help='joints that are held (default locked)'
    )
    parser.add_argument('--json', action='store_true', help='print JSON instead of a table')
    parser.add_argument(
        '--set', action='append', default=[], dest='overrides', metavar='NODE.KEY=VALUE',
        help='override a parameter; may repeat',
    )  # fmt: skip


def _angle(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f'{text!r} is not a finite angle in rad')
    return value


def run(args: argparse.Namespace) -> int:
    """Print the frequencies; return 0."""
    from flexarm_ros.scenario import load
    from flexarm_ros.stability.modes import natural_frequencies

    config = load(args.scenario, args.overrides)
    frequencies = [float(w) for w in natural_frequencies(config, args.elbow, args.joints)]
    if args.json:
        print(
            json.dumps(
                {'frequencies_rad_s': frequencies, 'joints': args.joints, 'elbow': args.elbow}
            )
        )
        return 0
    plant = config.plant
    basis = f', {plant.basis}' if plant.model == 'full' else ''
    print(f'model {plant.model}, {plant.modes} modes a link{basis}; ', end='')
    print(f'joints {args.joints}, elbow {args.elbow:g} rad')
    for index, omega in enumerate(frequencies, start=1):
        print(f'{index:3d}  {omega:14.6g} rad/s  {omega / (2.0 * math.pi):14.6g} Hz')
    return 0

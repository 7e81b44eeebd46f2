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

"""``flexarm stability``: eigenvalues and margins of the sampled loop, linearised about rest."""

from __future__ import annotations

import argparse
import json
import math
from typing import Any, TYPE_CHECKING

from flexarm_ros.cli import UsageError
from flexarm_ros.cli.options.numbers import number

if TYPE_CHECKING:
    from flexarm_ros.core.parameters.sections import RunConfig
    from flexarm_ros.stability.margins import PoseStability

MOST_SEARCHED_S = 1.0
MOST_EIGENVALUES = 6
"""Number of eigenvalues printed per gain; a conjugate pair counts once."""


def add_parser(make: Any) -> None:
    """Add the command to the main parser; ``make`` returns its parser."""
    parser = make(
        description='Linearise the closed loop of SCENARIO (a file or the name of a shipped one) '
        'about rest at poses along its trajectory, with zero-order-hold torques and the exact '
        'delay. For each pose, print the largest eigenvalue per tick, the range of stable gains '
        'and the latency at which stability is lost. For fls the gain is K_s lambda: at rest, '
        'halfway and at its largest. Gains of lqg and adaptive are frozen at the time of the '
        "pose; the law's own estimate of the latency stays fixed while the latency is varied. "
        'These two laws and passive take about ten seconds a pose.',
        epilog='Exit status: 0 (stable or not); 2 for a bad scenario, or a law without a linear '
        'form.',
    )
    parser.add_argument('scenario', metavar='SCENARIO', help="a file or a shipped scenario's name")
    parser.add_argument(
        '--set', action='append', default=[], dest='overrides', metavar='NODE.KEY=VALUE',
        help='override a parameter; may repeat',
    )  # fmt: skip
    parser.add_argument(
        '--elbow', type=_finite, nargs='+', metavar='RAD',
        help='theta2 of the poses, rad (default: seven along the trajectory)',
    )  # fmt: skip
    parser.add_argument(
        '--gain', type=_positive, nargs='+', metavar='G',
        help="gains on J^T (Kp e + Kd e'), K_s lambda for fls (default: for fls 1/6, 1/2 and 5/6 "
        'of K_s; otherwise that of the law)',
    )  # fmt: skip
    parser.add_argument(
        '--max-latency', type=_latency, default=0.06, metavar='S',
        help='upper limit of the search for the crossing delay, s (default 0.06)',
    )  # fmt: skip
    parser.add_argument(
        '--integrator', choices=('exact', 'plant'), default='exact',
        help="motion between ticks: exact, or by the plant's integration steps",
    )  # fmt: skip
    parser.add_argument('--json', action='store_true', help='print JSON instead of a table')


def _finite(text: str) -> float:
    value = number(text)
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f'{text!r} is not a finite number')
    return value


def _positive(text: str) -> float:
    value = _finite(text)
    if not 1e-9 <= value <= 1e9:
        raise argparse.ArgumentTypeError(f'{text}: allowed are 1e-9 to 1e9')
    return value


def _latency(text: str) -> float:
    value = _finite(text)
    if not 0.0 < value <= MOST_SEARCHED_S:
        raise argparse.ArgumentTypeError(f'{text}: allowed are over 0 to {MOST_SEARCHED_S:g} s')
    return value


def run(args: argparse.Namespace) -> int:
    """Print the analysis; return 0."""
    from flexarm_ros.scenario import load
    from flexarm_ros.stability.margins import analyse, Pose, poses_along

    config = load(args.scenario, args.overrides)
    poses = [Pose(None, 0.0, angle) for angle in args.elbow] if args.elbow else poses_along(config)
    gains = args.gain or _default_gains(config)
    try:
        found = [
            analyse(config, pose, gain, args.max_latency, args.integrator)
            for gain in gains
            for pose in poses
        ]
    except ValueError as error:
        raise UsageError(str(error)) from None
    if args.json:
        print(json.dumps(_as_json(config, found), indent=1, allow_nan=False))
    else:
        _print_table(config, found)
    return 0


def _default_gains(config: RunConfig) -> list[float | None]:
    if config.controller.law != 'fls':
        return [None]
    return [None, config.controller.ks / 2.0, config.controller.ks * 5.0 / 6.0]


def _read(config: RunConfig) -> tuple[str, str]:
    """Return the sensor whose latency is varied and the source of the law's rates."""
    from flexarm_ros.core.control import LAWS, PLANNING
    from flexarm_ros.stability.sampled_loop import sensor_of

    law = config.controller.law
    own = law in PLANNING or LAWS[law].SENSOR == 'encoder'
    return sensor_of(config), 'encoder' if own else config.controller.velocity_source


def _as_json(config: RunConfig, found: list[PoseStability]) -> dict[str, Any]:
    from flexarm_ros.stability.sampled_loop import largest_latency_s, left_out, sensor_of

    by_gain = _by_gain(found)
    return {
        'law': config.controller.law,
        'feedback': _read(config)[0],
        'velocity_source': _read(config)[1],
        'location_m': config.tip_sensor.location,
        'measurand': config.tip_sensor.measurand,
        'control_period_s': config.run.control_period,
        'latency_s': found[0].latency_s,
        'largest_latency_s': largest_latency_s(config.section(sensor_of(config))),
        'states': found[0].states,
        **{key: value for key, value in by_gain[0].items() if key != 'gain'},
        'gains': by_gain,
        'not_in_the_analysis': left_out(config),
        'poses': [_pose_json(one) for one in found],
    }


def _by_gain(found: list[PoseStability]) -> list[dict[str, Any]]:
    """Return the worst case over all poses for each gain, in the order of the analysis."""
    result = []
    for gain in dict.fromkeys(one.gain for one in found):
        poses = [one for one in found if one.gain == gain]
        crossings = [one.crossing_s for one in poses if one.crossing_s is not None]
        result.append(
            {
                'gain': gain,
                'stable': all(one.stable for one in poses),
                'modulus': max(one.modulus for one in poses),
                'crossing_delay_s': min(crossings, default=None),
            }
        )
    return result


def _bound(config: RunConfig, worst: dict[str, Any], searched_s: float) -> str:
    """Return a line on the largest latency of the loop's sensor, empty without jitter."""
    from flexarm_ros.stability.sampled_loop import largest_latency_s, sensor_of

    sensor = sensor_of(config)
    channel = config.section(sensor)
    largest, crossing = largest_latency_s(channel), worst['crossing_delay_s']
    if not channel.jitter and channel.latencies is None:
        return ''
    if largest is None:
        return f'  jitter of {sensor}: {channel.jitter_distribution}, no largest latency, no bound'
    if crossing is not None:
        verdict = 'below' if largest < crossing else 'NOT below'
        verdict += ' the smallest crossing delay'
    else:
        verdict = (
            'below any crossing' if largest <= searched_s else 'beyond the latencies searched'
        )
    return f'  jitter of {sensor}: largest latency {1e3 * largest:.4g} ms, {verdict}'


def _pose_json(one: PoseStability) -> dict[str, Any]:
    return {
        'time_s': one.pose.time,
        'theta1': one.pose.theta1,
        'theta2': one.pose.theta2,
        'gain': one.gain,
        'stable': one.stable,
        'modulus': one.modulus,
        'growth_rate_per_s': one.rate if math.isfinite(one.rate) else None,
        'frequency_rad_s': one.frequency,
        'gain_range': [one.gain_low, one.gain_high],
        'gain_margin': one.gain_margin,
        'crossing_delay_s': one.crossing_s,
        'delay_margin_s': one.delay_margin_s,
        'searched_s': one.searched_s,
        'eigenvalues': [[value.real, value.imag] for value in one.eigenvalues],
    }


_HEADER = (
    'theta2', 'gain', 'stable', 'modulus', 'rate', 'at', 'stable gains', 'crossing', 'margin',
)  # fmt: skip
_UNITS = ('rad', '', '', 'of a tick', '1/s', 'rad/s', '', 'ms', 'ms')


def _print_table(config: RunConfig, found: list[PoseStability]) -> None:
    from flexarm_ros.stability.sampled_loop import left_out

    sensor, rates = _read(config)
    place = (
        f'{config.tip_sensor.measurand} at {config.tip_sensor.location:g} m'
        if sensor == 'tip_sensor'
        else 'joint angles'
    )
    print(
        f'{config.controller.law}, {sensor} ({place}), rates from {rates}, '
        f'latency {1e3 * found[0].latency_s:g} ms,\n'
        f'plant {config.plant.model} with {config.plant.modes} modes a link, '
        f'tick {1e3 * config.run.control_period:g} ms, {found[0].states} states'
    )
    rows = [_HEADER, _UNITS, *(_cells(one) for one in found)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(_HEADER))]
    for row in rows:
        print('  '.join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)))
    for worst in _by_gain(found):
        crossing = worst['crossing_delay_s']
        least = _beyond(found[0]) if crossing is None else f'{1e3 * crossing:.4g}'
        print(
            f'gain {worst["gain"]:.4g}: {"stable" if worst["stable"] else "UNSTABLE"}, largest '
            f'modulus {worst["modulus"]:.8f}, smallest crossing delay {least} ms'
        )
        if bound := _bound(config, worst, found[0].searched_s):
            print(bound)
        print(_eigenvalues(max((x for x in found if x.gain == worst['gain']), key=_modulus)))
    if keys := left_out(config):
        print(f'not in the analysis: {", ".join(keys)}')


def _cells(one: PoseStability) -> tuple[str, ...]:
    margin = one.delay_margin_s
    return (
        f'{one.pose.theta2:.3f}',
        f'{one.gain:.4g}',
        'yes' if one.stable else 'NO',
        f'{one.modulus:.8f}',
        f'{one.rate:.4g}',
        f'{one.frequency:.4g}',
        _range(one),
        _beyond(one) if one.crossing_s is None else f'{1e3 * one.crossing_s:.4g}',
        '-' if margin is None else f'{1e3 * margin:.4g}',
    )


def _modulus(one: PoseStability) -> float:
    return one.modulus


def _eigenvalues(one: PoseStability) -> str:
    """Return the largest eigenvalues per tick at a pose; a conjugate pair counts once."""
    upper = [value for value in one.eigenvalues if value.imag >= 0.0]
    shown = [
        f'{value.real:.6f}' + (f'+-{value.imag:.6f}j' if value.imag else '')
        for value in upper[:MOST_EIGENVALUES]
    ]
    more = '' if len(upper) <= MOST_EIGENVALUES else ', ... (--json: all over 0.5)'
    return f'  eigenvalues at theta2 {one.pose.theta2:.3f}: {", ".join(shown)}{more}'


def _range(one: PoseStability) -> str:
    if not one.stable and one.gain_high is None:
        return 'none'
    low = '0' if one.gain_low is None else f'{one.gain_low:.4g}'
    high = 'any' if one.gain_high is None else f'{one.gain_high:.4g}'
    return f'{low} to {high}'


def _beyond(one: PoseStability) -> str:
    return f'over {1e3 * one.searched_s:.4g}'

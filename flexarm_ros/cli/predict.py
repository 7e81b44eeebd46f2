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

"""``flexarm predict``: how well a scenario predicts a recording of an arm."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from dataclasses import asdict
import json
import math
from pathlib import Path
import sys
from typing import Any, TYPE_CHECKING

if TYPE_CHECKING:
    from flexarm_ros.identification.prediction.predict import Prediction

UNITS = {'theta': 'rad', 'tip_': 'm'}


def add_parser(make: Any) -> None:
    """Add the command to the main parser; ``make`` returns its parser."""
    parser = make(
        description='Predict the recording DATA (a CSV, a run or a bag) by the arm and the '
        'sensors of a scenario. Print for each channel the fit, 100 (1 - |y - yhat| / '
        '|y - mean y|), the variance accounted for, and the rms of the residual. CSV columns '
        'carry their unit: t_s, theta1_deg, strain1_rad, i1_a, tau1_nm, tip_x_m and so on.',
        epilog='Exit status: 0; 1 if the prediction diverges; 2 for bad data or a bad scenario.',
    )
    add_data_options(parser)
    parser.add_argument('data', metavar='DATA', help='a CSV file, a run or a bag')
    parser.add_argument(
        '--window', type=positive, metavar='T',
        help='predict windows of T s, each from the state estimated from the data '
        'before it (default: all data from rest)',
    )  # fmt: skip
    parser.add_argument('--json', action='store_true', help='print JSON instead of a table')
    parser.add_argument(
        '--out', type=Path, metavar='DIR',
        help='write pictures of measured, predicted and residual, with their spectra, and '
        'prediction.html with everything into DIR, which must be empty',
    )  # fmt: skip


def add_data_options(parser: argparse.ArgumentParser) -> None:
    """Add what ``predict`` and ``fit`` share."""
    from flexarm_ros.identification.prediction.modes import MODES

    parser.add_argument(
        '--scenario', required=True, metavar='SCENARIO',
        help="a file or a shipped scenario's name; plant.model must be full",
    )  # fmt: skip
    parser.add_argument(
        '--mode', choices=MODES, default='driven',
        help='; '.join(f'{name}: {text}' for name, text in MODES.items()) + ' (default driven)',
    )  # fmt: skip
    parser.add_argument(
        '--zero', type=positive, metavar='T0',
        help='take the offsets of strain channels from the first T0 s of the data',
    )  # fmt: skip
    parser.add_argument(
        '--set', action='append', default=[], dest='overrides', metavar='NODE.KEY=VALUE',
        help='override a parameter; may repeat',
    )  # fmt: skip


def positive(text: str) -> float:
    """Return a finite number above 0."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f'{text!r} is not a number of seconds above 0')
    return value


def run(args: argparse.Namespace) -> int:
    """Print the comparison; return 0, or 1 if the prediction diverges."""
    from flexarm_ros.cli.options.output import new_directory
    from flexarm_ros.identification.prediction.predict import predict, ringing_of
    from flexarm_ros.identification.recording import read
    from flexarm_ros.identification.setting import load_setting
    import numpy as np

    out = args.out and new_directory(args.out, '')
    setting = load_setting(args.scenario, args.overrides)
    recording = read(Path(args.data))
    say_notes('predict', recording.name, recording.notes)
    prediction = predict(recording, setting, args.mode, args.window, args.zero)
    say_notes('predict', recording.name, prediction.notes)
    diverged = [
        name
        for name, channel in prediction.channels.items()
        if not np.isfinite(channel.predicted).all()
    ]
    for name in diverged:
        print(f'flexarm predict: {name}: the prediction diverges', file=sys.stderr)
    measured, predicted = ringing_of(recording, setting, args.zero)
    if args.json:
        ring = {'measured': list(map(asdict, measured)), 'predicted': list(map(asdict, predicted))}
        context = {**_context(prediction), 'ringing': ring}
        print(json.dumps({'channels': finite(prediction.numbers), **finite(context)}))
    else:
        print_table(prediction.numbers, _title(prediction))
        for one, other in zip(measured, predicted, strict=False):
            print(
                f'rings at {one.frequency:.3f} Hz, damping {one.damping:.4f}; predicted '
                f'{other.frequency:.3f} Hz, {other.damping:.4f}'
            )
    if out:
        from flexarm_ros.identification.report.store import write_prediction

        files = write_prediction(prediction, (measured, predicted), out)
        print(*files, sep='\n', file=sys.stderr if args.json else sys.stdout)
    return 1 if diverged else 0


def say_notes(command: str, name: str, notes: Iterable[str]) -> None:
    """Print a line on stderr for each note about the recording with a name."""
    for note in notes:
        print(f'flexarm {command}: {name}: {note}', file=sys.stderr)


def finite(numbers: Any) -> Any:
    """Return nested numbers with None for those that are not finite."""
    if isinstance(numbers, dict):
        return {key: finite(value) for key, value in numbers.items()}
    if isinstance(numbers, list):
        return [finite(value) for value in numbers]
    return None if isinstance(numbers, float) and not math.isfinite(numbers) else numbers


def _context(prediction: Prediction) -> dict[str, Any]:
    return {
        'mode': prediction.mode,
        'window': prediction.window,
        'offsets': dict(prediction.offsets),
    }


def _title(prediction: Prediction) -> str:
    return f'{prediction.recording.name}: {prediction.manner}'


def print_table(numbers: dict[str, dict[str, float | None]], title: str) -> None:
    """Print fit, vaf and rms of each channel."""
    print(title)
    print(f'{"channel":14s} {"fit, %":>8s} {"vaf, %":>8s} {"rms":>11s}')
    for name, row in numbers.items():
        cells = (_cell(row['fit'], '8.2f'), _cell(row['vaf'], '8.2f'), _cell(row['rms'], '11.4g'))
        print(f'{name:14s} {" ".join(cells)} {_unit(name)}')


def _cell(value: float | None, form: str) -> str:
    if value is None or not math.isfinite(value):
        return f'{"-":>{form.split(".")[0]}s}'
    return f'{value:{form}}'


def _unit(name: str) -> str:
    if name.endswith('_rate'):
        return 'rad/s'
    return next((unit for stem, unit in UNITS.items() if name.startswith(stem)), '')

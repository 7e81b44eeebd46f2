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

"""The files of a fit (``fit.json``, ``fitted.yaml``) and of a prediction: pictures, a page."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
import json
from pathlib import Path
from typing import Any

from flexarm_ros.bag.mcap.files import naming
from flexarm_ros.identification.estimate.fitting import Fit
from flexarm_ros.identification.prediction.predict import Prediction
from flexarm_ros.identification.prediction.ringing import Mode
from flexarm_ros.identification.setting import text_of


def write(fit: Fit, out: Path, pictures: bool = True) -> list[Path]:
    """Write the files of a fit into the directory ``out`` and return their paths."""
    numbers: dict[str, Any] = fit.as_dict()
    files = [
        _text(out / 'fit.json', json.dumps(numbers, indent=1, allow_nan=False) + '\n'),
        _text(out / 'fitted.yaml', f'# {_source(fit)}\n{text_of(fit.setting)}'),
    ]
    if pictures:
        from flexarm_ros.identification.report.page import fit_page

        named = [(f'fitted_{i + 1}', found) for i, found in enumerate(fit.predictions)]
        named += [(f'held_out_{i + 1}', found) for i, found in enumerate(fit.others)]
        files += _illustrated(out / 'fit.html', named, partial(fit_page, fit))
    return files


def write_prediction(
    prediction: Prediction, rings: tuple[Sequence[Mode], Sequence[Mode]], out: Path
) -> list[Path]:
    """
    Write ``prediction.html`` and its pictures into the directory ``out``; return their paths.

    ``rings``: the modes that ring at rest, measured and predicted.
    """
    from flexarm_ros.identification.report.page import prediction_page

    page = partial(prediction_page, prediction, rings)
    return _illustrated(out / 'prediction.html', [('prediction', prediction)], page)


def _illustrated(
    path: Path, named: list[tuple[str, Prediction]], page: Callable[[list[Path]], str]
) -> list[Path]:
    """Write the pictures of predictions and the page that shows them; return their paths."""
    from flexarm_ros.identification.report.pictures import write_pictures

    drawn = write_pictures(named, path.parent / 'pictures')
    shown = [picture for picture in drawn if picture.suffix == '.png']
    return [_text(path, page(shown)), *drawn]


def _source(fit: Fit) -> str:
    names = ', '.join(Path(task.recording.name).name for task in fit.problem.tasks)
    return f'Fitted on {names}, mode {fit.problem.mode}; uncertainties are in fit.json'


def _text(path: Path, text: str) -> Path:
    unfinished = path.with_name(path.name + '.tmp')
    with naming(path):
        unfinished.write_text(text, 'utf-8', 'backslashreplace')
        unfinished.replace(path)
    return path

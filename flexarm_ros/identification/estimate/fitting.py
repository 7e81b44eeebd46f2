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

"""A fit from recordings to a result: search, uncertainty, hold-out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
import contextlib
from dataclasses import dataclass, replace
import hashlib
import json
import math
from pathlib import Path
from typing import Any

from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.identification.estimate.problem import (
    Free,
    free_number,
    parse_prior,
    Prior,
    Problem,
    Span,
    Task,
)
from flexarm_ros.identification.estimate.scores import Block
from flexarm_ros.identification.estimate.search import Search, Stopped
from flexarm_ros.identification.estimate.statistics import Estimate, estimate, free_scale
from flexarm_ros.identification.prediction.predict import Channel, MODES, predict, Prediction
from flexarm_ros.identification.recording import PathLike, read, Recording
from flexarm_ros.identification.setting import load_setting, numbers_of, Setting, spec_of, text_of
from flexarm_ros.scenario.errors import clip, ScenarioError
import numpy as np

SCALED = ('kg', 'kg m^2', 'kg/m', 'N m^2', 'N m', 'N m s/rad', 'N m/A')
"""Units of the keys that scale with a common factor: masses, stiffnesses and torques."""


@dataclass(frozen=True, eq=False)
class Fit:
    """
    The result of a fit.

    ``values`` (p,) in the order of ``problem.keys``; ``predictions`` of the fitted recordings,
    ``held_out`` the channels of the hold-out, ``others`` the predictions of its recordings;
    ``complete``: the search has converged.
    """

    problem: Problem
    values: FloatArray
    uncertainty: Estimate
    predictions: Sequence[Prediction]
    held_out: Mapping[str, Channel]
    others: Sequence[Prediction]
    warnings: tuple[str, ...]
    complete: bool

    @property
    def setting(self) -> Setting:
        """Return the fitted scenario, with the gauge offsets taken from the first recording."""
        setting = self.problem.setting_at(self.values)
        offsets = self.predictions[0].offsets
        taken = {f'strain_gauge.offset.{name[-1]}': value for name, value in offsets.items()}
        return setting.with_numbers(taken)

    @property
    def parameters(self) -> dict[str, dict[str, Any]]:
        """Return value, std, start and status of each key; std None where it is not finite."""
        stds = self.uncertainty.std
        return {
            free.key: {
                'value': float(self.values[i]),
                'std': float(stds[i]) if math.isfinite(stds[i]) else None,
                'start': float(free.start),
                'status': self.uncertainty.status[i],
            }
            for i, free in enumerate(self.problem.free)
        }

    @property
    def channels(self) -> dict[str, Channel]:
        """Return the fitted channels, the recordings one after the other, without the hold-out."""
        tasks = self.problem.tasks
        return _joined(
            [
                (prediction, task.mask(prediction.recording.rows, inside=False))
                for task, prediction in zip(tasks, self.predictions, strict=True)
            ]
        )

    def as_dict(self) -> dict[str, Any]:
        """Return the contents of ``fit.json``."""
        correlation = self.uncertainty.correlation
        return {
            'parameters': self.parameters,
            'correlation': {
                'keys': list(self.problem.keys),
                'matrix': [
                    [float(v) if math.isfinite(v) else None for v in row] for row in correlation
                ],
            },
            'channels': {name: channel.numbers() for name, channel in self.channels.items()},
            'hold_out': {name: channel.numbers() for name, channel in self.held_out.items()},
            'windows': {'mode': self.problem.mode, 'length': self.problem.window},
            'warnings': list(self.warnings),
            'complete': self.complete,
        }


@dataclass(frozen=True)
class Request:
    """A checked request of a fit; see `prepare`."""

    problem: Problem
    others: tuple[Task, ...]
    starts: int = 1

    @property
    def fingerprint(self) -> str:
        """Return a digest of everything that the search depends on."""
        problem = self.problem
        digest = hashlib.sha256(
            repr(
                (
                    problem.free,
                    problem.mode,
                    problem.window,
                    problem.zero,
                    text_of(problem.setting),
                    self.starts,
                )
            ).encode()
        )
        for task in problem.tasks:
            digest.update(repr((task.held_out, task.recording.period)).encode())
            for name, values in task.recording.channels.items():
                digest.update(name.encode() + np.ascontiguousarray(values).tobytes())
        return digest.hexdigest()


def prepare(
    data: Sequence[PathLike | Recording],
    scenario: PathLike,
    free: Sequence[str],
    mode: str = 'driven',
    window: float | None = 2.0,
    zero: float | None = None,
    priors: Sequence[str] = (),
    hold_out: Sequence[PathLike | Recording] = (),
    overrides: Sequence[str] = (),
    chosen: Sequence[str] = (),
    starts: int = 1,
) -> Request:
    """
    Return a checked request of a fit.

    ``priors`` are texts ``KEY=VALUE+-STD``, ``hold_out`` paths of recordings or spans ``T0:T1``
    in s, which are left out of every recording; ``chosen``: the channels to fit, empty: all;
    ``starts``: number of points from which is searched.
    Raises ScenarioError, one line.
    """
    if mode not in MODES:
        raise ScenarioError(f'--mode {clip(mode)}: one of {", ".join(MODES)}')
    setting = load_setting(scenario, overrides)
    keys = [key for given in free for key in numbers_of(given)]
    if not keys:
        raise ScenarioError('--free: give at least one key, as plant.flexural_rigidity')
    doubled = [key for key in keys if keys.count(key) > 1]
    if doubled:
        raise ScenarioError(f'--free: {doubled[0]} twice')
    known: dict[str, Prior] = {}
    for text in priors:
        given, prior = parse_prior(text)
        for key in numbers_of(given):
            if key not in keys:
                raise ScenarioError(f'--prior {key}: it is not free; free are {", ".join(keys)}')
            known[key] = prior
    spans: list[Span] = []
    others: list[Task] = []
    for one in hold_out:
        span = span_of(one) if isinstance(one, str) else None
        if span is None:
            others.append(Task(_recording(one)))
        else:
            spans.append(span)
    numbers: list[Free] = [free_number(setting, key, known.get(key)) for key in keys]
    tasks = tuple(Task(_recording(one), tuple(spans)) for one in data)
    if not tasks:
        raise ScenarioError('no data: give a CSV, a run or a bag')
    return Request(
        Problem(setting, tuple(numbers), tasks, mode, window, zero, tuple(chosen)),
        tuple(others), starts,
    )  # fmt: skip


def _recording(data: PathLike | Recording) -> Recording:
    return data if isinstance(data, Recording) else read(data)


def span_of(text: str) -> Span | None:
    """Return a span ``T0:T1``; None if the text is a path."""
    first, colon, last = text.partition(':')
    try:
        span = float(first), float(last)
    except ValueError:
        return None
    if not colon or not span[0] < span[1]:
        raise ScenarioError(f'--hold-out {clip(text)}: give T0:T1 with T0 < T1, s')
    return span


def fit(
    request: Request,
    report: Callable[[Search], None] = lambda search: None,
    stop: Callable[[], bool] = lambda: False,
    state: Path | None = None,
) -> Fit:
    """
    Search for the best numbers and return the result; end early once ``stop()`` is true.

    ``report`` is called after each evaluation.  ``state``: a file that stores the search, and
    from which a repeated call resumes; ScenarioError if it belongs to another fit.
    """
    search = Search(request.problem, report, stop, starts=request.starts)
    if state is not None:
        _restore(search, request, state)

    def noted(search: Search) -> None:
        if state is not None:
            _keep(search, request, state)
        report(search)

    search.report = noted
    with contextlib.suppress(Stopped):
        search.run()
    return _result(request, search)


def _keep(search: Search, request: Request, state: Path) -> None:
    document = {
        'fingerprint': request.fingerprint if search.evaluations <= 1 else search.fingerprint,
        'round': search.round,
        'start': search.start,
        'best': {k: float(v) for k, v in zip(request.problem.keys, search.best, strict=True)},
        'finished': search.finished,
    }
    search.fingerprint = str(document['fingerprint'])
    partial = state.with_name(state.name + '.tmp')
    partial.write_text(json.dumps(document, indent=1), 'utf-8')
    partial.replace(state)


def _restore(search: Search, request: Request, state: Path) -> None:
    search.fingerprint = request.fingerprint
    if not state.is_file():
        return
    try:
        document = json.loads(state.read_text('utf-8'))
        if document['fingerprint'] != search.fingerprint:
            raise ScenarioError(f'{state}: belongs to another fit; give another --out')
        search.best = np.array([float(document['best'][key]) for key in request.problem.keys])
        search.round = min(max(int(document['round']), 0), 1)
        search.start = min(max(int(document['start']), 0), search.starts - 1)
    except (OSError, ValueError, KeyError, TypeError) as error:
        if isinstance(error, ScenarioError):
            raise
        raise ScenarioError(f'{state}: cannot be read; remove it') from None


def _result(request: Request, search: Search) -> Fit:
    problem, values = request.problem, search.best
    blocks = search.blocks()
    uncertainty = estimate(values, blocks, problem.prior_std())
    setting = problem.setting_at(values)
    predictions = problem.predictions(values)
    held = [
        (prediction, task.mask(prediction.recording.rows, inside=True))
        for task, prediction in zip(problem.tasks, predictions, strict=True)
        if task.held_out
    ]
    others = [
        predict(task.recording, setting, problem.mode, problem.window, problem.zero)
        for task in request.others
    ]
    held += [(found, np.ones(found.recording.rows, dtype=bool)) for found in others]
    return Fit(
        problem, values, uncertainty, predictions, _joined(held), others,
        _warnings(request, search, uncertainty, blocks, [*predictions, *others]), search.finished,
    )  # fmt: skip


def _joined(parts: Sequence[tuple[Prediction, Any]]) -> dict[str, Channel]:
    """Return the channels of several predictions, one after the other, at the masks' samples."""
    found: dict[str, list[Channel]] = {}
    for prediction, mask in parts:
        for name, channel in prediction.channels.items():
            found.setdefault(name, []).append(replace(channel, valid=channel.valid & mask))
    return {
        name: Channel(
            np.concatenate([c.measured for c in held]),
            np.concatenate([c.predicted for c in held]),
            np.concatenate([c.valid for c in held]),
        )
        for name, held in found.items()
    }


def _warnings(
    request: Request,
    search: Search,
    uncertainty: Estimate,
    blocks: Sequence[Block],
    predictions: Sequence[Prediction],
) -> tuple[str, ...]:
    problem = request.problem
    found = []
    scaled = [spec_of(free.key).unit in SCALED for free in problem.free]
    told = any(
        free.prior is not None for free, one in zip(problem.free, scaled, strict=True) if one
    )
    jacobians = [jacobian for jacobian, _ in blocks]
    if not told and free_scale(jacobians, search.best, scaled):
        names = ', '.join(key for key, one in zip(problem.keys, scaled, strict=True) if one)
        found.append(f'only ratios are determined of {names}: fix one of them or give it a prior')
    for free, status in zip(problem.free, uncertainty.status, strict=True):
        if status == 'not identifiable':
            found.append(f'{free.key}: these data do not determine it')
    for free, value in zip(problem.free, search.best, strict=True):
        if min(value - free.low, free.high - value) <= 1e-6 * free.scale:
            found.append(f'{free.key}: at the bound of its range, {value:.4g}')
    found += [f'{one.recording.name}: {note}' for one in predictions for note in one.notes]
    if not search.finished:
        found.append('the search was stopped before it converged')
    return tuple(found)
